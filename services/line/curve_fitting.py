"""Straight, clothoid and arc fitted to an axis's vertices, with what each figure is worth.

A curve is a trapezoid of curvature. Neighbouring curves are fitted together over a window that reaches
into the straights about them: the trapezoids are integrated to a heading and a place, and least squares
(Levenberg-Marquardt) makes the distances across it small. Where vertices do not tell how long a
transition is, a weak belief decides (TRANSITION_M ± TRANSITION_SIGMA_M).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.line.curve_finding import SHORTEST_ARC_M, TRANSITION_M, Bend, bends_of
from services.line.smoothing import SmoothAxis

Floats = NDArray[np.float64]

TRANSITION_SIGMA_M: Final = 30.0
LEAST_NOISE_M: Final = 0.02
"""No vertices are better than this: rails are kept to about a centimetre."""
TOGETHER_M: Final = 80.0
"""Curves with less straight than this between them are fitted together."""
MOST_TOGETHER: Final = 6
REACH_M: Final = 120.0
"""The window reaches this far into the straights on both sides, if they are so long."""
STEP_M: Final = 2.0
"""Of the integration: a tenth of a millimetre off over 300 m."""
ROUNDS: Final = 25
DONE: Final = 1e-4
"""Relative gain below which fitting ends."""
PER_BEND: Final = 5
FOOT_ROUNDS: Final = 3
MOST_DAMPING: Final = 1e8
POSE_SIGMA_M: Final = 5.0
POSE_SIGMA_RAD: Final = 0.05
PLACE_SIGMA_M: Final = 60.0
CURVATURE_SIGMA_SHARE: Final = 0.5
"""How far the first guess may be out; wide, so that vertices decide wherever they can."""
LEAST_CERTAINTY: Final = 2.0
"""A curve whose radius is not known to half of itself is left out."""
LEAST_SHARE: Final = 0.05


@dataclass(frozen=True, slots=True)
class FittedCurve:
    """A curve with the standard deviations that follow from the vertices' noise."""

    bend: Bend
    radius_m: float
    """Positive to the left."""
    radius_sigma_m: float
    start_sigma_m: float
    end_sigma_m: float
    residual_m: float
    """Root mean square of the vertices' distances across the fitted curve and its straights."""


def fit_curves(axis: SmoothAxis) -> tuple[FittedCurve, ...]:
    """Curves of an axis, in order along it."""
    groups = _groups(bends_of(axis))
    fitted: list[FittedCurve] = []
    for number, group in enumerate(groups):
        before_m = groups[number - 1][-1].end_m if number else 0.0
        after_m = groups[number + 1][0].start_m if number + 1 < len(groups) else float(axis.along_m[-1])
        first_m = max(group[0].start_m - REACH_M, (before_m + group[0].start_m) / 2.0, 0.0)
        last_m = min(group[-1].end_m + REACH_M, (after_m + group[-1].end_m) / 2.0, float(axis.along_m[-1]))
        fitted += _Window(axis, group, first_m, last_m).fit()
    return _apart([one for one in fitted if _is_certain(one)])


def _is_certain(curve: FittedCurve) -> bool:
    """Whether the vertices show it: radius and places known well enough to be told from a wobble."""
    long_m = curve.bend.end_m - curve.bend.start_m
    return (
        abs(curve.radius_m) > LEAST_CERTAINTY * curve.radius_sigma_m
        and max(curve.start_sigma_m, curve.end_sigma_m) < long_m
    )


def _groups(bends: Sequence[Bend]) -> list[list[Bend]]:
    """Neighbours that share their straights."""
    groups: list[list[Bend]] = []
    for bend in bends:
        near = groups and bend.start_m - groups[-1][-1].end_m < TOGETHER_M
        if near and len(groups[-1]) < MOST_TOGETHER:
            groups[-1].append(bend)
        else:
            groups.append([bend])
    return groups


