"""A run as messages of the bus, with a position that knows its place only roughly."""

from __future__ import annotations

import math
from collections.abc import Sequence

from schemas.line import Direction
from schemas.motion import Odometry
from schemas.position import TrainPosition
from services.landmark_matching.curve_shape import direction_sign
from services.landmark_matching.reading import Reading

T0_NS = 1_800_000_000_000_000_000


def time_ns(t_s: float) -> int:
    return T0_NS + round(t_s * 1e9)


def odometry_of(reading: Reading, *, sense: float = 1.0, origin: str = "o1") -> Odometry:
    """`sense` -1: the sensor looks towards the end that does not lead."""
    known = not math.isnan(reading.curvature_per_m)
    return Odometry(
        t_ns=time_ns(reading.t_s),
        method="fused",
        origin=origin,
        distance_m=sense * reading.distance_m,
        way_m=abs(reading.distance_m),
        speed_mps=sense * reading.speed_mps,
        speed_bound_mps=0.3,
        slip=1 if reading.slip else 0,
        bound_m=2.0,
        share_bound=0.02,
        excess_m=0.0,
        status="valid",
        curvature_per_m=sense * reading.curvature_per_m if known else None,
        curvature_distance_m=sense * reading.curvature_distance_m if known else None,
    )


def position_of(
    reading: Reading, axis_m: float, direction: Direction, *, margin_m: float = 30.0, **changes: object
) -> TrainPosition:
    plain = {
        "t_ns": time_ns(reading.t_s),
        "status": "valid",
        "reason": "",
        "branch": "",
        "axis_m": axis_m,
        "direction": direction,
        "speed_mps": reading.speed_mps,
        "bound_ahead_m": margin_m,
        "bound_behind_m": margin_m,
        "line_version": "2026-1",
    }
    return TrainPosition(**(plain | changes))  # type: ignore[arg-type]  # the names are those of the fields


def both_of(
    readings: Sequence[Reading], axis_m: Sequence[float], direction: Direction, *, error_m: float = 12.0
) -> list[Odometry | TrainPosition]:
    """Odometry at 10 Hz, a position wrong by `error_m` along the way once a second."""
    sent: list[Odometry | TrainPosition] = []
    for k, (reading, place) in enumerate(zip(readings, axis_m, strict=True)):
        sent.append(odometry_of(reading))
        if k % 10 == 5:
            sent.append(position_of(reading, float(place) + direction_sign(direction) * error_m, direction))
    return sent
