"""The curve that explains a passage best: transition, arc, transition fitted to averaged curvature.

Gauss-Newton with damping over the four places, the curvature and the gyro's bias; the average over the moving
window is part of the model, so the fitted places are those of the track, whatever the speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.landmark_matching.curve_shape import CurveShape, mean_curvature

Floats = NDArray[np.float64]

ROUNDS: Final = 25
STEPS: Final = np.array([0.5, 0.5, 0.5, 0.5, 1e-5, 1e-5])
"""For the derivatives: metres, 1/m, rad/s."""
SHORTEST_M: Final = 1.0
"""Of transitions and arc."""


@dataclass(frozen=True, slots=True)
class CurveFit:
    """A fitted curve; places are distances of the odometry."""

    shape: CurveShape
    bias_radps: float
    residual_per_m: float
    """Root mean square."""


def _shape(p: Floats) -> CurveShape:
    start = float(p[0])
    arc_start = max(float(p[1]), start + SHORTEST_M)
    arc_end = max(float(p[2]), arc_start + SHORTEST_M)
    return CurveShape(start, arc_start, arc_end, max(float(p[3]), arc_end + SHORTEST_M), float(p[4]))


def _model(p: Floats, distance_m: Floats, window_m: Floats, speed_mps: Floats) -> Floats:
    return np.asarray(mean_curvature(_shape(p), distance_m, window_m) + p[5] / speed_mps)


def fit_curve(
    first: CurveShape, distance_m: Floats, curvature_per_m: Floats, window_m: Floats, speed_mps: Floats
) -> CurveFit | None:
    """Best curve from a first guess; columns of shape (n,). None where it does not converge to a curve."""
    speed = np.maximum(speed_mps, 0.1)
    p = np.array([first.start_m, first.arc_start_m, first.arc_end_m, first.end_m, first.curvature_per_m, 0.0])
    residual = curvature_per_m - _model(p, distance_m, window_m, speed)
    damping = 1e-3
    for _ in range(ROUNDS):
        slopes = np.empty((len(residual), len(p)))
        for k, step in enumerate(STEPS):
            there = p.copy()
            there[k] += step
            slopes[:, k] = (_model(there, distance_m, window_m, speed) - curvature_per_m + residual) / step
        normal = slopes.T @ slopes
        normal[np.diag_indices(6)] *= 1.0 + damping
        normal[np.diag_indices(6)] += 1e-18
        move = np.linalg.solve(normal, slopes.T @ residual)
        trial = p + move
        after = curvature_per_m - _model(trial, distance_m, window_m, speed)
        if after @ after <= residual @ residual:
            p, residual, damping = trial, after, damping * 0.3
            if np.all(np.abs(move[:4]) < 1e-3):  # noqa: PLR2004 - a millimetre
                break
        else:
            damping *= 10.0
    shape = _shape(p)
    if not math.isfinite(float(p.sum())) or shape.curvature_per_m * first.curvature_per_m <= 0.0:
        return None
    return CurveFit(shape, float(p[5]), math.sqrt(float(residual @ residual) / len(residual)))
