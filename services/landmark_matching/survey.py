"""Builds a landmark database from runs: every curve fitted in every run, laid onto the line, merged over the runs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np

from schemas.line import Landmark, LandmarkDatabase
from services.landmark_matching.curve_fit import CurveFit, fit_curve
from services.landmark_matching.curve_shape import CurveShape, direction_sign
from services.landmark_matching.line_landmarks import LineLandmarks
from services.landmark_matching.matcher import Match
from services.landmark_matching.passage import Passage
from services.landmark_matching.run_matching import RunMatches
from services.landmark_matching.settings import MatchSettings
from services.landmark_matching.survey_alignment import align

SURVEY: Final = MatchSettings(scale_tolerance=0.35, length_cap_share=0.5, length_floor_m=20.0, shape_tolerance=0.3)
"""With which curves are looked for: the line's geometry may be rough."""
LARGEST_RESIDUAL: Final = 0.06
"""A curve that no arc with two transitions explains better than this (rms, as a share of its curvature) is none."""
FEW_RUNS_SPREAD_M: Final = 1.5
"""Spread that is assumed where fewer than three runs show one."""
SYSTEMATIC_M: Final = 0.7
"""What all runs may share: sensor delay, transitions that are no clothoids."""
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


@dataclass(frozen=True, slots=True)
class SurveyedLandmark:
    """A landmark and what it was made of."""

    landmark: Landmark
    passages: tuple[Surveyed, ...]
    moved_m: float
    """Exit crossing by the runs minus by the line's geometry, in the direction of running."""


def survey_run(name: str, matches: RunMatches) -> list[Surveyed]:
    """The curves of one run. Matches must come from a matcher with the settings SURVEY."""
    found = [(match, fit) for match in matches.matches if match.accepted for fit in [_fit(match)] if fit is not None]
    by_way: dict[tuple[str, int], list[tuple[Match, CurveFit]]] = {}
    for match, fit in found:
        stretch = sum(placed.t_s <= match.t_s and "lost" in placed.reason for placed in matches.placed)
        by_way.setdefault((match.landmark.direction, stretch), []).append((match, fit))
    return [one for group in by_way.values() for one in _laid_down(name, group)]


def _fit(match: Match) -> CurveFit | None:
    passage = match.passage
    if passage is None:
        return None
    first = _guess(passage)
    near = (passage.distance_m >= first.start_m - 60.0) & (passage.distance_m <= first.end_m + 60.0)
    near &= np.isfinite(passage.curvature_per_m)
    columns = (passage.distance_m, passage.curvature_per_m, passage.window_m, passage.speed_mps)
    fit = fit_curve(first, *(column[near] for column in columns))
    if fit is None or fit.residual_per_m > LARGEST_RESIDUAL * abs(fit.shape.curvature_per_m):
        return None
    return fit


def _guess(passage: Passage) -> CurveShape:
    """The database's curve, shifted to the distances at which it was measured."""
    shape = passage.shape
    middle_u_m = 0.5 * (shape.start_m + shape.end_m)
    shift_m = 0.5 * (passage.entry_m + passage.exit_m) - middle_u_m
    return CurveShape(
        shape.start_m + shift_m,
        shape.arc_start_m + shift_m,
        shape.arc_end_m + shift_m,
        shape.end_m + shift_m,
        shape.curvature_per_m,
    )


def _middle(shape: CurveShape) -> float:
    return 0.25 * (shape.start_m + shape.arc_start_m + shape.arc_end_m + shape.end_m)


