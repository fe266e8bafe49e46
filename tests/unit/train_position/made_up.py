"""A made-up line and made-up runs over it, with odometry and references whose words are true."""

from __future__ import annotations

from dataclasses import dataclass, field

from schemas.gnss import Fix, FrontEnd
from schemas.line import Balise, Branch, ChainagePoint, Line
from schemas.message import Message
from schemas.motion import Odometry
from schemas.position import BalisePassage, LandmarkMatch, PositionEvent, TrainPosition
from services.train_position.keeper import PositionKeeper
from services.train_position.line_places import LinePlaces
from services.train_position.makeup import Makeup
from services.train_position.settings import Config

START_NS = 1_700_000_000_000_000_000
LENGTH_M = 40_000.0
DEGREES = LENGTH_M / 111_319.49079327358
"""Along the equator."""
BALISE_EVERY_M = 500.0
LENGTH_OF_TRAIN_M = 60.0
AS_BUILT = Makeup(LENGTH_OF_TRAIN_M, "A", forward="vehicle")


def straight_line(version: str = "1") -> Line:
    """40 km along the equator, a balise every 500 m, a branch to the north at 20 km; chainage is axis plus 1000 m."""
    vertices = tuple((DEGREES * k / 4, 0.0, 0.0) for k in range(5))
    return Line(
        id="made-up",
        name="Made up",
        version=version,
        axis=vertices,
        chainage=(ChainagePoint(axis_m=0.0, chainage_m=1000.0), ChainagePoint(axis_m=39_999.0, chainage_m=40_999.0)),
        balises=tuple(
            Balise(id=f"B{k}", axis_m=k * BALISE_EVERY_M, accuracy_m=1.0) for k in range(int(LENGTH_M / BALISE_EVERY_M))
        ),
        branches=(
            Branch(
                id="north",
                name="North",
                leaves_axis_m=20_000.0,
                side="left",
                axis=((DEGREES / 2, 0.0, 0.0), (DEGREES / 2 + 0.001, 0.002, 0.0), (DEGREES / 2 + 0.001, 0.05, 0.0)),
            ),
        ),
    )


PLACES = LinePlaces(straight_line())


