"""Radio passes as files: passes.csv as `kirotei radio` takes it, and the weather that went with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import duckdb
import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.radio import Weather
from services.simulator.radio_passes import MEASURED, NS, RadioPass, begin_s, radio_passes, world_of
from services.simulator.radio_scenario import RadioScenario
from services.simulator.radio_world import RadioWorld
from services.simulator.scenario_file import radio_line_for
from services.simulator.simulation_file import write_csv
from services.simulator.weather_along import stations

PASSES_AT_ONCE: Final = 60
"""Rows of so many passes are held in memory."""
DECIMALS: Final = {"received_ratio": 3, "corrected_bits": 3, "frequency_offset_hz": 1}
TOLD: Final = tuple(name for name in MEASURED if name not in ("channel_power_dbm", "snr_db"))
WEATHER: Final = ("time", "axis_m", "reach_m", "temperature_c", "rain_mm_per_h", "snow_mm_per_h")


@dataclass(frozen=True, slots=True)
class RadioWritten:
    """What passes into files came to."""

    folder: str
    passes: int
    rows: int
    files: tuple[str, ...]


def write_radio_passes(
    scenario: RadioScenario,
    folder: Path,
    *,
    seed: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> RadioWritten:
    """Write passes.csv and weather.csv into `folder`, made if need be; both or neither.

    `seed` replaces the scenario's own. Raises ScenarioError, OSError.
    """
    if seed is not None:
        scenario = msgspec.structs.replace(scenario, seed=seed)
    line, chainage = radio_line_for(scenario)
    world = world_of(scenario, line)
    count, rows, done = scenario.passes.days * scenario.passes.per_day, 0, 0
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder, prefix=".simulate-") as name:
        beside = Path(name)
        going = radio_passes(scenario, world, chainage)
        with (beside / "passes.csv").open("wb") as out:
            while some := list(islice(going, PASSES_AT_ONCE)):
                rows += sum(len(one.t_ns) for one in some)
                write_rows(beside / "some.csv", some, world, header=done == 0)
                out.write((beside / "some.csv").read_bytes())
                done += len(some)
                if progress is not None:
                    progress(done / count)
        write_csv(beside / "weather.csv", WEATHER, map(_weather_row, _weather(scenario, world)))
        files = ("passes.csv", "weather.csv")
        for file in files:
            (beside / file).replace(folder / file)
    return RadioWritten(str(folder), done, rows, files)


def write_rows(path: Path, passes: Sequence[RadioPass], world: RadioWorld, *, header: bool = True) -> None:
    """Write the rows of passes; what the device did not say stays blank. Raises OSError."""
    radios = np.array([world.line.sites[one.site].id for one in world.links], object)
    channels = np.array([one.channel for one in world.links], object)
    link = np.concatenate([one.link for one in passes])
    sizes = [len(one.t_ns) for one in passes]
    table: dict[str, NDArray[Any]] = {
        "t_ns": np.concatenate([one.t_ns for one in passes]),
        "pass_id": np.repeat(np.array([one.pass_id for one in passes], object), sizes),
        "radio": radios[link],
        "channel": channels[link],
        "direction": np.repeat(np.array([one.direction for one in passes], object), sizes),
        "chainage_m": np.concatenate([one.chainage_m for one in passes]),
        "speed_mps": np.concatenate([one.speed_mps for one in passes]),
    }
    table |= {name: np.concatenate([one.measured[name] for one in passes]) for name in MEASURED}
    told = ", ".join(f"{_number(name, DECIMALS.get(name, 2))} AS {name}" for name in TOLD)
    target = str(path).replace("'", "''")
    with duckdb.connect() as base:
        base.execute("SET threads = 1")
        base.register("rows", table)
        base.execute(
            "COPY (SELECT strftime(make_timestamp_ns(t_ns), '%Y-%m-%dT%H:%M:%S.%gZ') AS time, pass_id, radio, channel, "  # noqa: S608 - our own names, quotes doubled
            f"direction, {_number('chainage_m', 2)} AS chainage_m, {_number('channel_power_dbm', 2)} AS power_dbm, "
            f"radio AS cell, {told}, {_number('speed_mps', 2)} AS speed_mps FROM rows) "
            f"TO '{target}' (FORMAT csv, HEADER {str(header).lower()})"
        )


def _number(name: str, decimals: int) -> str:
    return f"CASE WHEN isnan({name}) THEN NULL ELSE round({name}, {decimals}) END"


def _weather(scenario: RadioScenario, world: RadioWorld) -> list[Weather]:
    """What every weather station says at the beginning of every pass."""
    times = [round(begin_s(scenario, k)) * NS for k in range(scenario.passes.days * scenario.passes.per_day)]
    faults = scenario.radio_faults
    places = stations(world.line.length_m)
    return [world.weather.message(t_ns, axis_m, faults) for t_ns in times for axis_m in places]


def _weather_row(one: Weather) -> Sequence[object]:
    time = datetime.fromtimestamp(one.t_ns // NS, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return (time, f"{one.axis_m:.0f}", f"{one.reach_m:.0f}", one.temperature_c, one.rain_mm_per_h, one.snow_mm_per_h)
