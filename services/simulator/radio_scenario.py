"""Scenarios of radio passes: a train that runs over a line again and again for days, without anything but its radio.

Told apart from other scenarios by their [passes] table.
"""

from __future__ import annotations

from datetime import UTC, datetime
from math import inf
from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.line import Direction, RadioSite
from services.simulator.motion_settings import NotNegative, Part, Positive
from services.simulator.radio_faults import DAY_S, USUAL_RADIO, Befalls, RadioFault, RadioFaultKind
from services.simulator.radio_settings import RadioSettings
from services.simulator.radio_world import RadioLine
from services.simulator.scenario import Name, ScenarioError, require_finite
from services.simulator.weather_along import WeatherSettings

Count = Annotated[int, Meta(ge=1, le=100)]


class Straight(Part, frozen=True, kw_only=True):
    """A line that is nothing but straight, with radios at even distances."""

    sites: Count = 5
    spacing_m: Positive = 2000.0
    aside_m: Positive = 5.0
    channels: Annotated[tuple[str, ...], Meta(min_length=1)] = ("f1", "f2", "f3", "f4", "f5")
    """Taken in turn."""

    def line(self) -> RadioLine:
        """Radios half a spacing from either end."""
        sites = tuple(
            RadioSite(
                id=f"R{k + 1:02d}",
                axis_m=(k + 0.5) * self.spacing_m,
                aside_m=self.aside_m,
                channels=(self.channels[k % len(self.channels)],),
            )
            for k in range(self.sites)
        )
        return RadioLine(self.sites * self.spacing_m, sites)


class DatedFault(Befalls, frozen=True, kw_only=True):
    """A fault of the radios that lasts for days."""

    kind: RadioFaultKind
    from_day: float = 0.0
    """Since the first day's beginning."""
    to_day: float | None = None
    magnitude: float | None = None
    """None: a usual one (docs/simulator.md)."""


class Passes(Part, frozen=True, kw_only=True):
    """When and how the train runs."""

    days: Annotated[int, Meta(ge=1, le=3650)] = 60
    per_day: Annotated[int, Meta(ge=1, le=200)] = 2
    directions: Annotated[tuple[Direction, ...], Meta(min_length=1)] = ("up", "down")
    """Taken in turn, from each day's first pass on."""
    speed_mps: Annotated[float, Meta(gt=0.0, le=140.0)] = 12.5
    """All the way, without a stop."""
    from_axis_m: NotNegative = 0.0
    """Of the stretch that the train runs over."""
    to_axis_m: Positive | None = None
    """None: to the line's end."""
    start: datetime = datetime(2026, 1, 5, tzinfo=UTC)
    """Beginning of the first day."""
    first_s: Annotated[float, Meta(ge=0.0, lt=DAY_S)] = 21_600.0
    """Of a day: when its first pass begins; the others follow evenly until it ends."""
    train: Name = "T1"

    def __post_init__(self) -> None:
        """Refuse a day without its zone, and a stretch that is none."""
        if self.to_axis_m is not None and self.to_axis_m <= self.from_axis_m:
            msg = f"passes: {self.from_axis_m:g} to {self.to_axis_m:g} is no stretch"
            raise ValueError(msg)
        if self.start.tzinfo is None:
            msg = "passes.start needs a zone, as in 2026-01-05T00:00:00Z"
            raise ValueError(msg)


class RadioScenario(Part, frozen=True, kw_only=True):
    """Everything that decides what a train's radio hears over days of passes, but the seed's draws."""

    name: Name
    about: str = ""
    seed: Annotated[int, Meta(ge=0)] = 1
    """Of what differs from pass to pass; the line's shadows have their own."""
    line: str | None = None
    """A line that comes with Kirotei, or a line file."""
    straight: Straight | None = None
    """Instead of a line."""
    radio: RadioSettings = RadioSettings()
    weather: WeatherSettings = WeatherSettings()
    passes: Passes
    faults: tuple[DatedFault, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a scenario without a place to run."""
        if (self.line is None) == (self.straight is None):
            msg = "give either `line` or a [straight]"
            raise ValueError(msg)

    @property
    def radio_faults(self) -> tuple[RadioFault, ...]:
        """The faults, with Unix times."""
        begin_s = self.passes.start.timestamp()
        return tuple(
            RadioFault(
                kind=one.kind,
                magnitude=USUAL_RADIO[one.kind] if one.magnitude is None else one.magnitude,
                where=one,
                since_s=begin_s + one.from_day * DAY_S,
                until_s=inf if one.to_day is None else begin_s + one.to_day * DAY_S,
            )
            for one in self.faults
        )


def is_radio_scenario(text: str) -> bool:
    """Whether a TOML text is a scenario of this kind; what is no TOML is none."""
    try:
        table = msgspec.toml.decode(text)
    except msgspec.DecodeError:
        return False
    return "passes" in table


def radio_scenario_from_toml(text: str) -> RadioScenario:
    """Scenario in a TOML text. Raises ScenarioError with the path of the field that is wrong."""
    try:
        scenario = msgspec.toml.decode(text, type=RadioScenario)
    except msgspec.DecodeError as error:
        raise ScenarioError(str(error)) from error
    require_finite(msgspec.to_builtins(scenario), "$")
    return scenario