@dataclass
class Run:
    """A train that really is somewhere, and what its odometry and references truly say of it."""

    keeper: PositionKeeper
    axis_m: float = 1000.0
    """Of the sensors' end."""
    sense: int = 1
    wheel_error: float = 0.0
    """True way = odometry's way × (1 + this)."""
    share_bound: float = 0.02
    speed_mps: float = 0.0
    t_ns: int = START_NS
    origin: str = "o1"
    makeup: Makeup = AS_BUILT
    distance_m: float = 0.0
    way_m: float = 0.0
    excess_m: float = 0.0
    provisional_m: float = 0.0
    heard: list[Message] = field(default_factory=list)

    @property
    def front_m(self) -> float:
        """Where the front end really is."""
        return self.axis_m + self.sense * self.makeup.front_m

    @property
    def position(self) -> TrainPosition:
        """What was published last."""
        return next(one for one in reversed(self.heard) if isinstance(one, TrainPosition))

    def status(self) -> str:
        """Status published last."""
        return self.position.status

    def odometry(self, **changes: object) -> Odometry:
        """The odometry's message of now."""
        fields: dict[str, object] = {
            "t_ns": self.t_ns,
            "method": "fused",
            "origin": self.origin,
            "distance_m": self.distance_m,
            "way_m": self.way_m,
            "speed_mps": self.speed_mps,
            "speed_bound_mps": 0.3,
            "standstill": self.speed_mps == 0.0,
            "bound_m": self.share_bound * self.way_m + self.excess_m + self.provisional_m,
            "share_bound": self.share_bound,
            "excess_m": self.excess_m,
            "provisional_m": self.provisional_m,
            "status": "valid",
        }
        return Odometry(**(fields | changes))  # type: ignore[arg-type]  # fields of the message by name

    def go(self, seconds: float, acceleration_mps2: float = 0.0, step_s: float = 0.1, *, silent: bool = False) -> None:
        """Run on; the odometry speaks every step unless it is silent."""
        for _ in range(max(round(seconds / step_s), 1)):
            before_mps = self.speed_mps
            self.speed_mps += acceleration_mps2 * step_s
            moved_m = (before_mps + self.speed_mps) / 2.0 * step_s
            self.axis_m += self.sense * moved_m
            counted_m = moved_m / (1.0 + self.wheel_error)
            self.distance_m += counted_m
            self.way_m += abs(counted_m)
            self.t_ns += round(step_s * 1e9)
            if not silent:
                self.heard += self.keeper.on_odometry(self.odometry())

    def slip(self, error_m: float, bound_m: float) -> None:
        """A slip that costs the odometry so much, and says that it may be so much."""
        self.distance_m += error_m
        self.way_m += abs(error_m)
        self.excess_m += bound_m + abs(error_m)

    def front_end(self, error_m: float = 0.0, bound_m: float = 5.0, **changes: object) -> FrontEnd:
        """What all antennas together say now."""
        fields: dict[str, object] = {
            "t_ns": self.t_ns,
            "devices": ("front", "rear"),
            "agreement": "agree",
            "reason": "",
            "chainage_m": self.axis_m + 1000.0 + error_m,
            "chainage_bound_m": bound_m,
            "facing": "up" if self.sense > 0 else "down",
        }
        return FrontEnd(**(fields | changes))  # type: ignore[arg-type]  # as above

    def landmark(self, name: str, error_m: float = 0.0, bound_m: float = 10.0, **changes: object) -> LandmarkMatch:
        """What a landmark says now."""
        running = self.sense * (1 if self.speed_mps >= 0.0 else -1)
        fields: dict[str, object] = {
            "t_ns": self.t_ns,
            "landmark": name,
            "direction": "up" if running > 0 else "down",
            "accepted": True,
            "reason": "accepted",
            "origin": self.origin,
            "distance_m": self.distance_m,
            "axis_m": self.front_m + error_m,
            "correction_m": 0.0,
            "bound_m": bound_m,
            "database_version": "1",
            "line_version": "1",
        }
        return LandmarkMatch(**(fields | changes))  # type: ignore[arg-type]  # as above

    def balise(self, error_m: float = 0.0) -> BalisePassage:
        """The nearest balise, said to be passed with the reader where that makes it true up to an error."""
        number = round(self.front_m / BALISE_EVERY_M)
        facing = self.sense * self.makeup.sign
        behind_m = facing * (self.front_m - number * BALISE_EVERY_M + error_m)
        return BalisePassage(
            t_ns=self.t_ns, balise=f"B{number}", sensor_offset_m=behind_m, detection_bound_m=max(abs(error_m), 0.5)
        )

    def hear(self, message: Message, device: str = "") -> list[Message]:
        """Give the keeper a message; returns what it says."""
        told = self.keeper.on_message(message, device)
        self.heard += told
        return told

    def margin_m(self) -> tuple[float, float]:
        """Interval of the front end as it was published."""
        position = self.position
        assert position.axis_m is not None
        assert position.bound_ahead_m is not None
        assert position.bound_behind_m is not None
        up = position.direction != "down"
        above, below = position.bound_ahead_m, position.bound_behind_m
        if not up:
            above, below = below, above
        return position.axis_m - below, position.axis_m + above

    def require_true(self) -> None:
        """The published interval holds the front end, and the estimate lies in it."""
        position = self.position
        if position.status == "lost":
            assert position.axis_m is None
            return
        least_m, greatest_m = self.margin_m()
        assert position.axis_m is not None
        assert least_m - 1e-6 <= position.axis_m <= greatest_m + 1e-6
        # 1e-6 m: sums of a few thousand doubles of 1e4 m.
        assert least_m - 1e-6 <= self.front_m <= greatest_m + 1e-6, position


def run_with(config: Config | None = None, *, line: bool = True, **changes: object) -> Run:
    """A run whose keeper has heard nothing yet."""
    settings = config or Config(clock_bound_s=0.0, holdover=0.0, line_accuracy_m=0.0, forward="vehicle", state=False)
    keeper = PositionKeeper(settings, PLACES if line else None)
    return Run(keeper, **changes)  # type: ignore[arg-type]  # fields of Run by name


def events_of(run: Run, kind: str) -> list[str]:
    """Texts of the events of a kind that were told so far."""
    return [one.text for one in run.heard if isinstance(one, PositionEvent) and one.kind == kind]


def fix_of(run: Run, behind_m: float, north_deg: float = 0.0, **changes: object) -> Fix:
    """A fix of one antenna, so far behind the front end and so far to the north of the line."""
    fields: dict[str, object] = {
        "t_ns": run.t_ns,
        "gps_week": 0,
        "tow_s": 0.0,
        "method": "robust",
        "status": "fix",
        "lat_deg": north_deg,
        "lon_deg": (run.axis_m - run.sense * behind_m) / LENGTH_M * DEGREES,
        "h_m": 0.0,
        "ve_mps": run.sense * run.speed_mps,
        "vn_mps": 0.0,
        "satellites_used": 8,
        "satellites_flagged": 0,
        "bound_m": 5.0,
    }
    return Fix(**(fields | changes))  # type: ignore[arg-type]  # fields of the message by name
