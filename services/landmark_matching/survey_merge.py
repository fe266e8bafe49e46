"""Merges what runs say of one curve: passages that disagree with the others are left out, the rest averaged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np

from schemas.line import Landmark
from services.landmark_matching.curve_shape import CurveShape, direction_sign

SPREAD_M: Final = 1.5
"""Standard deviation of an exit crossing from run to run, before any run has shown it."""
SPREAD_WEIGHT: Final = 2
"""What that counts beside the runs' own: as much as this many further runs. Few runs may agree by chance."""
SYSTEMATIC_M: Final = 0.7
"""What all runs may share: sensor delay, transitions that are no clothoids."""
FAR_SIGMAS: Final = 3.0
"""A passage whose exit crossing is so far from the middle one of all disagrees with them."""
RADIUS_APART: Final = 0.05
"""So does one whose radius does: gyro and wheel are known to some 3 per cent together."""
STRAIGHT_M: Final = 20.0


@dataclass(frozen=True, slots=True)
class Surveyed:
    """One curve in one run, on the line; places rise in the direction of running."""

    landmark: Landmark
    run: str
    shape: CurveShape
    sigma_m: float
    """Of the place, by the alignment."""
    residual_share: float
    speed_mps: float

    @property
    def exit_m(self) -> float:
        """Where the curvature itself, not its average, falls below the lower limit."""
        return self.shape.end_m - self.landmark.lower_share * (self.shape.end_m - self.shape.arc_end_m)

    @property
    def entry_m(self) -> float:
        """Where it rises above it."""
        return self.shape.start_m + self.landmark.lower_share * (self.shape.arc_start_m - self.shape.start_m)


@dataclass(frozen=True, slots=True)
class SurveyedLandmark:
    """A landmark and what it was made of."""

    landmark: Landmark
    passages: tuple[Surveyed, ...]
    moved_m: float
    """Exit crossing by the runs minus by the line's geometry, in the direction of running."""
    left_out: tuple[Surveyed, ...] = ()
    """Passages that disagree with these."""


def merge(surveyed: Sequence[Surveyed]) -> list[SurveyedLandmark]:
    """One landmark per curve and direction, in the order of their ids."""
    groups: dict[str, list[Surveyed]] = {}
    for one in surveyed:
        groups.setdefault(one.landmark.id, []).append(one)
    return [_merged(groups[name]) for name in sorted(groups)]


def _disagrees(one: Surveyed, exit_m: float, curvature_per_m: float) -> bool:
    far_m = FAR_SIGMAS * math.hypot(SPREAD_M, one.sigma_m)
    return abs(one.exit_m - exit_m) > far_m or abs(one.shape.curvature_per_m / curvature_per_m - 1.0) > RADIUS_APART


def _agreeing(group: Sequence[Surveyed]) -> list[Surveyed]:
    """Those that agree with the middle one of all; all of them where that is no majority, or only two."""
    exit_m = float(np.median([one.exit_m for one in group]))
    curvature = float(np.median([one.shape.curvature_per_m for one in group]))
    kept = [one for one in group if not _disagrees(one, exit_m, curvature)]
    return kept if len(group) > 2 and 2 * len(kept) > len(group) else list(group)  # noqa: PLR2004 - of two, neither is known to be wrong


def _scatter_m(exits_m: Sequence[float]) -> float:
    """Standard deviation of one run's crossing: what the runs show, with SPREAD_M as SPREAD_WEIGHT runs more."""
    squares = float(np.sum(np.square(np.asarray(exits_m) - np.mean(exits_m))))
    return math.sqrt((SPREAD_WEIGHT * SPREAD_M**2 + squares) / (SPREAD_WEIGHT + len(exits_m) - 1))


def _merged(group: Sequence[Surveyed]) -> SurveyedLandmark:
    given, kept = group[0].landmark, _agreeing(group)
    sign = direction_sign(given.direction)
    exits = [one.exit_m for one in kept]
    aligned_m = float(np.mean([one.sigma_m for one in kept]))
    accuracy_m = SYSTEMATIC_M + 3.0 * math.hypot(_scatter_m(exits) / math.sqrt(len(kept)), aligned_m)
    curvature = float(np.mean([one.shape.curvature_per_m for one in kept]))

    def place(u_m: float) -> float:
        return max(round(sign * u_m, 2), 0.0)

    start = float(np.mean([one.shape.start_m for one in kept]))
    end = float(np.mean([one.shape.end_m for one in kept]))
    landmark = msgspec.structs.replace(
        given,
        hand="left" if curvature > 0.0 else "right",
        radius_m=round(1.0 / abs(curvature), 1),
        entry_straight_start_m=place(start - STRAIGHT_M),
        entry_straight_end_m=place(start),
        entry_lower_limit_m=place(float(np.mean([one.entry_m for one in kept]))),
        exit_lower_limit_m=place(float(np.mean(exits))),
        exit_straight_start_m=place(end),
        exit_straight_end_m=place(end + STRAIGHT_M),
        accuracy_m=round(accuracy_m, 2),
        runs=len(kept),
        spread_m=round(float(np.std(exits, ddof=1)), 2) if len(kept) > 1 else None,
    )
    left_out = tuple(one for one in group if one not in kept)
    return SurveyedLandmark(landmark, tuple(kept), float(np.mean(exits)) - sign * given.exit_lower_limit_m, left_out)
