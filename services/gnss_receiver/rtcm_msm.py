"""Multiple Signal Messages MSM4 to MSM7 of RTCM 3: what they measured, in metres.

All cells of a message are read as columns. Source: RTCM 10403.3, 3.5.16.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.arrays import Float64s
from services.gnss_receiver.bit_fields import BitReader, Int64s, bits_of, column
from services.gnss_receiver.rtcm_msm_layout import (
    CHANNEL_UNKNOWN,
    CHANNEL_ZERO,
    FINE_RATE_BITS,
    FINE_RATE_MPS,
    KINDS,
    LAYOUTS,
    LIGHT_M_PER_MS,
    LOCKS,
    LONGEST_EPOCH,
    NO_ROUGH_MS,
    NO_ROUGH_RATE,
    ROUGH_MS,
    SIGNALS,
    SYSTEM_OF,
    satellite_of,
)

_MOST_CELLS = 64
_AFTER_EPOCH = 3 + 7 + 2 + 2 + 1 + 3
"""Station issue, reserved, clock steering, external clock, smoothing and its interval: nothing follows from them."""
_SATELLITES, _SIGNALS = 64, 32


@dataclass(frozen=True, slots=True)
class MsmCells:
    """What one message measured. Columns have shape (cells,); NaN where there is nothing."""

    system: str
    station: int
    epoch: int
    """Epoch field as it stands there: the time scale depends on the system."""
    more: bool
    """Further messages of the same epoch follow."""
    satellites: tuple[str, ...]
    signals: tuple[str, ...]
    pseudorange_m: Float64s
    phase_range_m: Float64s
    range_rate_mps: Float64s
    cn0_dbhz: Float64s
    lock_s: Float64s
    """The carrier has been locked for at least this time …"""
    lock_below_s: Float64s
    """… and less than this."""
    half_cycle: Int64s
    """1 where the phase may be off by half a cycle."""
    channels: dict[str, int]
    """GLONASS frequency channels by satellite, as far as the message says them."""
    unknown: int
    """Cells of satellites and signals that have no name; they are left out."""


def msm_kind(number: int) -> int:
    """4 to 7 for a message that `read_msm` reads, else 0.

    >>> msm_kind(1077), msm_kind(1071), msm_kind(1019)
    (7, 0, 0)
    """
    return number % 10 if number // 10 in SYSTEM_OF and number % 10 in KINDS else 0


def _places(mask: int, width: int) -> list[int]:
    """Places of the bits that are set, counted from 1 at the first."""
    return [place for place in range(1, width + 1) if mask >> (width - place) & 1]


def read_msm(message: bytes) -> MsmCells:
    """Cells of a message whose number `msm_kind` knows. Raises ValueError when it is cut short or cannot be."""
    reader = BitReader(message)
    number, station, epoch = reader.uint(12), reader.uint(12), reader.uint(LONGEST_EPOCH)
    more = bool(reader.uint(1))
    reader.uint(_AFTER_EPOCH)
    system, kind = SYSTEM_OF[number // 10], msm_kind(number)
    places = _places(reader.uint(_SATELLITES), _SATELLITES)
    signals = _places(reader.uint(_SIGNALS), _SIGNALS)
    size = len(places) * len(signals)
    if size > _MOST_CELLS:
        msg = f"{len(places)} satellites with {len(signals)} signals are more than {_MOST_CELLS} cells"
        raise ValueError(msg)
    cells = [cell - 1 for cell in _places(reader.uint(size), size)]
    bits = bits_of(message)
    satellite = np.array([cell // len(signals) for cell in cells], np.int64)
    names = [satellite_of(system, place) for place in places]
    labels = [SIGNALS[system].get(place) for place in signals]
    rough = _rough(bits, reader.at, len(places), rates=LAYOUTS[kind].with_rate)
    fine = _Fine(bits, rough.stop, len(cells), kind)
    sat_names = [names[at] for at in satellite.tolist()]
    sig_names = [labels[cell % len(signals)] for cell in cells]
    keep = np.array([a is not None and b is not None for a, b in zip(sat_names, sig_names, strict=True)], np.bool_)
    rough_ms = rough.range_ms[satellite]
    return MsmCells(
        system=system,
        station=station,
        epoch=epoch,
        more=more,
        satellites=tuple(name for name, good in zip(sat_names, keep.tolist(), strict=True) if name and good),
        signals=tuple(name for name, good in zip(sig_names, keep.tolist(), strict=True) if name and good),
        pseudorange_m=((rough_ms + fine.range_ms) * LIGHT_M_PER_MS)[keep],
        phase_range_m=((rough_ms + fine.phase_ms) * LIGHT_M_PER_MS)[keep],
        range_rate_mps=(rough.rate_mps[satellite] + fine.rate_mps)[keep],
        cn0_dbhz=fine.cn0_dbhz[keep],
        lock_s=fine.lock_s[keep],
        lock_below_s=fine.lock_below_s[keep],
        half_cycle=fine.half_cycle[keep],
        channels={} if system != "R" else _channels(names, rough.extended),
        unknown=int(np.count_nonzero(~keep)),
    )


def _channels(names: list[str | None], extended: list[int]) -> dict[str, int]:
    pairs = zip(names, extended, strict=False)
    return {name: value - CHANNEL_ZERO for name, value in pairs if name and value < CHANNEL_UNKNOWN - 1}


@dataclass(frozen=True, slots=True)
class _Rough:
    """Fields of the satellites, shape (satellites,)."""

    range_ms: Float64s
    rate_mps: Float64s
    extended: list[int]
    stop: int


def _rough(bits: np.ndarray[tuple[int], np.dtype[np.uint8]], at: int, count: int, *, rates: bool) -> _Rough:
    whole = column(bits, at, count, 8)
    at += 8 * count
    extended: list[int] = []
    if rates:
        extended = column(bits, at, count, 4).tolist()
        at += 4 * count
    range_ms = whole + ROUGH_MS * column(bits, at, count, 10)
    range_ms[whole == NO_ROUGH_MS] = np.nan
    at += 10 * count
    rate = np.full(count, np.nan)
    if rates:
        metres = column(bits, at, count, 14, signed=True)
        rate = np.where(metres == NO_ROUGH_RATE, np.nan, metres)
        at += 14 * count
    return _Rough(range_ms, rate, extended, at)


class _Fine:
    """Fields of the cells, shape (cells,)."""

    def __init__(self, bits: np.ndarray[tuple[int], np.dtype[np.uint8]], at: int, count: int, kind: int) -> None:
        layout = LAYOUTS[kind]
        self._bits, self._at, self._count = bits, at, count
        self.range_ms = self._scaled(layout.range_bits, layout.range_ms)
        self.phase_ms = self._scaled(layout.phase_bits, layout.phase_ms)
        lock = self._next(layout.lock_bits)
        least, below = LOCKS[layout.lock_bits]
        self.lock_s, self.lock_below_s = least[lock], below[lock]
        self.half_cycle = self._next(1)
        cn0 = self._next(layout.cn0_bits)
        self.cn0_dbhz = np.where(cn0 == 0, np.nan, cn0 * layout.cn0_db)
        self.rate_mps = np.full(count, np.nan)
        if layout.with_rate:
            self.rate_mps = self._scaled(FINE_RATE_BITS, FINE_RATE_MPS)

    def _next(self, width: int, *, signed: bool = False) -> Int64s:
        values = column(self._bits, self._at, self._count, width, signed=signed)
        self._at += self._count * width
        return values

    def _scaled(self, width: int, scale: float) -> Float64s:
        """Next column in its unit; the most negative number says that there is nothing."""
        values = self._next(width, signed=True)
        return np.where(values == -(1 << (width - 1)), np.nan, values * scale)
