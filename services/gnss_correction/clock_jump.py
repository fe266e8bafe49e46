"""Jumps of a receiver's clock: whole milliseconds, common to all satellites.

Many receivers let their clock run free and set it by a millisecond (300 km of range) when
it has drifted that far, some in pseudorange alone, some in pseudorange and carrier phase. To a
detector of changes every satellite then moves at once by what no satellite can.

Pseudoranges and the stamps of epochs are made by the same clock. When the one jumps, so does the
other against true time: between two epochs true time goes on by the difference of their stamps
less the jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from typing import Final

from services.gnss_correction.atmosphere import LIGHT_MPS

MILLISECOND_M: Final = LIGHT_MPS * 1e-3
TOLERANCE_M: Final = 0.1 * MILLISECOND_M
"""How far from whole milliseconds a change may be: room for what was not predicted."""
FEWEST: Final = 2
"""One satellite alone proves nothing: decoders that lose a bit also err by whole milliseconds."""


def clock_jump_ms(unpredicted_change_m: Sequence[float]) -> int:
    """Milliseconds by which the receiver's clock jumped forward between two epochs.

    For each satellite seen at both epochs: its change of pseudorange minus the change that its
    Doppler (or its earlier rate) predicts. Zero unless at least two and more than half of the
    satellites agree on the same whole number of milliseconds other than zero.

    >>> clock_jump_ms([299_792.5, 299_793.0, 0.1, 299_791.0])
    1
    >>> clock_jump_ms([12.0, -3.0, 0.1])
    0
    """
    if len(unpredicted_change_m) < FEWEST:
        return 0
    jump_ms = round(median(unpredicted_change_m) / MILLISECOND_M)
    agreeing = sum(abs(change_m - jump_ms * MILLISECOND_M) < TOLERANCE_M for change_m in unpredicted_change_m)
    return jump_ms if agreeing >= FEWEST and 2 * agreeing > len(unpredicted_change_m) else 0
