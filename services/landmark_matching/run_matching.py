"""A whole run matched: where it began, every landmark recognised or refused, and the place anew when it is lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from schemas.line import Direction
from services.landmark_matching.anchor import Anchor
from services.landmark_matching.curve_shape import direction_sign
from services.landmark_matching.junction_watch import JunctionWatch
from services.landmark_matching.line_landmarks import LineLandmarks
from services.landmark_matching.matcher import Match, Matcher
from services.landmark_matching.moved_landmark import Moved
from services.landmark_matching.own_position import OwnPosition
from services.landmark_matching.place_search import CERTAIN, NEAR_M, Found, find_place
from services.landmark_matching.reading import Reading, Sample
from services.landmark_matching.run_readings import samples_of
from services.landmark_matching.settings import MatchSettings

LOST_AFTER: Final = 3
"""Landmarks in a row whose curve was not there, or was another one: the place held is wrong."""
NOT_THERE: Final = ("no curve", "start point", "sign", "curvature", "length", "upper limit", "lower limit", "shape")


class PlaceError(ValueError):
    """A run whose place on the line is not to be found."""


@dataclass(frozen=True, slots=True)
class Start:
    """Where a run begins."""

    branch: str
    direction: Direction
    axis_m: float
    """Of the inertial sensor."""
    bound_m: float


@dataclass(frozen=True, slots=True)
class PlacedFrom:
    """From which reading on which anchor held."""

    t_s: float
    anchor: Anchor
    reason: str


class TracePoint(NamedTuple):
    """Curvature about one place, as the run believed to be there."""

    t_s: float
    branch: str
    direction: Direction
    axis_m: float
    """Of the sensor."""
    curvature_per_m: float
    """NaN where it is not to be had; positive to the train's left."""


@dataclass(frozen=True, slots=True)
class RunMatches:
    """What a run gave."""

    matches: tuple[Match, ...]
    placed: tuple[PlacedFrom, ...]
    moved: tuple[Moved, ...]
    trace: tuple[TracePoint, ...]


def match_run(
    readings: Sequence[Reading],
    known: LineLandmarks,
    start: Start | None,
    settings: MatchSettings,
    share: float,
) -> RunMatches:
    """All landmarks of a run. Without a start the place is searched for by the curvature of the run itself.

    `share` is the odometry's error per way. Raises PlaceError when the place is not to be found.
    """
    run = _Run(_begin(readings, known, start, settings, share), known, settings)
    for number, reading in enumerate(readings):
        run.step(reading)
        if run.is_lost():
            run.go_on_from(_found_anew(readings[number:], known, settings, share))
    return RunMatches(tuple(run.matches), tuple(run.placed), tuple(run.matcher.watch.moved), tuple(run.trace))


class _Run:
    """A run under way."""

    def __init__(self, begin: PlacedFrom, known: LineLandmarks, settings: MatchSettings) -> None:
        self.placed = [begin]
        self.matches: list[Match] = []
        self.trace: list[TracePoint] = []
        self.matcher = Matcher(known.landmarks, known.curves, settings)
        self._known = known
        self._ends = {(one.branch, one.direction): one.last_u_m for one in known.routes}
        self._own = OwnPosition(begin.anchor)
        self._junctions = JunctionWatch(known)
        self._missed = 0
        self._given_up = False

    def step(self, reading: Reading) -> None:
        """Take one reading."""
        for match in self.matcher.step(reading, None if self._junctions.undecided else self._own.anchor):
            self.matches.append(match)
            self._own.take(match, reading)
            self._missed = 0 if match.accepted else self._missed + (match.kind in NOT_THERE)
        sample = self.matcher.newest
        if sample is None:
            return
        self.trace.append(_trace(sample, self._own.anchor))
        choice = self._junctions.step(sample, self._own.anchor)
        if choice is not None and choice.decided is not None:
            self._own.anchor = replace(self._own.anchor, branch=choice.decided)
            self.placed.append(PlacedFrom(reading.t_s, self._own.anchor, choice.reason))

    def is_lost(self) -> bool:
        """Whether landmarks were not there time after time, or the line has ended: trains turn back there."""
        if self._missed >= LOST_AFTER:
            return True
        sample, anchor = self.matcher.newest, self._own.anchor
        if sample is None or self._given_up:
            return False
        held = anchor.held(sample.distance_m, sample.excess_m)
        return held.place_m - held.behind_m > self._ends[anchor.branch, anchor.direction]

    def go_on_from(self, found: PlacedFrom | None) -> None:
        """Hold the place that was found; without one go on as before."""
        self._missed = 0
        self._given_up = found is None
        if found is None:
            return
        self.placed.append(found)
        self._own = OwnPosition(found.anchor)
        self._junctions = JunctionWatch(self._known)


def _trace(sample: Sample, anchor: Anchor) -> TracePoint:
    axis_m = direction_sign(anchor.direction) * anchor.place(sample.distance_m)
    return TracePoint(sample.t_s, anchor.branch, anchor.direction, axis_m, sample.curvature_per_m)


def _begin(
    readings: Sequence[Reading], known: LineLandmarks, start: Start | None, settings: MatchSettings, share: float
) -> PlacedFrom:
    if not readings:
        msg = "the run has no odometry"
        raise PlaceError(msg)
    first = readings[0]
    if start is not None:
        u_m = direction_sign(start.direction) * start.axis_m
        anchor = Anchor(
            start.branch, start.direction, u_m, first.distance_m, start.bound_m, start.bound_m, first.excess_m, share
        )
        return PlacedFrom(first.t_s, anchor, "as given")
    found = find_place(known.routes, samples_of(readings, settings))
    if found.probability < CERTAIN:
        msg = (
            f"the curvature does not tell where the run is on line {known.line} (best guess "
            f"{100.0 * found.probability:.0f} %): say where it begins"
        )
        raise PlaceError(msg)
    return PlacedFrom(first.t_s, _anchor_of(found, first.excess_m, share), "found by the curvature")


def _found_anew(
    readings: Sequence[Reading], known: LineLandmarks, settings: MatchSettings, share: float
) -> PlacedFrom | None:
    samples = samples_of(readings, settings)
    if not samples:
        return None
    found = find_place(known.routes, samples)
    if found.probability < CERTAIN:
        return None
    return PlacedFrom(readings[0].t_s, _anchor_of(found, readings[0].excess_m, share), "lost, found by the curvature")


def _anchor_of(found: Found, excess_m: float, share: float) -> Anchor:
    return Anchor(found.branch, found.direction, found.u_m, found.distance_m, NEAR_M, NEAR_M, excess_m, share)
