"""The state machine that waits for one landmark's curve, sample by sample.

waiting → inside (curvature above the lower limit) → leaving (below again) → diagnosed, once the exit
straight has passed. A passage that fails leaves the tracker waiting, since another curve may lie within a
wide search window; when the window has gone by, the failure that came furthest is what is told.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from schemas.line import Landmark
from services.landmark_matching.anchor import Anchor, Held
from services.landmark_matching.curve_shape import CurveShape
from services.landmark_matching.diagnoses import Verdict, diagnose
from services.landmark_matching.passage import Passage, clear_of_curve_m, cut_passage, straight_rows, straight_stretch
from services.landmark_matching.reading import Sample
from services.landmark_matching.settings import MatchSettings
from services.landmark_matching.track_record import CURVATURE, DISTANCE, TrackRecord

BACK_M: Final = 30.0
"""Before the entry straight's farthest place: what the diagnoses look back on."""
REARM_M: Final = 50.0
"""A train that is back this far before the landmark may pass it once more."""
STAGES: Final = (
    "no curve",
    "start point",
    "slip",
    "gap",
    "low speed",
    "leap",
    "no curvature",
    "reverse running",
    "entry straight",
    "sign",
    "upper limit",
    "lower limit",
    "curvature",
    "length",
    "exit straight",
    "shape",
    "window",
    "gnss",
)
"""Refusals from the one that says least about the landmark to the one that says most."""


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """A verdict and the passage that it is about; None for a curve that was never seen."""

    verdict: Verdict
    passage: Passage | None


class CurveTracker:
    """Follows one landmark."""

    def __init__(self, landmark: Landmark, shape: CurveShape, settings: MatchSettings) -> None:
        """Begin before the landmark."""
        self.landmark = landmark
        self.shape = shape
        self._settings = settings
        self._level = landmark.lower_share / landmark.radius_m
        self._length_m = shape.end_m - shape.start_m
        self._first_m = min(shape.start_m, shape.end_m) - abs(
            landmark.entry_straight_end_m - landmark.entry_straight_start_m
        )
        self._last_m = shape.end_m + abs(landmark.exit_straight_end_m - landmark.exit_straight_start_m)
        self.reset()

    def reset(self) -> None:
        """Forget a passage under way and whether the landmark has been passed."""
        self._entry_m = math.nan
        self._exit_m = math.nan
        self._previous = (math.nan, math.nan)
        self._failed: Verdict | None = None
        self._passed = False
        self._disturbed = ""
        self._approached = False
        """Whether the place held was ever before the landmark: a train first placed beyond it did not miss it."""

    def step(self, sample: Sample, record: TrackRecord, anchor: Anchor, held: Held) -> Diagnosed | None:
        """Take the newest sample, which `record` already holds; what the diagnoses say when they are done.

        `held` is what the anchor says at this sample.
        """
        place_m, behind_m, ahead_m = held
        if self._passed:
            if place_m + ahead_m < self._first_m - REARM_M:
                self.reset()
            return None
        slack_m = self.landmark.accuracy_m + sample.window_m
        if place_m + ahead_m + slack_m < self._first_m:
            self._forget()
            return None
        self._approached = self._approached or place_m < self._first_m
        found = self._follow(sample, record, anchor)
        if found is not None and found.verdict.kind == "accepted":
            self._passed = True
            return found
        if found is not None:
            self._note(found.verdict)
        late_m = self._settings.straight_within_m if not math.isnan(self._entry_m) else 0.0
        if place_m - behind_m - slack_m > self._last_m + late_m:
            return self._give_up(sample, place_m)
        return None

    def _give_up(self, sample: Sample, place_m: float) -> Diagnosed | None:
        """The landmark lies behind for certain: tell why it was not recognised."""
        failed, approached, disturbed = self._failed, self._approached, self._disturbed
        self.reset()
        self._passed = True
        if failed is None and not approached:
            return None
        if failed is None or (failed.kind == "start point" and disturbed):
            kind = disturbed or "no curve"
            words = f"{kind} near the landmark" if disturbed else "no curve: curvature stayed below the lower limit"
            failed = Verdict(kind, words, sample.t_s, sample.distance_m, place_m, 0.0, 0.0)  # type: ignore[arg-type]  # sample faults are kinds
        return Diagnosed(failed, None)

    def _note(self, verdict: Verdict) -> None:
        if self._failed is None or STAGES.index(verdict.kind) >= STAGES.index(self._failed.kind):
            self._failed = verdict

    def _forget(self) -> None:
        self._entry_m = self._exit_m = math.nan
        self._previous = (math.nan, math.nan)

    def _follow(self, sample: Sample, record: TrackRecord, anchor: Anchor) -> Diagnosed | None:
        """The state machine proper."""
        before_m, before = self._previous
        now_m, now = sample.distance_m, abs(sample.curvature_per_m)
        self._previous = (now_m, now)
        if sample.fault:
            self._disturbed = sample.fault
            if not math.isnan(self._entry_m):
                return self._finish(record, anchor, now_m if math.isnan(self._exit_m) else self._exit_m)
            return None
        if before < self._level <= now:
            crossing_m = before_m + (now_m - before_m) * (self._level - before) / (now - before)
            if math.isnan(self._entry_m):
                self._entry_m = crossing_m
            self._exit_m = math.nan
        elif now < self._level <= before and not math.isnan(self._entry_m):
            self._exit_m = before_m + (now_m - before_m) * (self._level - before) / (now - before)
        if math.isnan(self._exit_m):
            longest_m = 2.0 * self._length_m + 2.0 * self._settings.straight_within_m
            if now_m - self._entry_m > longest_m:
                return self._finish(record, anchor, now_m)
            return None
        if self._straight_passed(record, sample) or now_m - self._exit_m > self._patience_m(sample.window_m):
            return self._finish(record, anchor, self._exit_m)
        return None

    def _patience_m(self, window_m: float) -> float:
        """How far beyond the exit crossing the straight is waited for."""
        clear_m = clear_of_curve_m(self.shape, self.landmark, window_m, entry=False)
        length_m, _ = straight_rows(self.landmark, self._settings, entry=False)
        return max(self._settings.straight_within_m, clear_m + 2.0 * length_m) + 5.0

    def _straight_passed(self, record: TrackRecord, sample: Sample) -> bool:
        """Whether the exit straight is complete."""
        length_m, limit = straight_rows(self.landmark, self._settings, entry=False)
        begin_m = self._exit_m + clear_of_curve_m(self.shape, self.landmark, sample.window_m, entry=False)
        if abs(sample.curvature_per_m) >= limit or sample.distance_m - begin_m < length_m:
            return False
        begin = record.since_distance(begin_m, record.end)
        way = record.column(DISTANCE, begin, record.end) - self._exit_m
        curvature = record.column(CURVATURE, begin, record.end)
        return straight_stretch(way, curvature, length_m, limit, self._settings.straight_share) is not None

    def _finish(self, record: TrackRecord, anchor: Anchor, exit_m: float) -> Diagnosed:
        """Diagnose the passage that ends here, and wait for the next."""
        reach_m = max(self._settings.straight_within_m, self.shape.arc_start_m - self.shape.start_m) + BACK_M
        begin = record.since_distance(self._entry_m - reach_m, record.end)
        passage = cut_passage(record, begin, self.landmark, self.shape, anchor, (self._entry_m, exit_m))
        verdict = diagnose(passage, self._settings)
        self._entry_m = self._exit_m = math.nan
        return Diagnosed(verdict, passage)
