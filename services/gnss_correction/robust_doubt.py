"""When the robust filter doubts itself or its measurements: wrong states are left, common offsets are told.

A filter that believes its prediction can take all measurements for outliers and stay wrong for
ever. Where for DOUBT_S most of the information in the pseudoranges contradicts the state, its
covariance is opened wide, and the measurements decide. The place then moves against its own
motion by Doppler: either the old place was wrong, or the new one is (a repeated or spoofed signal
moves all pseudoranges consistently). Nobody can tell which; the bound covers both for a while.

Who leads all pseudoranges away slowly, and leaves the Dopplers as they are, is told by the sum of what the pseudoranges
moved the place against the velocity, forgotten with DRAG_S: a lead of r metres per second makes it r DRAG_S.
Who changes the Dopplers along is seen by wheels or a line alone.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from services.gnss_correction.rejection import Rejection
from services.gnss_correction.robust_state import VELOCITY, Memory
from services.gnss_correction.solver_arrays import Records
from services.numerics.kernel import inner_kernel

DOUBT_S: Final = 3.0
"""Longer than vehicles pass a facade that reflects the strong signals too."""
DOUBTFUL_SQUARE: Final = 9.0
"""Square of the normalised residual from which on a pseudorange contradicts."""
INCONSISTENT_SQUARE: Final = 25.0
"""From here on it counts as excluded; its weight is below a sixth."""
OPENED_M: Final = 200.0
OPENED_MPS: Final = 10.0
RESETTLED_M: Final = 20.0
"""After a move by more the place is as new as after a start."""
TOLD_M: Final = 50.0
"""A move against the motion by more is told, and covered by the bound."""
COVERED_S: Final = 60.0
DRAG_S: Final = 60.0
DRAG_HELD_S: Final = 600.0
"""Once told it is not forgotten as long as it lasts; where the old place was the wrong one, after a while."""
SETTLED_S: Final = 15.0
BRIDGED_S: Final = 2.0
"""So long after a start the place is still being found, and after so long without satellites enough."""
CLOCK_STEP_M: Final = 300.0
"""Step of a clock beyond whole milliseconds that is told: a microsecond, more than steering does at once."""

_USABLE, _INCONSISTENT = int(Rejection.USABLE), int(Rejection.INCONSISTENT)


@inner_kernel
def open_when_doubtful(memory: Memory) -> bool:
    """Open the covariance before an epoch's update when the state has been contradicted for long enough."""
    now = memory.now[0]
    if now.doubt_s < DOUBT_S:
        return False
    for i in range(3):
        memory.covariance[i, i] += OPENED_M * OPENED_M
        memory.covariance[VELOCITY + i, VELOCITY + i] += OPENED_MPS * OPENED_MPS
    now.doubt_s = 0.0
    return True


@inner_kernel
def take_move(memory: Memory) -> None:
    """Note how far an opened update moved the place horizontally."""
    now, square_m2 = memory.now[0], 0.0
    for axis in range(2):
        moved_m = 0.0
        for i in range(3):
            moved_m += memory.level[axis, i] * (memory.state[i] - memory.predicted[i])
        square_m2 += moved_m * moved_m
    moved_m = np.sqrt(square_m2)
    if moved_m > RESETTLED_M:
        now.started_s = now.t_s
    if moved_m > TOLD_M and moved_m > covered_m(memory):
        now.moved_m, now.moved_s = moved_m, now.t_s


@inner_kernel
def take_drag(memory: Memory, dt_s: float) -> None:
    """Sum up by how much the pseudoranges move the place against its motion, east and north."""
    now, east_m, north_m = memory.now[0], 0.0, 0.0
    told = now.drag_east_m**2 + now.drag_north_m**2 > TOLD_M * TOLD_M
    fade = np.exp(-dt_s / (DRAG_HELD_S if told else DRAG_S))
    if now.t_s - now.began_s > SETTLED_S and now.t_s - now.determined_s < BRIDGED_S:
        for i in range(3):
            moved_m = memory.state[i] - memory.predicted[i]
            east_m += memory.level[0, i] * moved_m
            north_m += memory.level[1, i] * moved_m
    now.drag_east_m = now.drag_east_m * fade + east_m
    now.drag_north_m = now.drag_north_m * fade + north_m
    drag_m = np.sqrt(now.drag_east_m**2 + now.drag_north_m**2)
    if drag_m > TOLD_M and drag_m > covered_m(memory):
        now.moved_m, now.moved_s = drag_m, now.t_s


@inner_kernel
def covered_m(memory: Memory) -> float:
    """What is left of a move to be covered by the bound."""
    now = memory.now[0]
    age_s = now.t_s - now.moved_s
    return float(now.moved_m * np.exp(-age_s / COVERED_S)) if now.moved_m > 0.0 else 0.0


@inner_kernel
def take_doubt(rows: Records, memory: Memory, dt_s: float) -> int:
    """Count for how long most of the information has contradicted the state; gives the consistent rows.

    Rows far beyond their standard deviation become INCONSISTENT.
    """
    now, against, whole, count = memory.now[0], 0.0, 0.0, 0
    for row in rows:
        if row.rejection != _USABLE:
            continue
        square = row.residual_m * row.residual_m / row.variance_m2
        whole += 1.0 / row.variance_m2
        against += 1.0 / row.variance_m2 if square > DOUBTFUL_SQUARE else 0.0
        if square > INCONSISTENT_SQUARE:
            row.rejection = _INCONSISTENT
        else:
            count += 1
    now.doubt_s = now.doubt_s + dt_s if against > 0.5 * whole else max(now.doubt_s - 2.0 * dt_s, 0.0)
    return count
