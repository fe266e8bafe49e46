"""Closed-form runs over the demo line."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.landmark_passes import STEP_S, Pass, readings_of
from schemas.line import Direction, Line
from services.landmark_matching.curve_shape import direction_sign, shape_of_curve
from services.landmark_matching.line_landmarks import LineLandmarks, line_landmarks
from services.landmark_matching.reading import Reading
from services.line.alignment import alignment_of
from services.line.built_in_file import built_in_line

Floats = NDArray[np.float64]


def demo_line() -> Line:
    return built_in_line("demo")


@cache
def demo_landmarks() -> LineLandmarks:
    return line_landmarks(demo_line())


def demo_run(
    direction: Direction,
    begin_axis_m: float,
    end_axis_m: float,
    *,
    branch: str = "",
    speed_mps: float = 16.0,
    wheel_scale: float = 1.004,
    seed: int = 1,
) -> tuple[list[Reading], Floats]:
    """Readings, and the true `axis_m` every STEP_S."""
    sign = direction_sign(direction)
    curves = [shape_of_curve(curve, direction) for curve in alignment_of(demo_line(), branch).curves]
    ends = sorted((sign * begin_axis_m, sign * end_axis_m))
    run = Pass(
        curves,
        ends[0],
        ends[1],
        speed_mps=speed_mps,
        wheel_scale=wheel_scale,
        bias_radps=float(np.radians(0.03)),
        generator=np.random.default_rng(seed),
    )
    readings, u_m = readings_of(run)
    return readings, sign * u_m


def true_axis(t_s: float, axis_m: Floats) -> float:
    return float(np.interp(t_s, STEP_S * np.arange(len(axis_m)), axis_m))
