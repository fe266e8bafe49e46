"""Passes of a train over the radios of a line, day after day, as columns: for learning, analysis and measurements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from services.line.chainage import Chainage
from services.simulator.radio_device import Reading
from services.simulator.radio_faults import DAY_S, RadioFault
from services.simulator.radio_scenario import RadioScenario
from services.simulator.radio_world import Journey, Link, RadioLine, RadioWorld
from services.simulator.weather_along import WeatherAlong

Floats = NDArray[np.float64]
NS: Final = 10**9
MEASURED: Final = (
    "channel_power_dbm",
    "decoded_power_dbm",
    "received_ratio",
    "corrected_bits",
    "snr_db",
    "frequency_offset_hz",
    "temperature_c",
    "tx_power_dbm",
)


@dataclass(frozen=True, slots=True, eq=False)
class RadioPass:
    """One pass, in order of time; columns of shape (n,), NaN where the device said nothing."""

    pass_id: str
    direction: Literal["up", "down"]
    t_ns: NDArray[np.int64]
    link: NDArray[np.int64]
    """Number in `RadioWorld.links`."""
    axis_m: Floats
    chainage_m: Floats
    speed_mps: Floats
    measured: dict[str, Floats]
    """By the names of MEASURED."""


def world_of(scenario: RadioScenario, line: RadioLine) -> RadioWorld:
    """The radios of a scenario on its line."""
    return RadioWorld(line, scenario.radio, WeatherAlong(scenario.weather))


def radio_passes(
    scenario: RadioScenario, world: RadioWorld, chainage: Chainage | None = None, faults: tuple[RadioFault, ...] = ()
) -> Iterator[RadioPass]:
    """Every pass of a scenario, in order; `faults` besides its own, with Unix times.

    Chainage is `axis_m` itself without a kilometrage. The pass of a number is the same whatever is taken before it.
    """
    for number in range(scenario.passes.days * scenario.passes.per_day):
        yield radio_pass(scenario, world, number, chainage, faults)


def begin_s(scenario: RadioScenario, number: int) -> float:
    """Unix time at which a pass begins."""
    passes = scenario.passes
    day, of_day = divmod(number, passes.per_day)
    apart_s = (DAY_S - passes.first_s) / passes.per_day
    return passes.start.timestamp() + day * DAY_S + passes.first_s + of_day * apart_s


def radio_pass(
    scenario: RadioScenario,
    world: RadioWorld,
    number: int,
    chainage: Chainage | None = None,
    faults: tuple[RadioFault, ...] = (),
) -> RadioPass:
    """The pass of a number, counted from 0."""
    passes, period_s = scenario.passes, scenario.radio.period_s
    direction = passes.directions[number % passes.per_day % len(passes.directions)]
    rises = direction == "up"
    start_s = begin_s(scenario, number)
    from_m, end_m = passes.from_axis_m, world.line.length_m
    to_m = end_m if passes.to_axis_m is None else min(passes.to_axis_m, end_m)
    periods = np.arange(1, int(max(to_m - from_m, 0.0) / passes.speed_mps / period_s) + 1)
    after_s: Floats = np.asarray(periods * period_s, np.float64)
    way_m: Floats = after_s * passes.speed_mps
    journey = Journey(
        number=scenario.seed * 1_000_003 + number,
        rises=rises,
        t_s=start_s + after_s,
        axis_m=from_m + way_m if rises else to_m - way_m,
        speed_mps=np.full(len(after_s), passes.speed_mps),
    )
    parts = list(world.measure(journey, (*scenario.radio_faults, *faults)))
    stamp = datetime.fromtimestamp(start_s, UTC).strftime("%Y%m%dT%H%M%SZ")
    return _gathered(f"{passes.train}-{stamp}-{direction}", direction, journey, parts, world, chainage)


def _gathered(
    pass_id: str,
    direction: Literal["up", "down"],
    journey: Journey,
    parts: list[tuple[Link, Reading]],
    world: RadioWorld,
    chainage: Chainage | None,
) -> RadioPass:
    """Readings of all radios in order of time."""
    rows = np.concatenate([np.zeros(0, np.intp), *(one.rows for _, one in parts)])
    link = np.concatenate(
        [np.zeros(0, np.int64), *(np.full(len(one.rows), world.links.index(at)) for at, one in parts)]
    )
    order = np.lexsort((link, rows))
    rows = rows[order]
    axis_m = journey.axis_m[rows]
    measured = {
        name: np.concatenate([np.zeros(0), *(getattr(one, name) for _, one in parts)])[order] for name in MEASURED
    }
    return RadioPass(
        pass_id=pass_id,
        direction=direction,
        t_ns=np.rint(journey.t_s[rows] * 1e3).astype(np.int64) * (NS // 1000),
        link=link[order],
        axis_m=axis_m,
        chainage_m=axis_m if chainage is None else chainage.at(axis_m),
        speed_mps=journey.speed_mps[rows],
        measured=measured,
    )
