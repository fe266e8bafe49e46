"""The rail as a transmission line: how much of what is sent arrives, dry or wet, clear, shunted or broken.

Series impedance Z = R sqrt(f / kHz) + j 2 pi f L (skin effect), shunt admittance Y = G + j 2 pi f C, both per
kilometre; propagation constant sqrt(Z Y), wave impedance sqrt(Z / Y). Pieces of line, shunts and breaks are chain
(ABCD) matrices in a row between sending and receiving impedance.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

Positive = Annotated[float, Meta(gt=0.0)]
Complexes = NDArray[np.complex128]
BALLAST_RANGE_S_PER_KM = (0.01, 0.5)
"""From dry and well drained to soaked."""
BROKEN_OHM = 1e4
"""Of an open rail: what leaks around it over sleepers."""


class Rail(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Constants of a track and of what stands at its ends."""

    resistance_ohm_per_km: Positive = 0.9
    """At 1 kHz; grows with the root of the frequency."""
    inductance_h_per_km: Positive = 1.3e-3
    capacitance_f_per_km: Annotated[float, Meta(ge=0.0)] = 0.0
    sending_ohm: Positive = 1.0
    receiving_ohm: Positive = 2.0
    tuned_q: Annotated[float, Meta(ge=0.0, le=50.0)] = 0.0
    """Quality of the tuned unit at either end; 0: none."""
    tuned_hz: Positive = 12_000.0


def propagation(rail: Rail, hz: ArrayLike, ballast_s_per_km: ArrayLike) -> tuple[Complexes, Complexes]:
    """Propagation constant per km and wave impedance [ohm]."""
    omega = 2.0 * np.pi * np.asarray(hz, np.float64)
    series = rail.resistance_ohm_per_km * np.sqrt(np.asarray(hz, np.float64) / 1e3) + 1j * (
        omega * rail.inductance_h_per_km
    )
    shunt = np.asarray(ballast_s_per_km, np.float64) + 1j * omega * rail.capacitance_f_per_km
    return np.asarray(np.sqrt(series * shunt), np.complex128), np.asarray(np.sqrt(series / shunt), np.complex128)


def _through_line(
    voltage: Complexes, current: Complexes, gamma: Complexes, wave_ohm: Complexes, km: ArrayLike
) -> tuple[Complexes, Complexes]:
    """Voltage and current at the near end of a piece of line, from those at its far end."""
    angle = gamma * np.asarray(km, np.float64)
    cosh, sinh = np.cosh(angle), np.sinh(angle)
    return cosh * voltage + wave_ohm * sinh * current, sinh / wave_ohm * voltage + cosh * current


def _tuned(rail: Rail, hz: ArrayLike) -> Complexes:
    """Both tuned units: 1 / (1 + j Q (f / f0 - f0 / f)) each."""
    if rail.tuned_q <= 0.0:
        return np.ones(np.shape(hz), np.complex128)
    ratio = np.asarray(hz, np.float64) / rail.tuned_hz
    return np.asarray((1.0 + 1j * rail.tuned_q * (ratio - 1.0 / ratio)) ** -2, np.complex128)


def transfer(
    rail: Rail,
    hz: ArrayLike,
    length_km: ArrayLike,
    ballast_s_per_km: ArrayLike,
    *,
    shunt_ohm: ArrayLike | None = None,
    shunt_km: ArrayLike = 0.0,
    second_ohm: ArrayLike | None = None,
    second_km: ArrayLike = 0.0,
    broken_km: ArrayLike | None = None,
) -> Complexes:
    """Voltage at the receiving impedance over that of the source, tuned units included. Arguments broadcast.

    A shunt of `shunt_ohm` lies `shunt_km` from the sending end, that of a second train nearer to it; a rail broken at
    `broken_km` is open there. Raises ValueError for a second train that is no nearer.
    """
    if second_ohm is not None and np.any(np.asarray(second_km) > np.asarray(shunt_km)):
        msg = "the second shunt must lie nearer to the sending end than the first"
        raise ValueError(msg)
    gamma, wave_ohm = propagation(rail, hz, ballast_s_per_km)
    place = np.asarray(shunt_km if broken_km is None else broken_km, np.float64)
    voltage = np.ones_like(gamma)
    current = voltage / rail.receiving_ohm
    voltage, current = _through_line(voltage, current, gamma, wave_ohm, np.asarray(length_km) - place)
    if broken_km is not None:
        voltage = voltage + BROKEN_OHM * current
    elif shunt_ohm is not None:
        current = current + voltage / np.maximum(np.asarray(shunt_ohm, np.float64), 1e-6)
    if second_ohm is not None and broken_km is None:
        second = np.asarray(second_km, np.float64)
        voltage, current = _through_line(voltage, current, gamma, wave_ohm, place - second)
        current = current + voltage / np.maximum(np.asarray(second_ohm, np.float64), 1e-6)
        place = second
    voltage, current = _through_line(voltage, current, gamma, wave_ohm, place)
    return np.asarray(_tuned(rail, hz) / (voltage + rail.sending_ohm * current), np.complex128)


def level_db(response: ArrayLike) -> NDArray[np.float64]:
    """20 log10 of a response's magnitude."""
    return np.asarray(20.0 * np.log10(np.abs(np.asarray(response)) + 1e-30), np.float64)


def ballast_estimate(rail: Rail, hz: float, length_km: float, level_now_db: float, dry_level_db: float) -> float | None:
    """Leakage [S/km] that explains a level of the clear circuit, given its level when dry (0.01 S/km).

    None where no leakage of the usual range does: then something else is wrong.
    """
    grid = np.geomspace(*BALLAST_RANGE_S_PER_KM, 200)
    levels = level_db(transfer(rail, hz, length_km, grid))
    wanted = level_now_db - dry_level_db + levels[0]
    margin_db = 1.0
    if not levels[-1] - margin_db <= wanted <= levels[0] + margin_db:
        return None
    return float(np.interp(wanted, levels[::-1], grid[::-1]))
