"""What traction adds to a track circuit: mains comb, lines of inverters, impulses, white noise."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

Amplitude = Annotated[float, Meta(ge=0.0, le=10.0)]
Hertz = Annotated[float, Meta(gt=0.0)]
ROLL_OFF_HZ = 1_000.0
"""Harmonics of the mains fall with 1 / f from here on."""
RINGING_S = 0.3e-3
"""An arc's impulse rings this long in rail and input filter."""


class InverterLine(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A line that moves as a train accelerates."""

    hz: Hertz
    amplitude: Amplitude
    sweep_hz_per_s: float = 0.0


class TractionSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Disturbances at the receiver, relative to full scale 1."""

    white_rms: Amplitude = 0.0
    mains_hz: Hertz = 50.0
    comb_amplitude: Amplitude = 0.0
    """Of each harmonic up to 1 kHz."""
    comb_odd_only: bool = False
    lines: tuple[InverterLine, ...] = ()
    impulses_per_s: Annotated[float, Meta(ge=0.0, le=1000.0)] = 0.0
    impulse_amplitude: Amplitude = 0.0


class TractionNoise:
    """Noise of one place, block by block."""

    def __init__(self, settings: TractionSettings, sample_rate_hz: float, rng: np.random.Generator) -> None:
        """Draw the phases, which stay."""
        self._settings, self._rate_hz, self._rng = settings, sample_rate_hz, rng
        step = 2 if settings.comb_odd_only else 1
        count = int(0.49 * sample_rate_hz / settings.mains_hz) if settings.comb_amplitude > 0.0 else 0
        self._orders = np.arange(1, count + 1, step)
        self._phases = rng.uniform(0.0, 1.0, len(self._orders))
        self._comb = self._one_period()

    def _one_period(self) -> NDArray[np.float64]:
        """A finely sampled period of the comb."""
        points = 1 << 14
        spectrum = np.zeros(points // 2 + 1, np.complex128)
        hz = self._orders * self._settings.mains_hz
        fall = np.minimum(1.0, ROLL_OFF_HZ / np.maximum(hz, 1.0))
        spectrum[self._orders] = self._settings.comb_amplitude * fall * np.exp(2j * np.pi * self._phases) / 2.0
        return np.asarray(np.fft.irfft(spectrum, points) * points, np.float64)

    def block(self, first_sample: int, count: int) -> NDArray[np.float64]:
        """Noise at samples `first_sample` …; blocks must be asked for in order."""
        settings = self._settings
        t_s = (first_sample + np.arange(count)) / self._rate_hz
        found = self._rng.normal(0.0, 1.0, count) * settings.white_rms
        if len(self._orders):
            turns = (t_s * settings.mains_hz) % 1.0
            found += np.interp(
                turns, np.arange(len(self._comb) + 1) / len(self._comb), np.append(self._comb, self._comb[0])
            )
        for line in settings.lines:
            turns = t_s * line.hz + 0.5 * line.sweep_hz_per_s * t_s**2
            found += line.amplitude * np.cos(2.0 * np.pi * (turns % 1.0))
        if settings.impulses_per_s > 0.0:
            found += self._impulses(count)
        return np.asarray(found, np.float64)

    def _impulses(self, count: int) -> NDArray[np.float64]:
        """Decaying rings of either sign at random places; those at the end are cut by it."""
        found = np.zeros(count)
        ringing = max(2, round(RINGING_S * self._rate_hz))
        ring = np.exp(-3.0 * np.arange(ringing) / ringing) * np.cos(np.pi * np.arange(ringing) / 3.0)
        for at in self._rng.integers(
            0, count, self._rng.poisson(self._settings.impulses_per_s * count / self._rate_hz)
        ):
            size = self._settings.impulse_amplitude * float(self._rng.choice([-1.0, 1.0]))
            found[at : at + ringing] += size * ring[: count - at]
        return found
