"""Bayes filter over places on a 1 m grid: how well the curvature measured so far fits each place of each route.

Prediction shifts every route's probability by the way gone and spreads it by what odometry may be wrong;
correction weighs it with the curvature that an average over the window would read there. Neighbouring
averages share their samples, so each counts only with the share of its window that is new. The cost of a
difference saturates: one false reading rules nothing out for good.

A train may also run where no route is: that hypothesis explains straights as well as any route does, and pays
for every curve what a curve that fits by chance is worth (hand, radius, length and spacing, some seven nats).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.landmark_matching.curvature_route import STEP_M, Route
from services.numerics.kernel import kernel

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

SIGMA_PER_M: Final = 2e-4
"""Noise and bias of curvature, one standard deviation: 0.15 degrees per second at 13 m/s."""
SIGMA_SHARE: Final = 0.1
"""Further, as a share of the curvature: scales of gyro and wheel, the file's radii."""
LARGEST_COST: Final = 8.0
"""At which the cost of one difference saturates."""
SPREAD_M2_PER_M: Final = 0.04
"""Growth of variance with way gone: 2 m over 100 m, a wheel 2 % off."""
FLOOR: Final = 1e-12
ELSEWHERE_STRAIGHT: Final = 0.05
"""Cost per window of running elsewhere, on straights …"""
ELSEWHERE_CURVE: Final = 1.0
"""… and in curves: some seven windows make one."""
CURVE_PER_M: Final = 4e-4
"""Curvature from which on a curve begins."""


@kernel
def _move(chance: Floats, starts: Indices, way_m: float, taps: Floats) -> Floats:
    """Shift by a way, in cells and their fractions, and spread by `taps` (odd, centred)."""
    moved = np.zeros_like(chance)
    whole = int(np.floor(way_m))
    part = way_m - whole
    half = len(taps) // 2
    for r in range(len(starts) - 1):
        first, last = starts[r], starts[r + 1]
        for i in range(first, last):
            here = 0.0
            for k in range(len(taps)):
                j = i - whole + k - half
                near = chance[j] if first <= j < last else 0.0
                before = chance[j - 1] if first <= j - 1 < last else 0.0
                here += taps[k] * ((1.0 - part) * near + part * before)
            moved[i] = here
    return moved


@kernel
def _weigh(
    chance: Floats,
    heading: Floats,
    starts: Indices,
    curvature: float,
    window_m: float,
    sigma: float,
    share: float,
    largest: float,
    weight: float,
) -> float:
    """Multiply by the likelihood of one curvature; returns the lowest cost met, for the goodness of fit."""
    half = max(0.5 * window_m, 0.5)
    lowest = largest
    for r in range(len(starts) - 1):
        first, last = starts[r], starts[r + 1]
        for i in range(first, last):
            if chance[i] <= 0.0:
                continue
            low, high = max(i - half, float(first)), min(i + half, float(last - 1))
            a, b = int(low), int(high)
            turned_a = heading[a] + (low - a) * (heading[min(a + 1, last - 1)] - heading[a])
            turned_b = heading[b] + (high - b) * (heading[min(b + 1, last - 1)] - heading[b])
            model = (turned_b - turned_a) / max(high - low, 0.5)
            z = (curvature - model) / np.sqrt(sigma * sigma + share * share * model * model)
            cost = min(0.5 * z * z, largest)
            lowest = min(lowest, cost)
            chance[i] *= np.exp(-weight * cost)
    return lowest


class CurvatureGrid:
    """Probability over the places of several routes, jointly normalised."""

    def __init__(self, routes: Sequence[Route], elsewhere: float = 0.0) -> None:
        """Every place as likely as any other, and a probability that the train is on none of them."""
        self.elsewhere = elsewhere
        self.routes = tuple(routes)
        lengths = [len(route.heading_rad) for route in self.routes]
        self._starts = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        self._heading = np.concatenate([route.heading_rad for route in self.routes])
        self._chance = np.full(len(self._heading), (1.0 - elsewhere) / len(self._heading))

    def expect(self, windows_u_m: Sequence[tuple[float, float] | None]) -> None:
        """Begin anew with a place between the ends given for each route; None rules a route out."""
        self._chance[:] = 0.0
        for r, between in enumerate(windows_u_m):
            if between is None:
                continue
            first, last = self._starts[r], self._starts[r + 1]
            u = self.routes[r].first_u_m + STEP_M * np.arange(last - first)
            inside = (u >= between[0]) & (u <= between[1])
            if inside.any():
                self._chance[first:last][inside] = 1.0 / float(np.sum(inside))
        self._normalise()

    def move(self, way_m: float, excess_m: float = 0.0) -> None:
        """Go on by a way; `excess_m` is what a slip on it may have added to the odometry's error."""
        variance = SPREAD_M2_PER_M * abs(way_m) + excess_m * excess_m
        reach = max(1, int(np.ceil(3.0 * np.sqrt(variance))))
        at = np.arange(-reach, reach + 1, dtype=float)
        taps = np.exp(-0.5 * at * at / max(variance, 0.02))
        self._chance = _move(self._chance, self._starts, way_m / STEP_M, taps / taps.sum())
        self._normalise()

    def weigh(self, curvature_per_m: float, window_m: float, new_share: float) -> None:
        """Take a curvature into account, of whose window `new_share` has not been seen before."""
        weight = min(max(new_share, 0.0), 1.0)
        _weigh(
            self._chance,
            self._heading,
            self._starts,
            curvature_per_m,
            window_m,
            SIGMA_PER_M,
            SIGMA_SHARE,
            LARGEST_COST,
            weight,
        )
        cost = ELSEWHERE_CURVE if abs(curvature_per_m) > CURVE_PER_M else ELSEWHERE_STRAIGHT
        self.elsewhere *= float(np.exp(-weight * cost))
        self._normalise()

    def _normalise(self) -> None:
        total = float(self._chance.sum()) + self.elsewhere
        if total > 0.0:
            self._chance /= total
            self.elsewhere = max(self.elsewhere / total, FLOOR) if self.elsewhere > 0.0 else 0.0
        self._chance[(self._chance < FLOOR) & (self._chance > 0.0)] = FLOOR

    @property
    def lost(self) -> bool:
        """True where the way has led off every route."""
        return not float(self._chance.sum()) > 0.0

    def route_chances(self) -> list[float]:
        """Probability of each route; they sum to 1 less `elsewhere`."""
        return [float(self._chance[a:b].sum()) for a, b in zip(self._starts, self._starts[1:], strict=False)]

    def best(self) -> tuple[int, float]:
        """Route and place of the highest probability."""
        top = int(np.argmax(self._chance))
        route = int(np.searchsorted(self._starts, top, side="right")) - 1
        return route, self.routes[route].first_u_m + STEP_M * float(top - self._starts[route])

    def near(self, route: int, u_m: float, within_m: float) -> tuple[float, float]:
        """Probability of one route's places within a distance of `u_m`, and their mean place."""
        first, last = int(self._starts[route]), int(self._starts[route + 1])
        at = first + round((u_m - self.routes[route].first_u_m) / STEP_M)
        reach = int(within_m / STEP_M)
        low, high = max(at - reach, first), min(at + reach + 1, last)
        chance = self._chance[low : max(high, low)]
        total = float(chance.sum())
        if not total > 0.0:
            return 0.0, u_m
        place = float(chance @ np.arange(low, high)) / total - first
        return total, self.routes[route].first_u_m + STEP_M * place
