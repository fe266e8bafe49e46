"""The matching as the bus feeds it: odometry and positions in, matches and branch evidence out."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from schemas.motion import Odometry
from schemas.position import BranchChance, BranchEvidence, LandmarkMatch, TrainPosition
from services.landmark_matching.anchor import Anchor
from services.landmark_matching.branch_choice import Choice
from services.landmark_matching.curve_shape import direction_sign
from services.landmark_matching.junction_watch import JunctionWatch
from services.landmark_matching.line_landmarks import LineLandmarks
from services.landmark_matching.matcher import Match, Matcher
from services.landmark_matching.moved_landmark import Moved
from services.landmark_matching.reading import Reading
from services.landmark_matching.settings import MatchSettings

KEPT: Final = 200
"""Odometry that is kept to find the distance at a position's time: 20 s at 10 Hz."""
LEAST_SPEED_MPS: Final = 1.0
"""Below it signs of speeds do not tell which end leads."""
OLDEST_POSITION_S: Final = 3.0
"""A place held longer ago opens no search window: what happened since is unknown."""
FRESH_GNSS_S: Final = 2.0


class LiveMatching:
    """One train on one line."""

    def __init__(
        self, known: LineLandmarks, settings: MatchSettings, behind_front_m: float, behind_other_end_m: float
    ) -> None:
        """`behind_…`: how far the sensor is behind the leading end, by the end that leads."""
        self._known = known
        self._behind = {1.0: behind_front_m, -1.0: behind_other_end_m}
        self._matcher = Matcher(known.landmarks, known.curves, settings)
        self._junctions = JunctionWatch(known)
        self._past: deque[Odometry] = deque(maxlen=KEPT)
        self._position: TrainPosition | None = None
        self._sense = 1.0
        self._epoch_ns = 0

    @property
    def moved(self) -> list[Moved]:
        """Landmarks that may have moved."""
        return self._matcher.watch.moved

    @property
    def wrong_version(self) -> str:
        """Words, where the position is held on another version of the line; empty when they agree."""
        position = self._position
        if position is None or position.line_version in ("", self._known.line_version):
            return ""
        return f"position is held on line version {position.line_version!r}, landmarks on {self._known.line_version!r}"

    def take_position(self, position: TrainPosition) -> None:
        """Take what is held of the train's place; older ones than the newest are left out."""
        if self._position is not None and position.t_ns < self._position.t_ns:
            return
        self._position = position
        sense = self._sense_of(position)
        if sense != self._sense:
            self._restart(sense)

    def _sense_of(self, position: TrainPosition) -> float:
        """-1 where the leading end runs against the sensor's x axis: the cab at the other end is in use."""
        if position.speed_mps is None or not self._past:
            return self._sense
        speed_mps = self._past[-1].speed_mps
        if min(abs(position.speed_mps), abs(speed_mps)) < LEAST_SPEED_MPS:
            return self._sense
        return math.copysign(1.0, position.speed_mps * speed_mps)

    def _restart(self, sense: float) -> None:
        self._sense = sense
        self._matcher.restart()
        self._junctions = JunctionWatch(self._known)

    def take_odometry(self, odometry: Odometry) -> list[LandmarkMatch | BranchEvidence]:
        """Take one step of odometry; what follows from it."""
        if not self._past or self._past[-1].origin != odometry.origin:
            self._past.clear()
            self._epoch_ns = odometry.t_ns
            self._restart(self._sense)
        elif odometry.t_ns <= self._past[-1].t_ns:
            return []
        self._past.append(odometry)
        anchor = self._anchor(odometry)
        undecided = self._position is not None and self._position.branch is None
        found: list[LandmarkMatch | BranchEvidence] = [
            self._message(match, odometry)
            for match in self._matcher.step(self._reading(odometry), None if undecided else anchor)
        ]
        sample = self._matcher.newest
        choice = None if sample is None else self._junctions.step(sample, anchor, undecided=undecided)
        return [*found, _evidence(choice, odometry)] if choice is not None else found

    def _reading(self, odometry: Odometry) -> Reading:
        known = odometry.curvature_per_m is not None and odometry.curvature_distance_m is not None
        return Reading(
            (odometry.t_ns - self._epoch_ns) / 1e9,
            self._sense * odometry.distance_m,
            self._sense * odometry.speed_mps,
            self._sense * (odometry.curvature_per_m or 0.0) if known else math.nan,
            self._sense * (odometry.curvature_distance_m or 0.0) if known else math.nan,
            odometry.slip != 0,
            odometry.status != "lost",
            odometry.excess_m + odometry.provisional_m,
            math.nan if odometry.curvature_sigma_per_m is None else odometry.curvature_sigma_per_m,
        )

    def _anchor(self, odometry: Odometry) -> Anchor | None:
        """Search window from the position held; None without a usable one."""
        position = self._position
        if position is None or position.status == "lost" or self.wrong_version:
            return None
        if position.axis_m is None or position.direction is None:
            return None
        if position.bound_ahead_m is None or position.bound_behind_m is None:
            return None
        then = self._odometry_at(position.t_ns)
        if then is None or odometry.t_ns - position.t_ns > OLDEST_POSITION_S * 1e9:
            return None
        u_m = direction_sign(position.direction) * position.axis_m - self._behind[self._sense]
        return Anchor(
            branch=position.branch or "",
            direction=position.direction,
            u_m=u_m,
            distance_m=self._sense * then[0],
            ahead_m=position.bound_ahead_m,
            behind_m=position.bound_behind_m,
            excess_m=then[1],
            share=odometry.share_bound,
            gnss=_gnss(position),
        )

    def _odometry_at(self, t_ns: int) -> tuple[float, float] | None:
        """Distance and excess at a time, interpolated; None where it lies before all that is kept."""
        newer = self._past[-1]
        if t_ns >= newer.t_ns:
            ahead_m = newer.speed_mps * (t_ns - newer.t_ns) / 1e9
            return newer.distance_m + ahead_m, newer.excess_m + newer.provisional_m
        for older in reversed(self._past):
            if older.t_ns <= t_ns:
                share = (t_ns - older.t_ns) / max(newer.t_ns - older.t_ns, 1)
                distance_m = older.distance_m + share * (newer.distance_m - older.distance_m)
                return distance_m, older.excess_m + older.provisional_m
            newer = older
        return None

    def _message(self, match: Match, odometry: Odometry) -> LandmarkMatch:
        direction = match.landmark.direction
        front_m = direction_sign(direction) * self._behind[self._sense]
        return LandmarkMatch(
            t_ns=self._epoch_ns + round(match.t_s * 1e9),
            landmark=match.landmark.id,
            branch=match.landmark.branch,
            direction=direction,
            accepted=match.accepted,
            reason=match.reason,
            origin=odometry.origin,
            distance_m=self._sense * match.distance_m,
            axis_m=match.axis_m + front_m,
            correction_m=match.correction_m,
            bound_m=match.bound_m,
            database_version=self._known.database_version,
            line_version=self._known.line_version,
        )


def _gnss(position: TrainPosition) -> tuple[float, float] | None:
    """GNSS's place minus the position held, in the direction of running, and its bound."""
    for source in position.sources:
        if source.source != "gnss" or source.difference_m is None or source.allowed_m is None:
            continue
        if source.taken and source.age_s <= FRESH_GNSS_S and position.direction is not None:
            return direction_sign(position.direction) * source.difference_m, source.allowed_m
    return None


def _evidence(choice: Choice, odometry: Odometry) -> BranchEvidence:
    return BranchEvidence(
        t_ns=odometry.t_ns,
        junction_axis_m=choice.junction_axis_m,
        decided=choice.decided,
        chances=tuple(BranchChance(branch=name, probability=min(chance, 1.0)) for name, chance in choice.chances),
        reason=choice.reason,
    )
