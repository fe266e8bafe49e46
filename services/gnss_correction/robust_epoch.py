"""One epoch of the robust filter: from the state before it to the state after it, and a start from nothing."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.position_fit import geodetic
from services.gnss_correction.rejection import Outcome, Rejection
from services.gnss_correction.robust_bound import respond, take_excess
from services.gnss_correction.robust_doubt import open_when_doubtful, take_doubt, take_drag, take_move
from services.gnss_correction.robust_noise import FREEDOM, USUAL_STRONGEST_DBHZ, urban_code_variance_m2
from services.gnss_correction.robust_prediction import predict, recentre
from services.gnss_correction.robust_state import CLOCK, DRIFT, SIZE, VELOCITY, Memory
from services.gnss_correction.robust_update import model, update
from services.gnss_correction.solver_arrays import MOST_SYSTEMS, Records
from services.numerics.geodesy import ecef_from_geodetic
from services.numerics.kernel import inner_kernel

START_M: Final = 100.0
START_MPS: Final = 20.0
START_DRIFT_MPS: Final = 1_000.0
START_SIGMAS: Final = 3.0
"""How far a first solution may be off, and by how many of its own standard deviations more."""
COASTING_S: Final = 10.0
"""For so long fewer satellites than determine a place may help the motion along to a fix."""
BLIND_S: Final = 1.5
BLIND_SHARE: Final = 2.5
"""Acceleration of a vehicle that nobody observes any more: it brakes or starts for as long as it likes."""
STRONGEST_HELD_S: Final = 300.0
MOST_COST: Final = 6.0
"""Of one pseudorange: a satellite may be faulty with a probability of some per mille, whatever the figure."""
COMPARED_M: Final = 5.0
"""Added to the standard deviations when filters are compared: no fault is found by less."""

_ecef = inner_kernel(ecef_from_geodetic)
_USABLE, _LOW = int(Rejection.USABLE), int(Rejection.BELOW_MASK)
_WEAK, _ALONE, _CONTRADICTS = (
    int(Rejection.WEAK_SIGNAL),
    int(Rejection.ALONE_IN_SYSTEM),
    int(Rejection.CONTRADICTS),
)
_FIX, _PREDICTED = int(Outcome.FIX), int(Outcome.PREDICTED)
_INCONSISTENT = int(Rejection.INCONSISTENT)
_ENOUGH = 3
"""Satellites beyond one per constellation that determine a place."""


@inner_kernel
def start(memory: Memory, first: Any, t_s: float) -> None:  # noqa: ANN401 - numba record
    """Begin from the solution of one epoch."""
    now = memory.now[0]
    place = _ecef(first.lat_rad, first.lon_rad, first.h_m)
    memory.state[:] = 0.0
    memory.covariance[:, :] = 0.0
    memory.response[:, :] = 0.0
    memory.responding[:] = 0
    memory.clock_known[:] = 0
    memory.excluded[:] = 0
    spread_m = START_M + START_SIGMAS * first.sigma_horizontal_m
    for i in range(3):
        memory.state[i] = place[i]
        memory.covariance[i, i] = spread_m * spread_m
        memory.covariance[VELOCITY + i, VELOCITY + i] = START_MPS * START_MPS
    memory.covariance[DRIFT, DRIFT] = START_DRIFT_MPS * START_DRIFT_MPS
    for i in range(CLOCK, SIZE):
        memory.covariance[i, i] = START_M * START_M
    now.started, now.t_s, now.began_s, now.started_s, now.determined_s = 1, t_s, t_s, t_s, t_s
    now.doubt_s, now.moved_m, now.excess, now.bound_m, now.bound_s = 0.0, 0.0, 1.0, np.inf, t_s
    now.cost, now.mean_cost, now.cost_weight = 0.0, 0.0, 0.0
    now.drag_east_m, now.drag_north_m = 0.0, 0.0
    if now.strongest_dbhz == 0.0:
        now.strongest_dbhz = USUAL_STRONGEST_DBHZ


@inner_kernel
def look_around(memory: Memory) -> tuple[float, float, float]:
    """Latitude, longitude and height of the state; east, north and up into `memory.level`."""
    lat_rad, lon_rad, h_m = geodetic(memory.state[0], memory.state[1], memory.state[2])
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat_rad), np.cos(lat_rad), np.sin(lon_rad), np.cos(lon_rad)
    level = memory.level
    level[0, 0], level[0, 1], level[0, 2] = -sin_lon, cos_lon, 0.0
    level[1, 0], level[1, 1], level[1, 2] = -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat
    level[2, 0], level[2, 1], level[2, 2] = cos_lat * cos_lon, cos_lat * sin_lon, sin_lat
    return lat_rad, lon_rad, h_m


@inner_kernel
def _hold_strongest(rows: Records, memory: Memory, dt_s: float) -> None:
    """Follow the strongest signals of the receiver: up at once, down slowly."""
    first_dbhz, second_dbhz, now = 0.0, 0.0, memory.now[0]
    for row in rows:
        if row.strength_dbhz > first_dbhz:
            first_dbhz, second_dbhz = row.strength_dbhz, first_dbhz
        elif row.strength_dbhz > second_dbhz:
            second_dbhz = row.strength_dbhz
    if second_dbhz > 0.0:
        share = 1.0 - np.exp(-dt_s / STRONGEST_HELD_S)
        gap_db = second_dbhz - now.strongest_dbhz
        now.strongest_dbhz += gap_db if gap_db > 0.0 else share * gap_db


@inner_kernel
def _admit(rows: Records, memory: Memory, rules: Any) -> tuple[int, int]:  # noqa: ANN401 - numba record
    """Usable rows, weighed, and how many they are beyond one per constellation."""
    count, systems = 0, 0
    for row in rows:
        if row.rejection in (_LOW, _WEAK, _ALONE, _CONTRADICTS):
            row.rejection = _USABLE
        if row.rejection == _USABLE and row.elevation_rad < rules.elevation_mask_rad:
            row.rejection = _LOW
        if row.rejection == _USABLE and row.strength_dbhz < rules.cn0_mask_dbhz:
            row.rejection = _WEAK
        row.variance_m2 = urban_code_variance_m2(row, memory.now[0].strongest_dbhz)
        if row.rejection == _USABLE:
            count += 1
            systems |= 1 << row.system
    spare = count
    for system in range(MOST_SYSTEMS):
        spare -= (systems >> system) & 1
    return count, spare


@inner_kernel
def _cost(square: float) -> float:
    """Cost of a squared normalised residual: Student's t, mixed with a fault that may have any size."""
    likelihood = (1.0 + square / FREEDOM) ** (-0.5 * (FREEDOM + 1.0))
    return float(-np.log(likelihood + np.exp(-MOST_COST)))


