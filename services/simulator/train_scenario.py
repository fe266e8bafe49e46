"""Scenarios of a whole train: its line or a track drawn at random, its run, its sensors, faults with times.

Told apart from a receiver's scenario (scenario.py) by having `line = "…"` or a `[track]` table.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from schemas.line import Direction
from schemas.position import FaultKind
from services.simulator.fault_sizes import size_fault
from services.simulator.motion_settings import (
    VEHICLES,
    Adhesion,
    Driving,
    Imu,
    MotionSettings,
    NotNegative,
    Part,
    Positive,
    Tacho,
    Vehicle,
)
from services.simulator.radio_faults import Befalls
from services.simulator.radio_settings import RadioSettings
from services.simulator.random_track import TrackSettings
from services.simulator.scenario import Name, Receiver, ScenarioError, Sky, require_finite
from services.simulator.scenario_limits import beyond_limits
from services.simulator.weather_along import WeatherSettings


class Journey(Part, frozen=True, kw_only=True):
    """Where the train runs."""

    branch: str = ""
    """Id of the branch that it takes; empty: the main line."""
    direction: Direction = "up"
    stops: tuple[str, ...] = ()
    """Ids of the stations that it calls at; all on its way when left out."""
    start_axis_m: NotNegative | None = None
    """Where the front end starts; the first stop when left out."""
    turns_back: bool = True
    """At its last stop the other cab takes over."""
    sensors: Literal["cab", "vehicle"] = "cab"
    """Each cab has its own sensors, which look forward when it leads; or one set looks where cab A looks, always, and
    counts backwards while cab B leads."""
    propels: bool = False
    """At its last stop no cab takes over: the train is propelled back, driven from the same cab, with the one set of
    sensors that it has. Its front end is the rear one then."""
    irregularity: NotNegative = 1.0
    """Of the rail's level, cross level and alignment, against a maintained line."""
    irregularity_seed: Annotated[int, Meta(ge=0)] = 1
    """Of the rail alone: trains with other seeds meet the same rail."""

    @property
    def fixed_sensors(self) -> bool:
        """Whether one set looks the same way on every trip."""
        return self.propels or self.sensors == "vehicle"


class Gnss(Part, frozen=True, kw_only=True):
    """The antenna."""

    antenna_behind_front_m: float = 0.0
    antenna_above_rail_m: Positive = 4.0


class TimedFault(Befalls, frozen=True, kw_only=True):
    """A fault of the train, its sensors, or the radios of its line."""

    kind: FaultKind
    at_s: NotNegative
    """Since the start."""
    seconds: Positive | None = None
    """None: until the end."""
    magnitude: float | None = None
    """None: a usual one (docs/simulator.md)."""

    def __post_init__(self) -> None:
        """Refuse a magnitude that no such fault has."""
        if wrong := size_fault(self.kind, self.magnitude):
            raise ValueError(wrong)

    @property
    def befalls(self) -> Befalls:
        """Where it is."""
        return Befalls(
            start_axis_m=self.start_axis_m, end_axis_m=self.end_axis_m, radio=self.radio, channel=self.channel
        )


class TrainScenario(Part, frozen=True, kw_only=True):
    """Everything that decides how a train runs and what its sensors say, but the seed's draws."""

    name: Name
    about: str = ""
    seed: Annotated[int, Meta(ge=0)] = 1
    start_gps_week: Annotated[int, Meta(ge=1024, le=8191)] = 2412
    start_tow_s: Annotated[float, Meta(ge=0.0, lt=604_800.0)] = 180_000.0
    duration_s: Positive | None = None
    """Of a simulation into files; to the last stop when left out."""
    line: str | None = None
    """A line that comes with Kirotei, or a line file."""
    track: TrackSettings | None = None
    """Instead of a line."""
    journey: Journey = Journey()
    vehicle: Literal["conventional", "axle_load_controlled", "idle_axle"] | Vehicle = "conventional"
    driving: Driving = Driving()
    adhesion: Adhesion = Adhesion()
    imu: Imu = Imu()
    tacho: Tacho = Tacho()
    max_gradient_permille: Positive = 35.0
    gnss: Gnss | None = None
    """None: no receiver on board."""
    sky: Sky = Sky(systems="GE")
    receiver: Receiver = Receiver()
    radio: RadioSettings | None = None
    """None: no radio device on board."""
    weather: WeatherSettings = WeatherSettings()
    balise_reader_behind_front_m: float = 0.0
    faults: tuple[TimedFault, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a scenario without a place to run, and fields that contradict each other."""
        if (self.line is None) == (self.track is None):
            msg = "give either `line` or a [track]"
            raise ValueError(msg)
        if self.track is not None and self.gnss is not None:
            msg = "a track drawn at random lies nowhere on Earth: no [gnss] with [track]"
            raise ValueError(msg)
        if self.track is not None and self.radio is not None:
            msg = "a track drawn at random has no radios: no [radio] with [track]"
            raise ValueError(msg)
        interval = self.receiver.interval_s / 0.1
        if abs(interval - round(interval)) > 1e-9:  # noqa: PLR2004 - rounding alone
            msg = "receiver.interval_s must be a multiple of 0.1 s beside a train"
            raise ValueError(msg)
        if self.adhesion.random_gap_s is not None and not sum(self.adhesion.weights.values()) > 0.0:
            msg = "adhesion.weights leave no kind of slip to draw"
            raise ValueError(msg)
        if self.tacho.missing_teeth >= self.motion.vehicle.teeth:
            msg = f"tacho.missing_teeth {self.tacho.missing_teeth}: the wheel has {self.motion.vehicle.teeth}"
            raise ValueError(msg)
        for name, low, high in self._ranges():
            if not 0.0 <= low <= high:
                msg = f"{name} ({low:g}, {high:g}) is no rising range"
                raise ValueError(msg)

    def _ranges(self) -> list[tuple[str, float, float]]:
        tables = {"driving": self.driving, "track": self.track}
        return [
            (f"{table}.{field}", *getattr(part, field))
            for table, part in tables.items()
            if part is not None
            for field in part.__struct_fields__
            if isinstance(getattr(part, field), tuple)
        ]

    @property
    def motion(self) -> MotionSettings:
        """What the motion of the train needs."""
        vehicle = VEHICLES[self.vehicle] if isinstance(self.vehicle, str) else self.vehicle
        return MotionSettings(
            vehicle=vehicle,
            driving=self.driving,
            adhesion=self.adhesion,
            imu=self.imu,
            tacho=self.tacho,
            max_gradient_permille=self.max_gradient_permille,
        )


def is_train_scenario(text: str) -> bool:
    """Whether a TOML text is a scenario of this kind; what is no TOML is none."""
    try:
        table = msgspec.toml.decode(text)
    except msgspec.DecodeError:
        return False
    return isinstance(table.get("line"), str) or "track" in table


def train_scenario_from_toml(text: str) -> TrainScenario:
    """Scenario in a TOML text. Raises ScenarioError with the path of the field that is wrong."""
    try:
        scenario = msgspec.toml.decode(text, type=TrainScenario)
    except msgspec.DecodeError as error:
        raise ScenarioError(str(error)) from error
    require_finite(msgspec.to_builtins(scenario), "$")
    for wrong in beyond_limits(scenario):
        raise ScenarioError(wrong)
    return scenario
