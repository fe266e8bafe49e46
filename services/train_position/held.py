"""What is held of the train: its reach, its places, its make-up, its routes; and where it stands by them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

from schemas.line import Direction
from schemas.message import Message
from schemas.motion import Odometry
from schemas.position import PositionEvent, SourceState
from services.train_position.belief import Belief, Rules
from services.train_position.branches import MAIN, Branches
from services.train_position.claims import Claim, Interval, Source, places_of
from services.train_position.estimate import Estimate
from services.train_position.instants import Instant, Physics, Scale, Sense
from services.train_position.line_places import LinePlaces
from services.train_position.makeup import Makeup
from services.train_position.parallel_track import TrackTaken
from services.train_position.reach import Reach
from services.train_position.settings import Config
from services.train_position.wheel_scale import WheelScale

EventKind = Literal[
    "status", "contradiction", "reset", "branch", "direction", "stop_demand", "line_version", "restart", "change"
]
SOURCES: Final[tuple[Source, ...]] = ("odometry", "landmark", "gnss", "balise", "restart", "route")
MAKEUPS: Final = 16
"""Earlier make-ups that are kept for late measurements."""


@dataclass(slots=True)
class Said:
    """The last word of one source, and how it was taken."""

    t_ns: int
    taken: bool
    reason: str
    difference_m: float | None = None
    allowed_m: float | None = None


@dataclass(slots=True)
class Held:
    """Everything that the position is made of."""

    config: Config
    line: LinePlaces | None
    reach: Reach = field(init=False)
    belief: Belief = field(init=False)
    scale: WheelScale = field(init=False)
    branches: Branches = field(init=False)
    estimate: Estimate | None = None
    makeups: list[tuple[int, Makeup]] = field(default_factory=list)
    """Make-ups, each with the time from which it holds."""
    changes: int = 0
    """How often it has changed."""
    origin: str = ""
    odometry: Odometry | None = None
    """Newest message taken."""
    blind: bool = False
    """The newest instant follows without odometry."""
    confirmed: bool = True
    """A reference has confirmed the position since the service started."""
    unconfirmed: str = ""
    """Why it needs to be confirmed."""
    lost: str = "nothing has told a place yet"
    """Why there is no place, where there is none."""
    reference: str = ""
    reference_way_m: float = 0.0
    satellites_ns: int | None = None
    """When satellites last gave a place: their clock disciplines ours."""
    began_ns: int | None = None
    narrowed_way_m: float = 0.0
    """Way of the odometry at the newest reference."""
    track: str | None = None
    """Parallel track that the route set says."""
    track_taken: TrackTaken | None = None
    """And the one that the curves have told."""
    stop_demanded: bool = False
    astray: bool = False
    """The odometry has not found the end of a slip: what it says of way and speed until then is not relied on."""
    doubted: str = ""
    """Why the odometry is not believed (services.train_position.reliance); empty while it is."""
    said: dict[Source, Said] = field(default_factory=dict)
    refused: dict[str, int] = field(default_factory=dict)
    """Messages that were refused, by kind of reason."""
    refusals: list[str] = field(default_factory=list)
    """Their reasons, in words, since somebody last took them."""

    def __post_init__(self) -> None:
        """Begin with what the configuration says."""
        config = self.config
        sense: Sense = 0 if config.facing is None else (1 if config.facing == "up" else -1)
        self.reach = Reach(Physics(config.most_speed_mps, config.most_acceleration_mps2), sense)
        self.belief = Belief(Rules(config.scant_share, config.independent_s, config.independent_m))
        self.scale = WheelScale(config.scale_wander_share, config.turned_share)
        self.branches = Branches({} if self.line is None else self.line.leaves_m)
        self.makeups = [(-(2**62), Makeup(config.length_m, config.cab, forward=config.forward))]

    @property
    def makeup(self) -> Makeup:
        """Make-up of now."""
        return self.makeups[-1][1]

    def makeup_at(self, t_ns: int) -> Makeup:
        """Make-up that held at a time."""
        return next((makeup for since_ns, makeup in reversed(self.makeups) if since_ns <= t_ns), self.makeups[0][1])

    def sense_at(self, t_ns: int) -> int:
        """Sense of forward at a time: another one before it turned round."""
        turned = (self.makeup.flips - self.makeup_at(t_ns).flips) % 2
        return -self.reach.sense if turned else self.reach.sense

    def change_makeup(self, t_ns: int, makeup: Makeup) -> None:
        """Another make-up from a time on."""
        self.changes += 1
        self.makeups.append((t_ns, makeup))
        del self.makeups[:-MAKEUPS]

    def track_on(self, span: Interval) -> str | None:
        """Parallel track of the train; None where there is none, or nothing tells it, or what tells it disagrees."""
        if self.line is not None and not self.line.has_parallel(span.least_m, span.greatest_m):
            return None
        taken = self.track_taken
        if taken is None:
            return self.track
        return taken.track if self.track in {None, taken.track} else None

    def leave_track(self, span: Interval) -> None:
        """Forget what the curves have told of a stretch that the train has left."""
        taken = self.track_taken
        if taken and (span.least_m > taken.stretch.greatest_m or span.greatest_m < taken.stretch.least_m):
            self.track_taken = None

    @property
    def facing(self) -> int:
        """+1 when the front end looks towards rising `axis_m`, -1 towards falling, 0 when that is not known."""
        return self.reach.sense * self.makeup.sign

    @property
    def direction(self) -> Direction | None:
        """`facing` in words."""
        if self.facing == 0:
            return None
        return "up" if self.facing > 0 else "down"

    def clock_bound_s(self, t_ns: int) -> float:
        """Largest difference between the clocks of sources."""
        since_ns = self.satellites_ns if self.satellites_ns is not None else self.began_ns
        holdover_s = 0.0 if since_ns is None else max(t_ns - since_ns, 0) / 1e9
        return self.config.clock_bound_s + self.config.holdover * holdover_s

    def clock_bound_m(self, then: Instant) -> float:
        """Metres that this makes at an instant."""
        return (abs(then.speed_mps) + then.speed_bound_mps) * self.clock_bound_s(then.t_ns)

    def scale_now(self) -> Scale:
        """Limits of the wheel's relative error."""
        return self.scale.now(self.reach.share)

    def places(self) -> Interval | None:
        """Where the front end may be now, the clock's metres included."""
        now = self.reach.now
        return None if now is None else self.places_at(now)

    def places_at(self, then: Instant) -> Interval | None:
        """Where it may have been at an instant, as far as is known by now."""
        offsets = self.belief.offsets()
        if offsets is None:
            return None
        found, clock_m = places_of(offsets, then), self.clock_bound_m(then)
        return Interval(found.least_m - clock_m, found.greatest_m + clock_m)

    def estimate_m(self, places: Interval, moved_m: float = 0.0) -> float:
        """Likeliest place `moved_m` further on, inside of those possible."""
        if self.estimate is None:
            return (places.least_m + places.greatest_m) / 2.0
        return places.clip(self.estimate.axis_m + moved_m)

    def span(self, places: Interval) -> Interval:
        """From the rearmost to the foremost place that the train may cover."""
        length_m = self.makeup.length_m
        behind_m = length_m if self.facing >= 0 else 0.0
        ahead_m = length_m if self.facing <= 0 else 0.0
        return Interval(places.least_m - behind_m, places.greatest_m + ahead_m)

    def branch(self, places: Interval) -> str | None:
        """Branch of the front end; None while it is undecided."""
        return self.branches.of(places, self.span(places))

    def chainage_m(self, axis_m: float, branch: str | None) -> float | None:
        """Kilometrage of a place."""
        if self.line is None or branch is None:
            return None
        return self.line.chainage_m(branch or MAIN, axis_m)

    def say(self, source: Source, t_ns: int, reason: str, *, taken: bool) -> None:
        """Note the last word of a source."""
        self.said[source] = Said(t_ns, taken, reason)

    def refuse(self, source: Source | None, t_ns: int, kind: str, reason: str) -> list[Message]:
        """Count a message that cannot be used."""
        self.refused[kind] = self.refused.get(kind, 0) + 1
        self.refusals.append(reason)
        if source is not None:
            self.say(source, t_ns, reason, taken=False)
        return []

    def event(self, kind: EventKind, text: str, t_ns: int, axis_m: float | None = None) -> PositionEvent:
        """Something people should know."""
        branch = None if axis_m is None else self.branch(Interval(axis_m, axis_m))
        chainage_m = None if axis_m is None else self.chainage_m(axis_m, branch)
        return PositionEvent(t_ns=t_ns, kind=kind, text=text, axis_m=axis_m, chainage_m=chainage_m)

    def lose(self, reason: str) -> None:
        """Forget the place."""
        self.belief.forget()
        self.estimate = None
        self.lost = reason

    def states(self, t_ns: int) -> tuple[SourceState, ...]:
        """The last word of every source that has spoken."""
        return tuple(
            SourceState(
                source=source,
                taken=said.taken,
                age_s=max(t_ns - said.t_ns, 0) / 1e9,
                difference_m=said.difference_m,
                allowed_m=said.allowed_m,
                reason=said.reason,
            )
            for source in SOURCES
            if (said := self.said.get(source)) is not None
        )


def is_reference(claim: Claim) -> bool:
    """Whether a claim is that of a landmark or a balise."""
    return claim.source in {"landmark", "balise"}
