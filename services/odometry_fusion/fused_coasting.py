"""Dead reckoning without the wheel: how far distance has gone wrong some seconds after the last pulse.

Measures the inertial half of the fused mode on drives that know no slip: the filter runs with everything, and from
start points all along the run a copy of it goes on without pulses.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Final

import numpy as np

from services.odometry_fusion.fused_odometry import FusedOdometry
from services.odometry_fusion.motion_log import Floats, MotionLog

LEAST_MPS: Final = 0.5
"""Slower, the train stands."""
NONE_T_S: Final = np.empty(0)
NONE_PULSES: Final = np.empty(0, np.int64)


def coast_errors(
    log: MotionLog,
    begin: Callable[[], FusedOdometry],
    true_t_s: Floats,
    true_m: Floats,
    horizon_s: float = 10.0,
    every_s: float = 1.0,
    settle_s: float = 15.0,
) -> Floats:
    """Errors [m] of the way over `horizon_s` from starts every `every_s`, the first after `settle_s`; shape (n,).

    The error is that of the inertial way from the start to the end of the horizon; the wheel's pulses serve
    until the start. Starts are left out where the truth does not reach, or where the train stands: without pulses
    it is taken to go on standing.
    """
    running = begin()
    first_s = float(log.tacho_t_s[0])
    last_s = min(float(log.imu_t_s[-1]), float(true_t_s[-1])) - horizon_s
    starts_s = np.arange(max(first_s + settle_s, float(true_t_s[0])), last_s, every_s)
    found, done_s = [], -np.inf
    for start_s in starts_s:
        imu = (log.imu_t_s > done_s) & (log.imu_t_s <= start_s)
        tacho = (log.tacho_t_s > done_s) & (log.tacho_t_s <= start_s)
        rows = running.advance(float(start_s), log.imu_t_s[imu], log.imu[imu], log.tacho_t_s[tacho], log.pulses[tacho])
        done_s = float(start_s)
        if not len(rows) or abs(float(rows.speed_mps[-1])) < LEAST_MPS:
            continue
        ahead = (log.imu_t_s > start_s) & (log.imu_t_s <= start_s + horizon_s)
        blind = deepcopy(running).advance(
            float(start_s + horizon_s), log.imu_t_s[ahead], log.imu[ahead], NONE_T_S, NONE_PULSES
        )
        if len(blind):
            between_s = float(blind.t_s[-1] - rows.t_s[-1])
            true_between_m = np.interp(blind.t_s[-1], true_t_s, true_m) - np.interp(rows.t_s[-1], true_t_s, true_m)
            way_m = float(blind.distance_m[-1] - rows.distance_m[-1])
            found.append((way_m - float(true_between_m)) * horizon_s / between_s)
    return np.array(found)