def _laid_down(name: str, group: Sequence[tuple[Match, CurveFit]]) -> list[Surveyed]:
    passages = [match.passage for match, _ in group if match.passage is not None]
    distance_m = np.array([_middle(fit.shape) for _, fit in group])
    place_m = np.array([_middle(passage.shape) for passage in passages])
    accuracy_m = np.array([match.landmark.accuracy_m for match, _ in group])
    excess_m = np.array([passage.excess_at(d) for passage, d in zip(passages, distance_m.tolist(), strict=True)])
    aligned = align(distance_m, place_m, accuracy_m, excess_m)
    laid = []
    for (match, fit), passage, d, offset, sigma in zip(
        group, passages, distance_m.tolist(), aligned.offset_m.tolist(), aligned.sigma_m.tolist(), strict=True
    ):
        measured = (fit.shape.start_m, fit.shape.arc_start_m, fit.shape.arc_end_m, fit.shape.end_m)
        start, arc_start, arc_end, end = (d + offset + aligned.scale * (place - d) for place in measured)
        shape = CurveShape(start, arc_start, arc_end, end, fit.shape.curvature_per_m / aligned.scale)
        share = fit.residual_per_m / abs(fit.shape.curvature_per_m)
        laid.append(Surveyed(match.landmark, name, shape, sigma, share, passage.exit_speed_mps))
    return laid


def merge(surveyed: Sequence[Surveyed]) -> list[SurveyedLandmark]:
    """One landmark per curve and direction, in the order of their ids."""
    groups: dict[str, list[Surveyed]] = {}
    for one in surveyed:
        groups.setdefault(one.landmark.id, []).append(one)
    return [_merged(groups[name]) for name in sorted(groups)]


def exit_crossing(shape: CurveShape, lower_share: float) -> float:
    """Where the curvature itself, not its average, falls below the lower limit."""
    return shape.end_m - lower_share * (shape.end_m - shape.arc_end_m)


def _merged(group: Sequence[Surveyed]) -> SurveyedLandmark:
    given = group[0].landmark
    share = given.lower_share
    exits = np.array([exit_crossing(one.shape, share) for one in group])
    entries = np.array([one.shape.start_m + share * (one.shape.arc_start_m - one.shape.start_m) for one in group])
    starts, ends = np.array([one.shape.start_m for one in group]), np.array([one.shape.end_m for one in group])
    spread_m = float(np.std(exits, ddof=1)) if len(group) > 1 else None
    scatter_m = spread_m if spread_m is not None and len(group) >= 3 else FEW_RUNS_SPREAD_M  # noqa: PLR2004 - see there
    aligned_m = float(np.mean([one.sigma_m for one in group]))
    accuracy_m = SYSTEMATIC_M + 3.0 * math.hypot(scatter_m / math.sqrt(len(group)), aligned_m)
    sign = direction_sign(given.direction)
    curvature = float(np.mean([one.shape.curvature_per_m for one in group]))

    def place(u_m: float) -> float:
        return max(round(sign * u_m, 2), 0.0)

    start, end = float(np.mean(starts)), float(np.mean(ends))
    landmark = msgspec.structs.replace(
        given,
        hand="left" if curvature > 0.0 else "right",
        radius_m=round(1.0 / abs(curvature), 1),
        entry_straight_start_m=place(start - STRAIGHT_M),
        entry_straight_end_m=place(start),
        entry_lower_limit_m=place(float(np.mean(entries))),
        exit_lower_limit_m=place(float(np.mean(exits))),
        exit_straight_start_m=place(end),
        exit_straight_end_m=place(end + STRAIGHT_M),
        accuracy_m=round(accuracy_m, 2),
        runs=len(group),
        spread_m=None if spread_m is None else round(spread_m, 2),
    )
    return SurveyedLandmark(landmark, tuple(group), float(np.mean(exits)) - sign * given.exit_lower_limit_m)


def database_of(found: Sequence[SurveyedLandmark], known: LineLandmarks) -> LandmarkDatabase:
    """The database; its version follows from its contents, so that the same runs give the same bytes."""
    landmarks = tuple(one.landmark for one in found)
    runs = tuple(sorted({passage.run for one in found for passage in one.passages}))
    digest = hashlib.sha256(msgspec.json.encode(landmarks)).hexdigest()[:8]
    origin = (
        f"surveyed from {len(runs)} runs over curves of line {known.line} {known.line_version}: each curve fitted as "
        f"transition, arc, transition to curvature averaged over {SURVEY.window_s:g} s, laid onto the line by its "
        "geometry and the odometry between curves, averaged over the runs"
    )
    return LandmarkDatabase(
        version=f"survey-{digest}",
        line=known.line,
        line_version=known.line_version,
        origin=origin,
        evidence=runs,
        landmarks=landmarks,
    )
