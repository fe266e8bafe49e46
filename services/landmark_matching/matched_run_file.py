"""A run as its matches.csv places it: curvature along the line, and each landmark as it was judged.

For pictures of what was written, not for matching anew.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final, get_args

import numpy as np

from schemas.line import Landmark
from services.landmark_matching.curve_shape import direction_sign
from services.landmark_matching.diagnoses import Kind
from services.landmark_matching.log_run_file import read_run
from services.landmark_matching.matcher import Match
from services.landmark_matching.matches_file import COLUMNS
from services.landmark_matching.reading import Sample
from services.landmark_matching.run_matching import RunMatches, TracePoint
from services.landmark_matching.run_readings import samples_of
from services.landmark_matching.settings import MatchSettings

LARGEST_SHARE: Final = 0.05
SLIPS_M: Final = 100.0
"""Way between two landmarks by odometry and by the line differ by no more, or the train was elsewhere in between."""
FARTHEST_M: Final = 2_000.0
TURN_M: Final = 500.0
"""So far from an accepted landmark a place is told: before the first and behind the last one, and where the next one
does not fit."""


class MatchesError(ValueError):
    """A file that is no matches.csv of these landmarks: path, line, what is wrong."""

    def __init__(self, path: Path, line: int, text: str) -> None:
        """Name the file and the line, counted from 1 (0: the file as a whole)."""
        super().__init__(f"{path}:{line}: {text}" if line else f"{path}: {text}")


def read_matched_run(log: Path, path: Path, landmarks: Sequence[Landmark], behind_front_m: float) -> RunMatches:
    """Matches of a file, and the log's curvature about the places that they give it; its truth is never read.

    Between two accepted landmarks the odometry is stretched to fit both. Where they do not fit it (the train has turned
    back) only what is near one of them is placed. Raises MatchesError, MotionLogError, OSError.
    """
    rows = _rows(path, landmarks)
    run = read_run(log, "fused")
    times_s = [one.t_s for one in run.readings]
    distances_m = [one.distance_m for one in run.readings]
    matches = [
        Match(
            landmark=landmark,
            accepted=accepted,
            kind=_kind_of(reason),
            reason=reason,
            t_s=t_s,
            distance_m=float(np.interp(t_s, times_s, distances_m)),
            axis_m=axis_m - direction_sign(landmark.direction) * behind_front_m,
            correction_m=correction_m,
            bound_m=bound_m,
        )
        for landmark, accepted, reason, t_s, axis_m, correction_m, bound_m in rows
    ]
    anchors = sorted((one for one in matches if one.accepted), key=lambda one: one.t_s)
    if not anchors:
        raise MatchesError(path, 0, "no accepted landmark: nothing says where the run is")
    placed = (_placed(sample, anchors) for sample in samples_of(run.readings, MatchSettings()))
    return RunMatches(tuple(matches), (), (), tuple(one for one in placed if one is not None))


def _kind_of(reason: str) -> str:
    """The diagnosis whose name the reason begins with; the reason itself where it tells none."""
    return max((kind for kind in get_args(Kind) if reason.startswith(kind)), key=len, default=reason)


def _placed(sample: Sample, anchors: Sequence[Match]) -> TracePoint | None:
    """The sample between the accepted landmarks before and after it; None where they do not tell its place."""
    after = next((k for k, one in enumerate(anchors) if one.t_s >= sample.t_s), len(anchors))
    last, following = anchors[max(after - 1, 0)], anchors[min(after, len(anchors) - 1)]
    sign = direction_sign(last.landmark.direction)
    way_m = following.distance_m - last.distance_m
    gap_m = following.axis_m - last.axis_m - sign * way_m
    agree = following.landmark.direction == last.landmark.direction and abs(gap_m) <= LARGEST_SHARE * way_m + SLIPS_M
    nearest = min(last, following, key=lambda one: abs(sample.distance_m - one.distance_m))
    if last is not following and agree:
        axis_m = last.axis_m + (sign + gap_m / max(way_m, 1.0)) * (sample.distance_m - last.distance_m)
        nearest = last
    else:
        if abs(sample.distance_m - nearest.distance_m) > (FARTHEST_M if last is following else TURN_M):
            return None
        sign = direction_sign(nearest.landmark.direction)
        axis_m = nearest.axis_m + sign * (sample.distance_m - nearest.distance_m)
    landmark = nearest.landmark
    return TracePoint(sample.t_s, landmark.branch, landmark.direction, axis_m, sample.curvature_per_m)


def _rows(path: Path, landmarks: Sequence[Landmark]) -> list[tuple[Landmark, bool, str, float, float, float, float]]:
    known = {one.id: one for one in landmarks}
    found = []
    with path.open(encoding="utf-8-sig", newline="") as file:
        table = csv.DictReader(file)
        missing = [name for name in COLUMNS if name not in (table.fieldnames or ())]
        if missing:
            raise MatchesError(path, 1, f"no column {', '.join(missing)}")
        for row in table:
            landmark = known.get(row["landmark"] or "")
            if landmark is None:
                raise MatchesError(path, table.line_num, f"the line has no landmark {row['landmark']!r}")
            try:
                figures = [float(row[name] or 0.0) for name in ("t_s", "axis_m", "correction_m", "bound_m")]
            except ValueError as error:
                raise MatchesError(path, table.line_num, str(error)) from error
            if not all(map(math.isfinite, figures)):
                raise MatchesError(path, table.line_num, "a figure is not finite")
            t_s, axis_m, correction_m, bound_m = figures
            found.append((landmark, row["accepted"] == "1", row["reason"] or "", t_s, axis_m, correction_m, bound_m))
    return found
