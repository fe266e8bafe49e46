"""Quantities along a line that are linear between knots: curvature, cant, gradient.

In a clothoid curvature grows in proportion to length, cant is ramped with it, and in a parabolic
vertical curve the gradient changes in proportion to length: all three are broken lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schemas.line import Curve, Gradient

Floats = NDArray[np.float64]

STEP_M: Final = 1e-6
"""Length over which a step is taken, where there is no transition."""


@dataclass(frozen=True, slots=True)
class Profile:
    """A broken line; before its first knot and beyond its last it keeps their values."""

    axis_m: Floats
    """Shape (n,), rising."""
    value: Floats
    """Shape (n,)."""

    def at(self, axis_m: ArrayLike) -> Floats:
        """Values at places, in their shape."""
        return np.asarray(np.interp(np.asarray(axis_m, float), self.axis_m, self.value))

    def until(self, axis_m: float, then: Profile) -> Profile:
        """This one up to a place, the other one from there on."""
        before, after = self.axis_m < axis_m, then.axis_m > axis_m
        return Profile(
            np.concatenate([self.axis_m[before], [axis_m, axis_m + STEP_M], then.axis_m[after]]),
            np.concatenate([self.value[before], [self.at(axis_m), then.at(axis_m)], then.value[after]]),
        )


def _of(knots: list[tuple[float, float]]) -> Profile:
    """Through knots (place, value), put into order; 0 everywhere without any."""
    if not knots:
        return Profile(np.zeros(1), np.zeros(1))
    knots.sort(key=lambda knot: knot[0])
    places, values = np.array(knots, float).T
    return Profile(np.maximum.accumulate(places), values.copy())


def _plateaus(curves: Sequence[Curve], heights: Sequence[float]) -> Profile:
    """From 0 over the first transition to a curve's value, back to 0 over the last."""
    knots: list[tuple[float, float]] = []
    for curve, height in zip(curves, heights, strict=True):
        first_m = curve.start_axis_m + max(curve.transition_in_m, STEP_M)
        last_m = max(curve.end_axis_m - max(curve.transition_out_m, STEP_M), first_m)
        knots += [(curve.start_axis_m, 0.0), (first_m, height), (last_m, height), (curve.end_axis_m, 0.0)]
    return _of(knots)


def curvature_profile(curves: Sequence[Curve]) -> Profile:
    """Curvature [1/m], positive to the left; 0 between curves, and in one with a radius of 0, which is none."""
    return _plateaus(curves, [1.0 / curve.radius_m if curve.radius_m else 0.0 for curve in curves])


def signed_cant_m(curve: Curve) -> float:
    """Cant of the arc [m], positive with the right rail high, as in a left-hand curve with its outer rail high."""
    outer = "right" if curve.radius_m > 0.0 else "left"
    return (1.0 if (curve.high_rail or outer) == "right" else -1.0) * curve.cant_mm / 1000.0


def cant_profile(curves: Sequence[Curve]) -> Profile:
    """Cant [m], positive with the right rail high, ramped with the transitions."""
    return _plateaus(curves, [signed_cant_m(curve) for curve in curves])


def gradient_profile(gradients: Sequence[Gradient]) -> Profile:
    """Gradient [‰], positive uphill, each change rounded by its vertical curve.

    A vertical curve of radius R reaches R·|change|/2 to both sides of the change (change as a
    ratio), never further than half way to the next one. The first gradient holds before its place too.

    >>> both = gradient_profile([Gradient(axis_m=0.0, permille=0.0), Gradient(axis_m=500.0, permille=20.0)])
    >>> both.at([469.0, 500.0, 515.0]).round(1).tolist()
    [0.0, 10.0, 15.0]
    """
    if not gradients:
        return _of([])
    knots = [(gradients[0].axis_m, gradients[0].permille)]
    for i in range(1, len(gradients)):
        before, here = gradients[i - 1], gradients[i]
        reach_m = here.vertical_radius_m * abs(here.permille - before.permille) / 2000.0
        room_m = here.axis_m - before.axis_m
        if i + 1 < len(gradients):
            room_m = min(room_m, gradients[i + 1].axis_m - here.axis_m)
        reach_m = max(min(reach_m, room_m / 2.0), STEP_M / 2.0)
        knots += [(here.axis_m - reach_m, before.permille), (here.axis_m + reach_m, here.permille)]
    return _of(knots)
