"""All landmarks of a line at once: which curve was passed, where the train therefore is, or why that is not said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from schemas.line import Curve, Direction, Landmark
from services.landmark_matching.anchor import Anchor
from services.landmark_matching.curve_shape import CurveShape, direction_sign, shape_of_curve, shape_of_landmark
from services.landmark_matching.curve_tracker import CurveTracker, Diagnosed
from services.landmark_matching.diagnoses import Kind, Verdict
from services.landmark_matching.moved_landmark import MovedWatch
from services.landmark_matching.passage import Passage
from services.landmark_matching.reading import Reading, Sample, SampleMaker
from services.landmark_matching.settings import MatchSettings
from services.landmark_matching.track_record import TrackRecord
from services.landmark_matching.twin import twin_of

Route = tuple[str, Direction]
"""Branch and direction of running."""
DIRECTIONS: Final[tuple[Direction, ...]] = ("up", "down")
FARTHEST_M: Final = 100.0
"""A curve that fits but stands further from its place than this is taken for another one."""


@dataclass(frozen=True, slots=True)
class Match:
    """A landmark recognised or refused."""

    landmark: Landmark
    accepted: bool
    kind: str
    reason: str
    t_s: float
    """When the sensor was at the exit crossing."""
    distance_m: float
    axis_m: float
    """Place of the sensor at `t_s`: by the landmark where it was accepted, else as held."""
    correction_m: float
    """Along `axis_m`: place by the landmark minus the place held; 0 where refused."""
    bound_m: float
    """0 where refused."""
    passage: Passage | None = None


class Matcher:
    """Takes readings one by one, with what is held of the train's place."""

    def __init__(
        self,
        landmarks: Mapping[str, Sequence[Landmark]],
        curves: Mapping[str, Sequence[Curve]],
        settings: MatchSettings | None = None,
        watch: MovedWatch | None = None,
    ) -> None:
        """By branch: the landmarks, of both directions, that a train on the way there meets, and all its curves.

        Curves serve to find twins. Raises ShapeError for a landmark whose rows make no curve.
        """
        self.settings = settings or MatchSettings()
        self._trackers: dict[Route, list[CurveTracker]] = {}
        self._curves: dict[Route, list[tuple[str, CurveShape]]] = {}
        for branch, ones in landmarks.items():
            for landmark in ones:
                shape, route = shape_of_landmark(landmark), (branch, landmark.direction)
                self._trackers.setdefault(route, []).append(CurveTracker(landmark, shape, self.settings))
                self._curves.setdefault(route, []).append((landmark.id, shape))
        for branch, bends in curves.items():
            for curve in bends:
                for direction in DIRECTIONS:
                    shape = shape_of_curve(curve, direction)
                    self._curves.setdefault((branch, direction), []).append((f"at {curve.start_axis_m:.0f} m", shape))
        self.watch = watch or MovedWatch()
        self._maker = self._new_maker()
        self._record = TrackRecord()
        self._route: Route | None = None
        self.newest: Sample | None = None
        """What the last reading gave."""

    def _new_maker(self) -> SampleMaker:
        settings = self.settings
        return SampleMaker(settings.window_s, settings.lowest_speed_mps, settings.longest_step_s, settings.leap_mps2)

    def restart(self) -> None:
        """Forget everything under way: the odometry counts from another zero."""
        self._maker = self._new_maker()
        self._record = TrackRecord()
        self._reset_route(None)
        self.watch.restart()

    def _reset_route(self, route: Route | None) -> None:
        for tracker in self._trackers.get(self._route, []) if self._route else []:
            tracker.reset()
        self._route = route

    def step(self, reading: Reading, anchor: Anchor | None) -> list[Match]:
        """Matches that this reading completes, nearest landmark first; nothing while no place is held."""
        sample = self._maker.take(reading)
        self.newest = sample
        if sample is None:
            return []
        self._record.add(sample)
        route = None if anchor is None else (anchor.branch, anchor.direction)
        if route != self._route:
            self._follow_route(route)
        if anchor is None or route is None:
            return []
        held = anchor.held(sample.distance_m, sample.excess_m)
        trackers = self._trackers.get(route, [])
        done = ((tracker, tracker.step(sample, self._record, anchor, held)) for tracker in trackers)
        return [self._judged(route, tracker, found, anchor, sample) for tracker, found in done if found is not None]

    def _follow_route(self, route: Route | None) -> None:
        """Another branch in the same direction continues the way; anything else begins anew."""
        if route is None or self._route is None or route[1] != self._route[1]:
            self.watch.restart()
        self._reset_route(route)

    def _judged(self, route: Route, tracker: CurveTracker, found: Diagnosed, anchor: Anchor, sample: Sample) -> Match:
        """The verdict after the checks that know of other landmarks: twins and moved ones."""
        verdict, passage, landmark = found.verdict, found.passage, tracker.landmark
        if verdict.kind == "accepted" and passage is not None and verdict.measured is not None:
            twin = twin_of(passage, verdict.measured, self._curves[route], self.settings)
            if twin:
                verdict = _refused(verdict, "twin", twin)
            else:
                moved = self.watch.take(landmark, verdict, sample.excess_m)
                if moved:
                    verdict = _refused(verdict, "moved", moved)
        elif verdict.fits and abs(verdict.correction_m) <= FARTHEST_M:
            self.watch.take(landmark, verdict, sample.excess_m)
        return _match(landmark, verdict, passage, anchor)


def _refused(verdict: Verdict, kind: Kind, reason: str) -> Verdict:
    return replace(verdict, kind=kind, reason=f"{kind}: {reason}")


def _match(landmark: Landmark, verdict: Verdict, passage: Passage | None, anchor: Anchor) -> Match:
    accepted = verdict.kind == "accepted"
    sign = direction_sign(landmark.direction)
    u_m = verdict.u_m if accepted else anchor.place(verdict.distance_m)
    return Match(
        landmark,
        accepted,
        verdict.kind,
        verdict.reason,
        verdict.t_s,
        verdict.distance_m,
        sign * u_m,
        sign * verdict.correction_m if accepted else 0.0,
        verdict.bound_m if accepted else 0.0,
        passage,
    )
