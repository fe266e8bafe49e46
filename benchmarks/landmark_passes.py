"""Passes of a train over curves, in closed form: what averaged yaw rate and wheel speed read at 10 Hz.

Heading is the integral of clothoids and arcs, exactly; the simulator has no part in it, so that the
matching is not measured against its own physics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.line import Landmark
from services.landmark_matching.anchor import Anchor
from services.landmark_matching.curve_shape import CurveShape, angle_rad
from services.landmark_matching.reading import Reading

Floats = NDArray[np.float64]
STEP_S = 0.1
WINDOW_STEPS = 20
YAW_NOISE_RADPS = np.radians(0.1)
"""Of one step, white: a car body on rough track, ten times the sensor's own."""


@dataclass(frozen=True, slots=True)
class Pass:
    """One train over one stretch of track."""

    curves: Sequence[CurveShape]
    start_m: float
    end_m: float
    speed_mps: float = 15.0
    acceleration_mps2: float = 0.0
    wheel_scale: float = 1.0
    """Measured over true way."""
    yaw_scale: float = 1.0
    bias_radps: float = 0.0
    noise_radps: float = YAW_NOISE_RADPS
    wheel_between: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """From place, to place: wheel turns this much too fast, and nobody notices."""
    wheel_grows_m: float = 0.0
    """Way in which it comes to turn too fast, and back."""
    slip_between: tuple[float, float] | None = None
    turn_back_at_m: float | None = None
    generator: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))


def _motion(one: Pass) -> tuple[Floats, Floats]:
    """Places and speeds every STEP_S."""
    places, speeds = [one.start_m], [one.speed_mps]
    while one.start_m <= places[-1] <= one.end_m and len(places) < 20_000:  # noqa: PLR2004 - half an hour
        back = one.turn_back_at_m is not None and (places[-1] >= one.turn_back_at_m or speeds[-1] < one.speed_mps)
        acceleration = -0.8 if back else one.acceleration_mps2
        speeds.append(
            max(speeds[-1] + acceleration * STEP_S, -8.0) if back else max(speeds[-1] + acceleration * STEP_S, 0.8)
        )
        places.append(places[-1] + 0.5 * (speeds[-1] + speeds[-2]) * STEP_S)
    return np.array(places), np.array(speeds)


def readings_of(one: Pass) -> tuple[list[Reading], Floats]:
    """Readings every 0.1 s, and the true place at each."""
    u, _ = _motion(one)
    heading = np.zeros_like(u)
    for shape in one.curves:
        heading = heading + angle_rad(shape, u)
    fast_from, fast_to, fast = one.wheel_between
    # Share of each step's way that lies in the stretch, however short that is.
    inside_m = np.minimum(u[1:], fast_to) - np.maximum(u[:-1], fast_from)
    grown = np.clip(inside_m / np.maximum(u[1:] - u[:-1], 1e-9), 0.0, 1.0)
    if one.wheel_grows_m:
        middle = 0.5 * (u[1:] + u[:-1])
        grown = np.clip(np.minimum(middle - fast_from, fast_to - middle) / one.wheel_grows_m, 0.0, 1.0)
    ratio = one.wheel_scale * (1.0 + (fast - 1.0) * grown)
    distance = np.concatenate([[0.0], np.cumsum(np.diff(u) * ratio)])
    yaw = np.diff(heading) / STEP_S * one.yaw_scale + one.bias_radps
    yaw = yaw + one.generator.normal(0.0, one.noise_radps, len(yaw))
    turned = np.concatenate([[0.0], np.cumsum(yaw * STEP_S)])
    area = np.concatenate([[0.0], np.cumsum(0.5 * (distance[1:] + distance[:-1]))])
    found = []
    for k in range(len(u)):
        t_s = k * STEP_S
        speed = float(distance[k] - distance[max(k - 1, 0)]) / STEP_S
        curvature = mean_m = float("nan")
        if k >= WINDOW_STEPS:
            way = distance[k] - distance[k - WINDOW_STEPS]
            mean_m = float(area[k] - area[k - WINDOW_STEPS]) / WINDOW_STEPS
            if abs(way) > 0.5:  # noqa: PLR2004 - metres in two seconds: standing
                curvature = float(turned[k] - turned[k - WINDOW_STEPS]) / way
        slip = one.slip_between is not None and one.slip_between[0] <= u[k] <= one.slip_between[1]
        found.append(Reading(t_s, float(distance[k]), speed, curvature, mean_m, slip, healthy=True))
    return found, u


def shape_with(landmark: CurveShape, *, curvature: float = 1.0, arc: float = 1.0, shift_m: float = 0.0) -> CurveShape:
    """The curve with another curvature, another length of its arc, or at another place."""
    longer_m = (arc - 1.0) * (landmark.arc_end_m - landmark.arc_start_m)
    return CurveShape(
        landmark.start_m + shift_m,
        landmark.arc_start_m + shift_m,
        landmark.arc_end_m + longer_m + shift_m,
        landmark.end_m + longer_m + shift_m,
        landmark.curvature_per_m * curvature,
    )


def landmark_like(
    *,
    radius_m: float,
    arc_m: float,
    transition_m: float,
    hand: str = "left",
    begin_m: float = 1000.0,
    accuracy_m: float = 3.0,
) -> Landmark:
    """Rows of a curve in direction `up` that begins at `begin_m`."""
    end_m = begin_m + 2.0 * transition_m + arc_m
    return Landmark(
        id="C1-up",
        direction="up",
        hand="left" if hand == "left" else "right",
        radius_m=radius_m,
        entry_straight_start_m=begin_m - 20.0,
        entry_straight_end_m=begin_m,
        entry_lower_limit_m=begin_m + 0.8 * transition_m,
        exit_lower_limit_m=end_m - 0.8 * transition_m,
        exit_straight_start_m=end_m,
        exit_straight_end_m=end_m + 20.0,
        accuracy_m=accuracy_m,
    )


def anchor_at(u_m: float, *, error_m: float, margin_m: float, branch: str = "") -> Anchor:
    """What is held at distance 0 of a pass that begins at `u_m`: wrong by `error_m`, bounded by `margin_m`."""
    return Anchor(branch=branch, direction="up", u_m=u_m + error_m, distance_m=0.0, ahead_m=margin_m, behind_m=margin_m)


def moved_rows(landmark: Landmark, by_m: float, name: str) -> Landmark:
    """The same landmark elsewhere on the line, under another name."""
    places = {
        field: getattr(landmark, field) + by_m
        for field in (
            "entry_straight_start_m",
            "entry_straight_end_m",
            "entry_lower_limit_m",
            "exit_lower_limit_m",
            "exit_straight_start_m",
            "exit_straight_end_m",
        )
    }
    return msgspec.structs.replace(landmark, id=name, **places)
