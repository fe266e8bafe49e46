"""A channel simulator: what is sent passes a filter made of a frequency response."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.rail import Rail, transfer

Response = Callable[[NDArray[np.float64]], NDArray[np.complex128]]
LOWEST_HZ = 50.0
"""Below it responses are taken as there: tuned units are not made for direct current."""
FEWEST_TAPS = 64


def fir_of(response: Response, sample_rate_hz: float, taps: int = 512) -> NDArray[np.float64]:
    """Impulse response of `taps` samples; what leads it (by band limiting) is a sixteenth of them.

    The delay of `taps // 16` samples is part of it. Raises ValueError for fewer than 64 taps.
    """
    if taps < FEWEST_TAPS:
        msg = f"{taps} taps are too few for a rail and its tuned units ({FEWEST_TAPS} at least)"
        raise ValueError(msg)
    size = 8 * taps
    hz = np.fft.rfftfreq(size, 1.0 / sample_rate_hz)
    wanted = response(np.maximum(hz, LOWEST_HZ))
    lead = taps // 16
    impulse = np.roll(np.fft.irfft(wanted, size), lead)[:taps]
    fade = np.ones(taps)
    fade[:lead] = 0.5 - 0.5 * np.cos(np.pi * (np.arange(lead) + 0.5) / lead)
    fade[-lead:] = fade[:lead][::-1]
    return np.asarray(impulse * fade, np.float64)


def rail_fir(
    rail: Rail,
    length_km: float,
    ballast_s_per_km: float,
    sample_rate_hz: float,
    *,
    state: Mapping[str, float] | None = None,
    taps: int = 512,
) -> NDArray[np.float64]:
    """Impulse response of a track; `state` as in `rail.transfer` (shunt_ohm and shunt_km, or broken_km)."""
    return fir_of(lambda hz: transfer(rail, hz, length_km, ballast_s_per_km, **(state or {})), sample_rate_hz, taps)


class FirFilter:
    """A filter that samples pass in blocks; its impulse response may change from block to block."""

    def __init__(self, taps: NDArray[np.float64]) -> None:
        """Silence came before."""
        self._taps = taps
        self._before = np.zeros(len(taps) - 1)

    def pass_on(self, block: NDArray[np.float64], taps: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """The block filtered; towards new `taps` of the same length it fades over within the block."""
        source = np.concatenate([self._before, block])
        self._before = source[len(block) :]
        found = _convolved(source, self._taps)[: len(block)]
        if taps is not None:
            share = (np.arange(len(block)) + 1.0) / len(block)
            found = found * (1.0 - share) + _convolved(source, taps)[: len(block)] * share
            self._taps = taps
        return found


def _convolved(source: NDArray[np.float64], taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Valid part of the convolution, through the spectrum."""
    size = 1 << int(np.ceil(np.log2(len(source) + len(taps))))
    product = np.fft.rfft(source, size) * np.fft.rfft(taps, size)
    return np.asarray(np.fft.irfft(product, size)[len(taps) - 1 : len(source)], np.float64)


def filtered(samples: NDArray[np.float64], taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """All samples through a filter that does not change, as many as went in."""
    return FirFilter(taps).pass_on(np.asarray(samples, np.float64))
