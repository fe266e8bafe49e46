"""Counts that are taken evenly and stamped unevenly: their times on the even grid.

Counters are mostly read by a clock of their own; what jitters is when the reading is stamped. A grid follows the
stamps (a tracker of time and period). Whether it is nearer to the truth than they are, the way itself tells: speeds
between counts change more smoothly by the better times. Stamps that are even already, or true though uneven, stay.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import Counts, Floats
from services.odometry_fusion.tick_layout import Records

Record = Any
"""One element of a record array, its fields by name."""

OFF_SHARE: Final = 0.4
"""A stamp that is off the grid by more of a period belongs to another grid."""
LATE_PERIODS: Final = 1.75
"""From so many on counts are missing; a single one is not so late."""
MOST_OFF: Final = 4
"""After so many of them in a row the grid begins anew, and after a gap of"""
MOST_PERIODS: Final = 50.0
"""so many periods."""
LEAST_PERIOD_NS: Final = 1e7
BASE_COUNTS: Final = 11
"""The first ones, whose steps as a whole give the period."""
FIRST_COUNTS: Final = 40
"""The grid is followed for so many counts before it may be believed."""
MEMORY: Final = 300
"""Counts over which roughness is a mean."""
BETTER: Final = 0.5
"""Share of the roughness by the stamps below which the grid is believed."""
LEAST_GAIN: Final = 0.02
"""Of the tracker: the grid's time is a mean over some fifty counts."""

GRID: Final = np.dtype([
    ("counts", np.int64),
    ("off", np.int64),
    ("first_ns", np.int64),
    ("stamp_ns", np.int64),
    ("given_ns", np.int64),
    *(
        (name, np.float64)
        for name in (
            "even_ns",
            "period_ns",
            "way_m",
            # last speeds by stamps and by the grid, and their second differences squared
            "stamp1_mps",
            "stamp2_mps",
            "even1_mps",
            "even2_mps",
            "stamp_roughness",
            "even_roughness",
        )
    ),
])  # fmt: skip
"""The grid that is followed, and how smooth the way is by it and by the stamps."""


@kernel
def even_times(t_ns: Counts, way_m: Floats, grid: Records, even_ns: Counts) -> None:
    """Fill `even_ns` with the time of each count, by the grid where it is the better one; rising."""
    now = grid[0]
    for k in range(len(t_ns)):
        if now.off >= MOST_OFF or t_ns[k] - now.even_ns > MOST_PERIODS * max(now.period_ns, LEAST_PERIOD_NS):
            now.counts, now.off = 0, 0
        if now.counts < BASE_COUNTS:
            _begin_grid(t_ns[k], now)
        else:
            follow_grid(t_ns[k], way_m[k], now)
        now.stamp_ns, now.way_m = t_ns[k], way_m[k]
        believed = now.counts > FIRST_COUNTS and now.even_roughness < BETTER * now.stamp_roughness
        time_ns = np.int64(np.rint(now.even_ns)) if believed else t_ns[k]
        now.given_ns = max(time_ns, now.given_ns + 1)
        even_ns[k] = now.given_ns


@kernel
def _begin_grid(t_ns: int, now: Record) -> None:
    """Take the period from the first counts as a whole."""
    if now.counts == 0:
        now.first_ns = t_ns
    else:
        now.period_ns = (t_ns - now.first_ns) / now.counts
    now.even_ns = float(t_ns)
    now.counts += 1


@kernel
def follow_grid(t_ns: int, way_m: float, now: Record) -> None:
    """One count more on the grid (an alpha-beta tracker), and what it says of the speeds."""
    periods = (t_ns - now.even_ns) / now.period_ns
    periods = np.rint(periods) if periods > LATE_PERIODS else 1.0
    before_ns = now.even_ns
    now.even_ns += periods * now.period_ns
    off_ns = t_ns - now.even_ns
    if abs(off_ns) > OFF_SHARE * now.period_ns:
        now.off += 1
        return
    now.off = 0
    now.counts += 1
    gain = max(2.0 / now.counts, LEAST_GAIN)
    now.even_ns += gain * off_ns
    now.period_ns += 0.5 * gain * gain * off_ns
    move_m = way_m - now.way_m
    stamp_mps, even_mps = 1e9 * move_m / (t_ns - now.stamp_ns), 1e9 * move_m / (now.even_ns - before_ns)
    share = max(1.0 / now.counts, 1.0 / MEMORY)
    rough = stamp_mps - 2.0 * now.stamp1_mps + now.stamp2_mps
    now.stamp_roughness += share * (rough * rough - now.stamp_roughness)
    rough = even_mps - 2.0 * now.even1_mps + now.even2_mps
    now.even_roughness += share * (rough * rough - now.even_roughness)
    now.stamp2_mps, now.stamp1_mps = now.stamp1_mps, stamp_mps
    now.even2_mps, now.even1_mps = now.even1_mps, even_mps
