"""What the robust filter remembers between epochs, and the layout of its state.

State: position [m] and velocity [m/s], Earth-fixed; drift of the receiver's clock [m/s]; one
receiver clock per constellation [m], in the order of `SYSTEMS`, so that the offsets between the
constellations' times are part of the state.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from services.gnss_correction.ephemeris_table import CODES
from services.gnss_correction.solver_arrays import MOST_SYSTEMS, SOLUTION, Float64s, Ints, Records
from services.numerics.kernel import inner_kernel

VELOCITY: Final = 3
DRIFT: Final = 6
CLOCK: Final = 7
SIZE: Final = CLOCK + MOST_SYSTEMS
"""First unknown of velocity, drift and clocks, and the number of unknowns."""
MOST_ROWS: Final = CODES
"""Satellites that an epoch may have."""

NOW: Final = np.dtype([
    ("started", np.int64),
    *(
        (name, np.float64)
        for name in (
            # time of the state, of its start from nothing, of when its place was last found anew, of the last epoch
            # whose satellites alone determine a place
            "t_s",
            "began_s",
            "started_s",
            "determined_s",
            # how long the pseudoranges have contradicted the state
            "doubt_s",
            # how far the place was moved against its own motion, and when
            "moved_m",
            "moved_s",
            # by how far pseudoranges have moved it lately against the velocity
            "drag_east_m",
            "drag_north_m",
            # by how much the residuals exceed their model, held and decaying
            "excess",
            # the strongest signals, held
            "strongest_dbhz",
            # bound and time of the last fix
            "bound_m",
            "bound_s",
            # step of the receiver's clock at this epoch beyond whole milliseconds
            "clock_step_m",
            # cost of the last epoch's pseudoranges at the state, and the mean over the past
            "cost",
            "mean_cost",
            # share of the averaging time for which there has been one
            "cost_weight",
            # horizontal error common to all satellites, as in robust_bound.py
            "common_m",
        )
    ),
])  # fmt: skip

FILTER_RULES: Final = np.dtype([(name, np.float64) for name in ("acceleration_mps2", "bound_factor", "watched")])
"""Settings of the filter: see `settings.Config`; `watched` 1: filters that each leave a satellite out run beside it."""

ROBUST_SOLUTION: Final = np.dtype(
    SOLUTION.descr + [(name, np.float64) for name in ("bound_m", "undetermined_s", "moved_m", "clock_step_m")]
)
"""Solution of one epoch by the filter: as SOLUTION, and

`bound_m` its horizontal bound; `undetermined_s` for how long there have not been satellites enough;
`moved_m` how far the place was moved lately against its own motion; `clock_step_m` a step of the
receiver's clock that is no whole millisecond; 0 where nothing is to be said.
"""


class Memory(NamedTuple):
    """The filter between epochs, and its working space; arrays, because kernels change them in place."""

    now: Records
    """Shape (1,), dtype NOW."""
    state: Float64s
    """Shape (SIZE,)."""
    covariance: Float64s
    """Shape (SIZE, SIZE), symmetric."""
    clock_known: Ints
    """Shape (MOST_SYSTEMS,): 1 for constellations seen so far."""
    response: Float64s
    """Shape (CODES, SIZE): error of the state by a satellite whose pseudoranges have always been late by one standard
    deviation."""
    responding: Ints
    """Shape (CODES,): 1 where there is such a response."""
    predicted: Float64s
    """The state before the epoch's measurements, and the inverse of its covariance."""
    information: Float64s
    normal: Float64s
    right: Float64s
    column: Float64s
    sample: Float64s
    weight: Float64s
    """Shape (MOST_ROWS,): weight of each pseudorange of the epoch [1/m²]."""
    excluded: Ints
    """Shape (CODES,): 1 for satellites that the filter leaves out."""
    level: Float64s
    """East, north and up at the place, in rows."""


def no_memory() -> Memory:
    """A filter that knows nothing."""
    return Memory(*(column[0] for column in no_memories(1)))


def no_memories(count: int) -> Memory:
    """Filters that know nothing, one in each row of arrays with a dimension more (few arguments compile quickly)."""
    return Memory(
        np.zeros((count, 1), NOW),
        np.zeros((count, SIZE)),
        np.zeros((count, SIZE, SIZE)),
        np.zeros((count, MOST_SYSTEMS), np.int64),
        np.zeros((count, CODES, SIZE)),
        np.zeros((count, CODES), np.int64),
        np.zeros((count, SIZE)),
        np.zeros((count, SIZE, SIZE)),
        np.zeros((count, SIZE, SIZE)),
        np.zeros((count, SIZE)),
        np.zeros((count, SIZE)),
        np.zeros((count, MOST_ROWS)),
        np.zeros((count, MOST_ROWS)),
        np.zeros((count, CODES), np.int64),
        np.zeros((count, 3, 3)),
    )


@inner_kernel
def memory_of(memories: Memory, i: int) -> Memory:
    """One of several filters."""
    return Memory(
        memories.now[i],
        memories.state[i],
        memories.covariance[i],
        memories.clock_known[i],
        memories.response[i],
        memories.responding[i],
        memories.predicted[i],
        memories.information[i],
        memories.normal[i],
        memories.right[i],
        memories.column[i],
        memories.sample[i],
        memories.weight[i],
        memories.excluded[i],
        memories.level[i],
    )
