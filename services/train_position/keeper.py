"""Keeps the position of one train: messages in, messages out. Pure: time comes with the messages.

Measurements wait until the odometry has reached their time, and are then taken at their own time, so that
the order in which late ones arrive does not matter. Every message of the odometry is answered with a
position; what happened besides comes before it.
"""

from __future__ import annotations

import bisect
from typing import Final

from schemas.gnss import Fix, FrontEnd
from schemas.message import Message
from schemas.motion import Odometry, SlipEpisode
from schemas.position import BalisePassage, BranchEvidence, LandmarkMatch, TrainChange
from services.train_position.changes import apply_change, apply_evidence
from services.train_position.claims import Claim, Source
from services.train_position.first_place import FirstPlace
from services.train_position.held import Held
from services.train_position.instants import Instant, Sense
from services.train_position.lateness import Lateness
from services.train_position.line_places import LinePlaces
from services.train_position.odometry_steps import OdometrySteps
from services.train_position.position_message import message_of
from services.train_position.references import balise_claim, landmark_claim
from services.train_position.satellites import Satellites
from services.train_position.sense import SenseFinder
from services.train_position.settings import Config
from services.train_position.snapshot import Snapshot, snapshot_of
from services.train_position.weighing import weigh

Sight = LandmarkMatch | BalisePassage | FrontEnd | Fix
Measurement = Sight | BranchEvidence | TrainChange
MOST_WAITING: Final = 500
FUTURE_S: Final = 60.0
"""A measurement stamped further ahead of the odometry has a wrong time."""
BOTH_S: Final = 2.0
"""Single fixes are left out while all antennas together have spoken so lately."""
KNOWN: Final = 512
"""Measurements that are remembered, to leave out repetitions."""
MOST_UNORIENTED: Final = 300
"""Claims that are kept until the sense is known."""
SLOWEST_MPS: Final = 2.0
"""Slower, the sign of the satellites' speed does not tell which way the vehicle stands."""


