"""Radio passes in time-lapse, one after another, with faults that are switched meanwhile; the line is a file's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import msgspec

from schemas.radio import RadioMeasurement, Weather
from services.simulator.fault_board import FaultBoard
from services.simulator.radio_live import pass_messages, timed
from services.simulator.radio_passes import NS, RadioPass, begin_s, radio_pass, world_of
from services.simulator.radio_scenario import RadioScenario
from services.simulator.radio_world import RadioWorld
from services.simulator.scenario_file import radio_line_for
from services.simulator.weather_along import stations


@dataclass(frozen=True, slots=True)
class Lapsed:
    """One pass and its weather."""

    day: int
    """Counted from 0."""
    begin_s: float
    weather: tuple[Weather, ...]
    taken: RadioPass
    world: RadioWorld

    def readings(self, train: str) -> Iterator[RadioMeasurement]:
        """What the device of a train said, with its place."""
        return pass_messages(self.taken, self.world, train)


class RadioLapse:
    """The passes of a scenario, moved so that the last one was yesterday."""

    def __init__(self, scenario: RadioScenario, seed: int, now_ns: int) -> None:
        """Lay out the radios. Raises ScenarioError for a line that cannot be read."""
        midnight = datetime.fromtimestamp(now_ns // NS, UTC).replace(hour=0, minute=0, second=0)
        start = midnight - timedelta(days=scenario.passes.days)
        self._scenario = msgspec.structs.replace(
            scenario, seed=seed, passes=msgspec.structs.replace(scenario.passes, start=start)
        )
        line, self._chainage = radio_line_for(scenario)
        self._world = world_of(scenario, line)
        self._number = 0
        self.faults = FaultBoard()

    @property
    def now_s(self) -> float:
        """When the next pass begins, since the first day began."""
        return begin_s(self._scenario, self._number) - self._scenario.passes.start.timestamp()

    def step(self) -> Lapsed | None:
        """The next pass; None after the last one."""
        scenario, number = self._scenario, self._number
        if number >= scenario.passes.days * scenario.passes.per_day:
            return None
        self.faults.at(self.now_s)
        switched = timed(self.faults.radio(), scenario.passes.start.timestamp())
        taken = radio_pass(scenario, self._world, number, self._chainage, switched)
        start_s = begin_s(scenario, number)
        every = (*scenario.radio_faults, *switched)
        places = stations(self._world.line.length_m)
        weather = tuple(self._world.weather.message(round(start_s) * NS, axis_m, every) for axis_m in places)
        self._number += 1
        return Lapsed(number // scenario.passes.per_day, start_s, weather, taken, self._world)
