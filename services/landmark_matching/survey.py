"""Builds a landmark database from runs: every curve fitted in every run and laid onto the line."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from schemas.line import LandmarkDatabase
from services.landmark_matching.curve_fit import CurveFit, fit_curve
from services.landmark_matching.curve_shape import CurveShape
from services.landmark_matching.line_landmarks import LineLandmarks
from services.landmark_matching.matcher import Match
from services.landmark_matching.passage import Passage
from services.landmark_matching.run_matching import RunMatches
from services.landmark_matching.settings import MatchSettings
from services.landmark_matching.survey_alignment import align
from services.landmark_matching.survey_merge import Surveyed, SurveyedLandmark

SURVEY: Final = MatchSettings(scale_tolerance=0.35, length_cap_share=0.5, length_floor_m=20.0, shape_tolerance=0.3)
"""With which curves are looked for: the line's geometry may be rough."""
LARGEST_RESIDUAL: Final = 0.06
"""A curve that no arc with two transitions explains better than this (rms, as a share of its curvature) is none."""


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
