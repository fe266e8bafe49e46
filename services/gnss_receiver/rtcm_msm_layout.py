"""How Multiple Signal Messages are laid out: widths, scales, marks of absence, lock times.

Source: RTCM 10403.3, 3.5.16 (tables 3.5-75 to 3.5-107); names of signals and satellites by pyrtcm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pyrtcm.rtcmtables import PRNSIGMAP

LIGHT_M_PER_MS: Final = 299_792.458
SYSTEM_OF: Final = {107: "G", 108: "R", 109: "E", 110: "S", 111: "J", 112: "C", 113: "I"}
"""By message number without its last digit."""
FAMILY_OF: Final = {system: family for family, system in SYSTEM_OF.items()}
KINDS: Final = (4, 5, 6, 7)
"""Messages with whole pseudoranges; MSM1 to MSM3 need an outside clock and are not read."""
SIGNALS: Final = {
    SYSTEM_OF[int(family)]: {identity: name for identity, (_, name) in signals.items()}
    for family, (_, signals) in PRNSIGMAP.items()
    if int(family) in SYSTEM_OF
}
"""RINEX 3 names by system and place in the signal mask, counted from 1."""
_SBAS_FIRST: Final = 19
"""Place 1 of the SBAS mask is PRN 120, S20 in RINEX."""
_MOST_NUMBERS: Final = {"G": 32, "R": 27, "E": 36, "S": 58, "J": 10, "C": 63, "I": 14}
"""Highest number that RINEX or the constellation has."""

ROUGH_MS: Final = 2.0**-10
NO_ROUGH_MS: Final = 255
NO_ROUGH_RATE: Final = -(1 << 13)
FINE_RATE_MPS: Final = 1e-4
FINE_RATE_BITS: Final = 15
CHANNEL_UNKNOWN: Final = 15
CHANNEL_ZERO: Final = 7
"""The field holds the GLONASS channel plus this."""
_LAST_LOCK: Final = 704
"""Highest indicator of DF407; those above are reserved."""
LONGEST_EPOCH: Final = 30
"""Bits of the epoch field; GLONASS has 3 of weekday and 27 of time in them."""


@dataclass(frozen=True, slots=True)
class CellLayout:
    """Widths in bits and scales of the fields of one signal of one satellite."""

    range_bits: int
    range_ms: float
    phase_bits: int
    phase_ms: float
    lock_bits: int
    cn0_bits: int
    cn0_db: float
    with_rate: bool


LAYOUTS: Final = {
    4: CellLayout(15, 2.0**-24, 22, 2.0**-29, 4, 6, 1.0, with_rate=False),
    5: CellLayout(15, 2.0**-24, 22, 2.0**-29, 4, 6, 1.0, with_rate=True),
    6: CellLayout(20, 2.0**-29, 24, 2.0**-31, 10, 10, 2.0**-4, with_rate=False),
    7: CellLayout(20, 2.0**-29, 24, 2.0**-31, 10, 10, 2.0**-4, with_rate=True),
}


def satellite_of(system: str, place: int) -> str | None:
    """RINEX 3 name of the satellite at a place of the mask, counted from 1; None for a reserved one.

    >>> satellite_of("S", 1)
    'S20'
    """
    number = place + (_SBAS_FIRST if system == "S" else 0)
    return f"{system}{number:02d}" if number <= _MOST_NUMBERS[system] else None


def place_of(satellite: str) -> int:
    """Place of a satellite in its system's mask."""
    return int(satellite[1:]) - (_SBAS_FIRST if satellite[0] == "S" else 0)


def _coarse_locks() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and greatest lock time [s] of DF402: below 32 ms, then doubling."""
    least = np.concatenate([[0.0], 0.032 * 2.0 ** np.arange(15)])
    return least, np.append(least[1:], np.inf)


def _fine_locks() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and greatest lock time [s] of DF407: 64 steps of 1 ms, 32 of 2 ms, 32 of 4 ms and so on."""
    index = np.arange(1024)
    fold = np.maximum(index // 32 - 1, 0)
    step_ms = 2.0**fold
    closed = index < _LAST_LOCK
    least_ms = np.where(closed, step_ms * (index - 32 * fold), 2.0**26)
    return least_ms / 1000.0, np.where(closed, (least_ms + step_ms) / 1000.0, np.inf)


LOCKS: Final = {4: _coarse_locks(), 10: _fine_locks()}
"""By width of the field: least and greatest lock time [s] of every indicator."""


def lock_indicator(lock_s: float, bits: int) -> int:
    """Greatest indicator whose least lock time has passed.

    >>> lock_indicator(0.07, 4), lock_indicator(0.07, 10), lock_indicator(1e6, 10)
    (2, 67, 704)
    """
    least, below = LOCKS[bits]
    last = int(np.argmax(np.isinf(below)))
    return int(np.searchsorted(least[: last + 1], lock_s, side="right")) - 1