@inner_kernel
def _take_cost(rows: Records, memory: Memory) -> None:
    """Cost of an epoch's pseudoranges at the new state, and residuals of those left out."""
    now, cost = memory.now[0], 0.0
    for row in rows:
        if row.rejection == _INCONSISTENT:
            row.residual_m = row.pseudorange_m - row.modelled_m - memory.state[CLOCK + row.system]
        if row.rejection in (_USABLE, _INCONSISTENT) and memory.clock_known[row.system] == 1:
            cost += _cost(row.residual_m * row.residual_m / (row.variance_m2 + COMPARED_M * COMPARED_M))
    now.cost = cost


@inner_kernel
def measure(rows: Records, memory: Memory, dt_s: float, rules: Any, ours: Any) -> tuple[int, int]:  # noqa: ANN401 - numba records
    """Take an epoch at `now.t_s` in; gives the consistent rows and the outcome."""
    now = memory.now[0]
    tow_s = now.t_s
    level = look_around(memory)
    acceleration_mps2 = ours.acceleration_mps2
    if now.t_s - now.determined_s > BLIND_S or dt_s > BLIND_S:
        acceleration_mps2 *= BLIND_SHARE
    predict(memory, dt_s, acceleration_mps2)
    level = look_around(memory)
    model(rows, memory.state, level, tow_s, rules)
    _hold_strongest(rows, memory, dt_s)
    count, spare = _admit(rows, memory, rules)
    now.clock_step_m, now.cost = 0.0, now.mean_cost
    if count == 0:
        return 0, _PREDICTED
    recentre(rows, memory)
    opened = open_when_doubtful(memory)
    weighed_s = dt_s if now.t_s > now.started_s else 1.0
    if not update(rows, memory, tow_s, weighed_s, now.strongest_dbhz, rules):
        return 0, _PREDICTED
    if opened:
        take_move(memory)
    take_drag(memory, dt_s)
    respond(rows, memory)
    take_excess(rows, memory, dt_s)
    _take_cost(rows, memory)
    if spare >= _ENOUGH:
        now.determined_s = now.t_s
    known = now.t_s - now.determined_s <= COASTING_S
    return take_doubt(rows, memory, dt_s), _FIX if known else _PREDICTED