class _Window:
    """A stretch of axis with the curves on it, and what is believed of them before looking closely.

    Parameters: place (2) and heading at the window's start, relative to the smoothed axis; then for each
    curve the middle of its first transition, that transition's length, the same of the last one, and
    the arc's curvature over the guessed one.
    """

    def __init__(self, axis: SmoothAxis, bends: list[Bend], first_m: float, last_m: float) -> None:
        """Over `first_m` to `last_m` of the axis."""
        inside = (axis.points_along_m >= first_m) & (axis.points_along_m <= last_m)
        self._points, self._along = axis.points_m[inside], axis.points_along_m[inside]
        self._bends, self._first_m = bends, first_m
        self._grid = np.linspace(first_m, last_m, max(math.ceil((last_m - first_m) / STEP_M) + 1, 3))
        self._start, self._heading = _pose(axis, first_m)
        self._noise_m = max(axis.noise_m, LEAST_NOISE_M)
        guess, sigma = [0.0, 0.0, 0.0], [POSE_SIGMA_M, POSE_SIGMA_M, POSE_SIGMA_RAD]
        for bend in bends:
            guess += [bend.start_m + bend.transition_in_m / 2.0, TRANSITION_M]
            guess += [bend.end_m - bend.transition_out_m / 2.0, TRANSITION_M, 1.0]
            sigma += [PLACE_SIGMA_M, TRANSITION_SIGMA_M, PLACE_SIGMA_M, TRANSITION_SIGMA_M, CURVATURE_SIGMA_SHARE]
        self._guess, self._sigma = np.array(guess), np.array(sigma)

    def fit(self) -> list[FittedCurve]:
        """Levenberg-Marquardt from the guess on."""
        state, damping = self._guess.copy(), 1e-3
        left, slopes = self._residuals(state), self._slopes(state)
        cost = float(left @ left)
        for _ in range(ROUNDS):
            normal = slopes.T @ slopes
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -slopes.T @ left)
            tried = self._residuals(state + step)
            if float(tried @ tried) >= cost:
                damping *= 8.0
                if damping > MOST_DAMPING:
                    break
                continue
            gain = cost - float(tried @ tried)
            state, left, cost, damping = state + step, tried, cost - gain, damping / 4.0
            slopes = self._slopes(state)
            if gain < DONE * cost:
                break
        across = left[: len(self._points)] * self._noise_m
        rms_m = math.sqrt(float(across @ across) / max(len(across), 1))
        spread = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes))) * max(1.0, rms_m / self._noise_m)
        return [self._curve(state, spread, number, rms_m) for number in range(len(self._bends))]

    def _curve(self, state: Floats, spread: Floats, number: int, rms_m: float) -> FittedCurve:
        """One curve of the solution."""
        bend = _bend(self._figures(state)[number], self._bends[number].curvature_per_m)
        first = 3 + PER_BEND * number
        radius_m = 1.0 / bend.curvature_per_m
        return FittedCurve(
            bend=bend,
            radius_m=radius_m,
            radius_sigma_m=float(abs(radius_m) * spread[first + 4] / abs(state[first + 4])),
            start_sigma_m=float(spread[first]),
            end_sigma_m=float(spread[first + 2]),
            residual_m=rms_m,
        )

    def _figures(self, state: Floats) -> Floats:
        """Parameters (k, 5) of the curves."""
        return state[3:].reshape(-1, PER_BEND)

    def _residuals(self, state: Floats) -> Floats:
        """Distances across over their noise, then distances from the belief over its."""
        curvature = np.zeros(len(self._grid))
        for figures, guess in zip(self._figures(state), self._bends, strict=True):
            bend = _bend(figures, guess.curvature_per_m)
            knots = [bend.start_m, bend.start_m + bend.transition_in_m, bend.end_m - bend.transition_out_m, bend.end_m]
            height = bend.curvature_per_m
            curvature += np.interp(self._grid, knots, [0.0, height, height, 0.0])
        step_m = self._grid[1] - self._grid[0]
        heading = self._heading + state[2] + _summed(curvature, step_m)
        east = self._start[0] + state[0] + _summed(np.cos(heading), step_m)
        north = self._start[1] + state[1] + _summed(np.sin(heading), step_m)
        along = self._along
        for _ in range(FOOT_ROUNDS):
            at = np.interp(along, self._grid, heading)
            gap_e = self._points[:, 0] - np.interp(along, self._grid, east)
            gap_n = self._points[:, 1] - np.interp(along, self._grid, north)
            along = np.clip(along + gap_e * np.cos(at) + gap_n * np.sin(at), self._grid[0], self._grid[-1])
        across = gap_n * np.cos(at) - gap_e * np.sin(at)
        return np.concatenate([across / self._noise_m, (state - self._guess) / self._sigma])

    def _slopes(self, state: Floats) -> Floats:
        """Jacobian (residuals, parameters) by central differences."""
        columns = []
        for k, sigma in enumerate(self._sigma):
            shift = np.zeros(len(state))
            shift[k] = 1e-3 * sigma
            columns.append((self._residuals(state + shift) - self._residuals(state - shift)) / (2.0 * shift[k]))
        return np.stack(columns, axis=1)


def _bend(figures: Floats, guessed_per_m: float) -> Bend:
    """Parameters as a curve: transitions no shorter than nothing, and with room for an arc between them."""
    first_m, transition_in_m, last_m, transition_out_m, share = (float(one) for one in figures)
    transition_in_m, transition_out_m = max(transition_in_m, 0.0), max(transition_out_m, 0.0)
    last_m = max(last_m, first_m + SHORTEST_ARC_M)
    room_m = last_m - first_m - SHORTEST_ARC_M
    shrink = min(1.0, room_m / max((transition_in_m + transition_out_m) / 2.0, 1e-9))
    return Bend(
        first_m - shrink * transition_in_m / 2.0,
        last_m + shrink * transition_out_m / 2.0,
        shrink * transition_in_m,
        shrink * transition_out_m,
        guessed_per_m * max(share, LEAST_SHARE),
    )


def _summed(values: Floats, step_m: float) -> Floats:
    """Integral from the first grid point on, by trapezoids."""
    return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) * (step_m / 2.0))])


def _pose(axis: SmoothAxis, along_m: float) -> tuple[Floats, float]:
    """Place (2,) and heading (anticlockwise from east) of the smoothed axis."""
    place = [float(np.interp(along_m, axis.along_m, axis.plane_m[:, k])) for k in range(2)]
    i = int(np.clip(np.searchsorted(axis.along_m, along_m) - 1, 0, len(axis.along_m) - 2))
    step = axis.plane_m[i + 1] - axis.plane_m[i]
    return np.array(place), math.atan2(step[1], step[0])


def _apart(curves: list[FittedCurve]) -> tuple[FittedCurve, ...]:
    """Overlaps of neighbours divided between them, at the cost of their transitions."""
    for k in range(len(curves) - 1):
        before, after = curves[k].bend, curves[k + 1].bend
        over_m = before.end_m - after.start_m
        if over_m <= 0.0:
            continue
        share = before.transition_out_m / max(before.transition_out_m + after.transition_in_m, 1e-9)
        meet_m = before.end_m - over_m * share
        give_m, take_m = before.end_m - meet_m, meet_m - after.start_m
        curves[k] = replace(
            curves[k],
            bend=replace(before, end_m=meet_m, transition_out_m=max(before.transition_out_m - give_m, 0.0)),
        )
        curves[k + 1] = replace(
            curves[k + 1],
            bend=replace(after, start_m=meet_m, transition_in_m=max(after.transition_in_m - take_m, 0.0)),
        )
    return tuple(curves)
