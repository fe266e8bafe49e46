"""What a wayside radio hears of simulated trains; its line is a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.position import MotionTruth
from schemas.radio import RadioMeasurement
from services.line.alignment import alignment_of
from services.line.line_file import load_line
from services.simulator.radio_live import TrainRadio
from services.simulator.radio_settings import RadioSettings
from services.simulator.radio_world import RadioWorld
from services.simulator.scenario import ScenarioError
from services.simulator.scenario_file import LoadedRoute, radio_line_of
from services.simulator.weather_along import WeatherAlong, WeatherSettings


class WaysideRadioSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A wayside radio, simulated in place of a train: it hears the simulated trains of the line."""

    site: Annotated[str, Meta(min_length=1)]
    """Id of one of the line's `radio_sites`."""
    line_file: str = "demo"
    radio: RadioSettings = RadioSettings()
    weather: WeatherSettings = WeatherSettings()


class WaysideRadio:
    """One wayside radio. The way from train to radio is as good as the way back."""

    def __init__(self, settings: WaysideRadioSettings) -> None:
        """Lay out the radios. Raises ScenarioError for a site that the line does not have, ValueError, OSError."""
        line = load_line(Path(settings.line_file)).line
        if settings.site not in [site.id for site in line.radio_sites]:
            msg = f"line {line.id}: no radio site {settings.site!r}"
            raise ScenarioError(msg)
        self._site = settings.site
        self._world = RadioWorld(
            radio_line_of(LoadedRoute(line, alignment_of(line))), settings.radio, WeatherAlong(settings.weather)
        )
        self._trains: dict[str, tuple[TrainRadio, float, bool]] = {}

    def hear(self, train: str, truth: MotionTruth) -> tuple[RadioMeasurement, ...]:
        """What the radio says of a train that is within reach, once a measuring period; it knows who sends."""
        device, axis_m, rises = self._trains.get(train) or (TrainRadio(self._world, truth.t_ns), truth.axis_m, True)
        rises = truth.axis_m > axis_m if truth.axis_m != axis_m else rises
        self._trains[train] = device, truth.axis_m, rises
        heard = device.readings(truth, 0, (), rises=rises)
        return tuple(
            msgspec.structs.replace(one, side="wayside", train=train, cell="")
            for one in heard
            if one.radio == self._site
        )
