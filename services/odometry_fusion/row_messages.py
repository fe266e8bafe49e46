"""Rows of odometry as messages."""

from __future__ import annotations

import math

from schemas.motion import Odometry, OdometryMethod, SlipEpisode
from services.odometry_fusion.motion_log import STATUSES, Episode, MotionRows


def _known(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def odometry_of(rows: MotionRows, at: int, base_ns: int, method: OdometryMethod, origin: str) -> Odometry:
    """One row as a message; `base_ns` is the time of the rows' zero."""
    return Odometry(
        t_ns=base_ns + round(float(rows.t_s[at]) * 1e9),
        method=method,
        origin=origin,
        distance_m=float(rows.distance_m[at]),
        way_m=float(rows.way_m[at]),
        speed_mps=float(rows.speed_mps[at]),
        speed_bound_mps=float(rows.speed_bound_mps[at]),
        acceleration_mps2=_known(rows.acceleration_mps2[at]),
        slip=-1 if rows.slip[at] < 0 else 1 if rows.slip[at] > 0 else 0,
        standstill=bool(rows.standstill[at]),
        bound_m=float(rows.bound_m[at]),
        share_bound=rows.share_bound,
        excess_m=float(rows.excess_m[at]),
        provisional_m=float(rows.provisional_m[at]),
        status=STATUSES[rows.status[at]],
        reason=rows.reasons[rows.reason[at]],
        curvature_per_m=_known(rows.curvature_per_m[at]),
        curvature_sigma_per_m=_known(rows.curvature_sigma_per_m[at]),
        curvature_distance_m=_known(rows.curvature_distance_m[at]),
        gradient_permille=_known(rows.gradient_permille[at]),
        wheel_scale=_known(rows.wheel_scale[at]),
        gyro_bias_radps=_known(rows.gyro_bias_radps[at]),
        since_standstill_s=_known(rows.since_standstill_s[at]),
        sensor_delay_s=rows.sensor_delay_s,
    )


def episode_of(episode: Episode, base_ns: int, origin: str) -> SlipEpisode:
    """An episode as a message."""
    return SlipEpisode(
        t_ns=base_ns + round(episode.t_s * 1e9),
        origin=origin,
        episode=episode.number,
        phase=episode.phase,
        slip=episode.slip,
        start_t_ns=base_ns + round(episode.start_t_s * 1e9),
        correction_s=episode.correction_s,
        corrected_m=episode.corrected_m,
        bound_m=episode.bound_m,
        stop_demanded=episode.stop_demanded,
        reason=episode.reason,
    )