class PositionKeeper:
    """The position of one train."""

    def __init__(self, config: Config, line: LinePlaces | None = None, kept: Snapshot | None = None) -> None:
        """Begin with what the configuration says, and with what was kept before a restart."""
        self.held = Held(config, line)
        self._steps = OdometrySteps(self.held, kept)
        self._satellites = Satellites()
        self._sense = SenseFinder()
        self._first = FirstPlace()
        self._waiting: list[tuple[int, int, Measurement, str]] = []
        self._number = 0
        self._seen: dict[tuple[str, str, int], None] = {}
        self._status = ""
        self._lateness = Lateness()
        self._together_ns: int | None = None
        self._unoriented: list[Claim] = []
        """Claims since the newest beginning, while the sense is not known."""
        self._branch: str | None = None
        self._told_version = ""

    @property
    def refused(self) -> dict[str, int]:
        """Messages that were refused, by kind of reason."""
        return self.held.refused

    def take_refusals(self) -> list[str]:
        """Reasons of refusals since the last call."""
        found, self.held.refusals = self.held.refusals, []
        return found

    def snapshot(self) -> Snapshot | None:
        """State to survive a restart."""
        return snapshot_of(self.held, self._steps.sure())

    def on_message(self, message: Message, device: str = "", heard_s: float | None = None) -> list[Message]:
        """Take any message that the position is made of, given the device in its key; others do nothing.

        `heard_s`: when it came, by a clock that never steps; without it nothing is taken to be late.
        """
        match message:
            case Odometry():
                return self.on_odometry(message, heard_s)
            case SlipEpisode():
                return self.on_slip(message)
            case Fix():
                return self.on_fix(message, device)
            case BalisePassage():
                return self.on_balise(message, device)
            case LandmarkMatch() | FrontEnd() | BranchEvidence() | TrainChange():
                return self._take(message, _name(message))
            case _:
                return []

    def on_odometry(self, odometry: Odometry, heard_s: float | None = None) -> list[Message]:
        """Go on to a message of the odometry; the last message returned is the position there, or now if it is late."""
        before = self.held.reach.now
        told = self._steps.step(odometry)
        if told is not None and before is not None and odometry.t_ns < before.t_ns:
            self._lateness.forget()
        late_s = 0.0 if heard_s is None else self._lateness.of(odometry.t_ns, heard_s)
        if late_s < self.held.config.late_s:
            return [] if told is None else told + self._after_step(odometry.t_ns)
        late_ns = round(late_s * 1e9)
        if told is not None:
            return told + self._after_step(odometry.t_ns, late_ns, late_s)
        # Physics has gone on beyond the message: it tells nothing, but the position goes on to now.
        ahead_ns = 0 if before is None else odometry.t_ns + late_ns - before.t_ns
        return self._after_step(before.t_ns, ahead_ns, late_s) if before is not None and ahead_ns > 0 else []

    def on_time(self, now_ns: int) -> list[Message]:
        """Go on without odometry, once it has been silent; nothing while it speaks."""
        first_ns = self._waiting[0][0] if self._waiting else None
        told = self._steps.without(now_ns, first_ns)
        return [] if told is None else told + self._after_step(now_ns)

    def on_slip(self, episode: SlipEpisode) -> list[Message]:
        """Hear of a slip: without re-adhesion the train is to be stopped, and the odometry no longer believed."""
        if episode.phase == "not_found" and episode.origin == self.held.origin:
            self.held.astray = True
        if not episode.stop_demanded or self.held.stop_demanded:
            return []
        self.held.stop_demanded = True
        return [self.held.event("stop_demand", f"the train should be stopped: {episode.reason}", episode.t_ns)]

    def on_landmark(self, match: LandmarkMatch) -> list[Message]:
        """Hear of a landmark."""
        return self._take(match, _name(match))

    def on_balise(self, passage: BalisePassage, device: str = "") -> list[Message]:
        """Hear of a balise."""
        return self._take(passage, f"balise:{passage.balise}:{device}")

    def on_front_end(self, message: FrontEnd) -> list[Message]:
        """Hear of all antennas together."""
        return self._take(message, _name(message))

    def on_fix(self, message: Fix, device: str) -> list[Message]:
        """Hear of one antenna."""
        if device not in self.held.config.antennas:
            return []
        return self._take(message, f"fix:{device}", device)

    def on_branch(self, evidence: BranchEvidence) -> list[Message]:
        """Hear of evidence for a branch."""
        return self._take(evidence, _name(evidence))

    def on_change(self, change: TrainChange) -> list[Message]:
        """Hear that something about the train has changed."""
        return self._take(change, _name(change))

    def _take(self, message: Measurement, name: str, device: str = "") -> list[Message]:
        """Let a measurement wait for its turn; at once when the odometry is past its time."""
        held = self.held
        seen = (name, type(message).__name__, message.t_ns)
        if seen in self._seen:
            return held.refuse(None, message.t_ns, "repeated", f"{name} was heard before")
        self._seen[seen] = None
        if len(self._seen) > KNOWN:
            del self._seen[next(iter(self._seen))]
        now = held.reach.now
        if now is not None and message.t_ns > now.t_ns + FUTURE_S * 1e9:
            return held.refuse(None, message.t_ns, "time", f"{name} from {(message.t_ns - now.t_ns) / 1e9:.0f} s ahead")
        if now is not None and message.t_ns <= now.t_ns:
            return self._apply(message, device)
        bisect.insort(self._waiting, (message.t_ns, self._number, message, device), key=lambda one: one[:2])
        self._number += 1
        if len(self._waiting) > MOST_WAITING:
            del self._waiting[0]
            return held.refuse(
                None, message.t_ns, "waiting", f"more than {MOST_WAITING} measurements wait for odometry"
            )
        return []

    def _after_step(self, t_ns: int, ahead_ns: int = 0, late_s: float = 0.0) -> list[Message]:
        told: list[Message] = []
        while self._waiting and self._waiting[0][0] <= t_ns:
            _, _, message, device = self._waiting.pop(0)
            told += self._apply(message, device)
        told += self._routes(t_ns)
        position = message_of(self.held, t_ns, ahead_ns, late_s)
        if position.status != self._status:
            text = f"{position.status}: {position.reason}" if position.reason else position.status
            told.append(self.held.event("status", text, t_ns, position.axis_m))
            self._status = position.status
        return [*told, position]

    def _apply(self, message: Measurement, device: str) -> list[Message]:
        held = self.held
        match message:
            case TrainChange():
                if message.kind in {"moved_cold", "cab"}:
                    self._sense.forget()
                return apply_change(held, message)
            case BranchEvidence():
                return apply_evidence(held, message)
            case LandmarkMatch() | BalisePassage() | FrontEnd() | Fix():
                return self._measure(message, device)

    def _measure(self, message: Sight, device: str) -> list[Message]:
        """Take a measurement of the place at its own time."""
        source = _source(message)
        then = self.held.reach.at(message.t_ns)
        if then is None:
            text = f"{source}: older than the history of the odometry"
            return self.held.refuse(source, message.t_ns, "old", text)
        match message:
            case LandmarkMatch():
                return self._landmark(message, then)
            case BalisePassage():
                return self._weigh(balise_claim(self.held, message, then), "balise", then)
            case FrontEnd():
                return self._front_end(message, then)
            case Fix():
                return self._fix(message, device, then)

    def _landmark(self, match: LandmarkMatch, then: Instant) -> list[Message]:
        held = self.held
        version = held.line.version if held.line is not None else ""
        if match.accepted and match.line_version != version:
            text = f"landmark {match.landmark} is of version {match.line_version} of the line, the train has {version}"
            told = held.refuse("landmark", match.t_ns, "line_version", text)
            if text != self._told_version:
                self._told_version = text
                return [*told, held.event("line_version", text, match.t_ns)]
            return told
        claim = landmark_claim(held, match, then)
        if not match.accepted:
            held.say("landmark", match.t_ns, str(claim), taken=False)
            return []
        if isinstance(claim, Claim) and held.reach.sense == 0 and abs(then.speed_mps) > SLOWEST_MPS:
            rising = (match.direction == "up") == (then.speed_mps > 0.0)
            told = self._found_sense(1 if rising else -1, f"landmark {match.landmark}", match.t_ns)
            return told + self._weigh(claim, "landmark", held.reach.at(match.t_ns) or then)
        return self._weigh(claim, "landmark", then)

    def _front_end(self, message: FrontEnd, then: Instant) -> list[Message]:
        told: list[Message] = []
        if self.held.reach.sense == 0:
            told += self._found_sense(self._satellites.faces(self.held, message), "the antennas' order", message.t_ns)
            then = self.held.reach.at(message.t_ns) or then
        claim = self._satellites.front_end(self.held, message, then)
        if isinstance(claim, Claim):
            self._together_ns = message.t_ns
        return told + self._weigh(claim, "gnss", then)

    def _fix(self, message: Fix, device: str, then: Instant) -> list[Message]:
        if self._together_ns is not None and 0 <= message.t_ns - self._together_ns < BOTH_S * 1e9:
            return []
        told: list[Message] = []
        if self.held.reach.sense == 0:
            along_mps = self._satellites.along_mps(self.held, message, then)
            if along_mps is not None and min(abs(along_mps), abs(then.speed_mps)) > SLOWEST_MPS + then.speed_bound_mps:
                sense = 1 if (along_mps > 0.0) == (then.speed_mps > 0.0) else -1
                told += self._found_sense(sense, "the satellites' speed along the line", message.t_ns)
                # Its sums were made anew.
                then = self.held.reach.at(message.t_ns) or then
        return told + self._weigh(self._satellites.fix(self.held, device, message, then), "gnss", then)

    def _weigh(self, claim: Claim | str, source: Source, then: Instant) -> list[Message]:
        """Weigh a claim, or note why there is none."""
        held = self.held
        if isinstance(claim, str):
            if source == "gnss":
                held.say(source, then.t_ns, claim, taken=False)
                return []
            return held.refuse(source, then.t_ns, source, claim)
        told: list[Message] = []
        if held.reach.sense == 0:
            found = self._sense.take(claim.axis_m, claim.bound_m + then.provisional_m, then.distance_m)
            told += self._found_sense(found, f"the way from place to place, at {claim.name}", claim.t_ns)
            then = held.reach.at(claim.t_ns) or then
            if held.reach.sense == 0 and claim.t_ns >= held.reach.plain_since_ns:
                self._unoriented = [*self._unoriented[-MOST_UNORIENTED:], claim]
        if not held.belief.alternatives:
            claims = self._first.take(held, claim, then)
            for one, when in claims:
                told += weigh(held, one, when)
            return told
        return told + weigh(held, claim, then)

    def _found_sense(self, sense: int, how: str, t_ns: int) -> list[Message]:
        """Take the sense in; what was claimed while it was not known is weighed anew by it."""
        held = self.held
        if sense == 0 or held.reach.sense != 0:
            return []
        oriented: Sense = 1 if sense > 0 else -1
        since_ns = held.reach.plain_since_ns
        claims = sorted((one for one in self._unoriented if one.t_ns >= since_ns), key=lambda one: one.t_ns)
        self._unoriented = []
        self._sense.forget()
        if claims and not held.belief.contradicted:
            held.reach.orient(oriented, held.scale_now())
            held.belief.forget()
            held.estimate = None
            for claim in claims:
                then = held.reach.at(claim.t_ns)
                if then is not None:
                    weigh(held, claim, then)
        held.reach.sense = oriented
        return [held.event("direction", f"the front end looks {held.direction}, by {how}", t_ns)]

    def _routes(self, t_ns: int) -> list[Message]:
        """Let routes come back, commit the one that is set; say when the branch is decided."""
        held = self.held
        places = held.places()
        if places is None:
            return []
        span = held.span(places)
        held.branches.passed(span)
        held.branches.commit(span)
        held.leave_track(span)
        branch = held.branch(places)
        if branch is None or branch == self._branch:
            return []
        first, self._branch = self._branch is None, branch
        if first and not branch:
            return []
        return [held.event("branch", f"on {branch or 'the main line'}", t_ns, held.estimate_m(places))]


def _source(message: Sight) -> Source:
    """Source that a measurement belongs to."""
    if isinstance(message, LandmarkMatch):
        return "landmark"
    return "balise" if isinstance(message, BalisePassage) else "gnss"


def _name(message: LandmarkMatch | FrontEnd | BranchEvidence | TrainChange) -> str:
    """What tells a measurement from others of its time."""
    match message:
        case LandmarkMatch():
            return f"landmark:{message.landmark}:{message.accepted}"
        case FrontEnd():
            return "front_end"
        case BranchEvidence():
            return f"branch:{message.junction_axis_m}:{message.decided}"
        case TrainChange():
            return f"change:{message.kind}"
