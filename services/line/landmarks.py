"""Landmarks that follow from a line's geometry: the rows of Iwata et al., table 1, for both directions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from schemas.line import Curve, Direction, Landmark
from services.line.alignment import Alignment

STRAIGHT_M: Final = 20.0
"""Length of the straights that are diagnosed before and behind the curve, 20 m as in the example of Iwata et al."""
LOWER_SHARE: Final = 0.8
"""Lower limit of the curvature as a share of 1/R; with it table 1 (847 to 881 m, R 300) means transitions of 42.5 m."""
SMALLEST_RADIUS_M: Final = 150.0
LARGEST_RADIUS_M: Final = 800.0
"""Flatter curves do not stand out from the noise of a yaw rate."""
SHORTEST_M: Final = 50.0
"""Least way between the crossings of the lower limit: curvature averaged over 2 s at 70 km/h needs 39 m to build up."""


def landmarks_of(
    alignment: Alignment, *, straight_m: float = STRAIGHT_M, accuracy_m: float = 10.0, lower_share: float = LOWER_SHARE
) -> tuple[Landmark, ...]:
    """Landmarks of a route, first those of direction `up` in order, then those of `down` in order.

    A curve is taken when it has a straight of `straight_m` on both sides, a radius within
    SMALLEST_RADIUS_M to LARGEST_RADIUS_M, and SHORTEST_M between the places where a linear
    transition crosses `lower_share` of its curvature. On the way to a branch only those are given that
    the main line does not have: the ones that reach beyond the junction.
    """
    names: Sequence[Curve] = sorted(alignment.curves, key=lambda curve: curve.start_axis_m)
    room = _straights(names, alignment.length_m)
    up: list[Landmark] = []
    down: list[Landmark] = []
    for number, curve in enumerate(names):
        usable = SMALLEST_RADIUS_M <= abs(curve.radius_m) <= LARGEST_RADIUS_M
        long_m = crossings_m(curve, lower_share)[1] - crossings_m(curve, lower_share)[0]
        beyond = alignment.junction_axis_m is None or curve.end_axis_m + straight_m > alignment.junction_axis_m
        if usable and beyond and long_m >= SHORTEST_M and min(room[number], room[number + 1]) >= straight_m:
            name = f"{alignment.branch + '-' if alignment.branch else ''}C{number + 1:02d}"
            stated = (alignment.branch, straight_m, accuracy_m, lower_share)
            up.append(_landmark(curve, name, "up", *stated))
            down.append(_landmark(curve, name, "down", *stated))
    return (*up, *reversed(down))


def crossings_m(curve: Curve, lower_share: float = LOWER_SHARE) -> tuple[float, float]:
    """Where curvature rises above and falls below a share of 1/R, towards rising `axis_m`.

    >>> example = {"transition_in_m": 42.5, "transition_out_m": 42.5, "radius_m": 300.0}
    >>> crossings_m(Curve(start_axis_m=847.0, end_axis_m=987.0, **example))
    (881.0, 953.0)
    """
    return (
        curve.start_axis_m + lower_share * curve.transition_in_m,
        curve.end_axis_m - lower_share * curve.transition_out_m,
    )


def _straights(curves: Sequence[Curve], length_m: float) -> list[float]:
    """Lengths of the straights before each curve, and behind the last one."""
    ends = [0.0, *(curve.end_axis_m for curve in curves)]
    starts = [*(curve.start_axis_m for curve in curves), length_m]
    return [start - end for start, end in zip(starts, ends, strict=True)]


def _landmark(
    curve: Curve, name: str, direction: Direction, branch: str, straight_m: float, accuracy_m: float, lower_share: float
) -> Landmark:
    """One row of the database, its places in the order in which the train passes them."""
    first_m, last_m = crossings_m(curve, lower_share)
    places = [
        curve.start_axis_m - straight_m,
        curve.start_axis_m,
        first_m,
        last_m,
        curve.end_axis_m,
        curve.end_axis_m + straight_m,
    ]
    rising = direction == "up"
    passed = [round(place, 3) for place in (places if rising else reversed(places))]
    return Landmark(
        id=f"{name}-{direction}",
        direction=direction,
        branch=branch,
        hand="left" if (curve.radius_m > 0.0) == rising else "right",
        radius_m=abs(curve.radius_m),
        entry_straight_start_m=passed[0],
        entry_straight_end_m=passed[1],
        entry_lower_limit_m=passed[2],
        exit_lower_limit_m=passed[3],
        exit_straight_start_m=passed[4],
        exit_straight_end_m=passed[5],
        accuracy_m=max(accuracy_m, round(3.0 * (curve.place_sigma_m or 0.0), 1)),
        lower_share=lower_share,
    )
