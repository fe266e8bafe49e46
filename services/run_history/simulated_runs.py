"""Runs of a simulated train over days as they would be logged, one fix a second.

The train and its drivers are the simulator's. The first two runs of each day are a tablet's: no fix in tunnels, errors
as they were measured between a phone and a better receiver on one train (4 m along either axis, wandering over a
minute, 0.3 m/s in speed). The others are those of a train that knows its place from its wheels as well: 2 m and 0.1 m/s
are assumed, and nothing is missing in tunnels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.line import Direction
from services.line.alignment import Alignment
from services.run_history.fixes import RunLog, run_log
from services.simulator.motion_simulator import MotionSimulator
from services.simulator.train_route import TrainRoute, route_of
from services.simulator.train_scenario import TrainScenario

Floats = NDArray[np.float64]
STEPS_A_SECOND: Final = 100
FIRST_DEPARTURE_S: Final = 1_775_005_200.0
"""1 April 2026, 10:00 in Japan."""
HEADWAY_S: Final = 1800.0
A_DAY: Final = 10
DAY_S: Final = 86_400.0
LONGEST_S: Final = 7200.0
WANDER_S: Final = 60.0
SMOOTH_S: Final = 8.0
BY_TABLET: Final = 2
"""Runs of each day."""
METRES_A_DEGREE: Final = 111_320.0
AFTER_S: Final = 20


@dataclass(frozen=True, slots=True)
class _Device:
    """What logs a run."""

    wander_m: float
    speed_noise_mps: float
    in_tunnels: bool


TABLET: Final = _Device(4.0, 0.3, in_tunnels=False)
ON_BOARD: Final = _Device(2.0, 0.1, in_tunnels=True)


@dataclass(frozen=True, slots=True)
class _Driven:
    axis_m: Floats
    speed_mps: Floats


def simulated_runs(scenario: TrainScenario, way: Alignment, count: int) -> Iterator[RunLog]:
    """`count` runs, ten a day every half hour, one way and the other. Raises RouteError for a journey that cannot be.

    The same scenario (with its seed) gives the same runs.
    """
    for number in range(count):
        generator = np.random.default_rng((scenario.seed, number))
        direction: Direction = "up" if number % 2 == 0 else "down"
        journey = type(scenario.journey)(
            branch=scenario.journey.branch, direction=direction, stops=scenario.journey.stops, turns_back=False
        )
        route = route_of(way, journey)
        driven = _drive(route, scenario, generator)
        day, slot = divmod(number, A_DAY)
        start_s = FIRST_DEPARTURE_S + day * DAY_S + slot * HEADWAY_S
        device = TABLET if slot < BY_TABLET else ON_BOARD
        yield _logged(f"demo-{number + 1:03d}", start_s, driven, way, device, generator)


def _drive(route: TrainRoute, scenario: TrainScenario, generator: np.random.Generator) -> _Driven:
    """The front end once a second until the train has reached its last stop, and a little longer."""
    motion = MotionSimulator(
        route.track, scenario.motion, generator.spawn(1)[0], start_m=route.start_m, turns_back=False
    )
    way_m: list[float] = []
    speeds: list[float] = []
    after = 0
    while after < AFTER_S and len(way_m) < LONGEST_S:
        samples = motion.advance(STEPS_A_SECOND)
        way_m.append(float(samples.way_m[-1]))
        speeds.append(float(samples.speed_mps[-1]))
        after += motion.finished
    trips = np.zeros(len(way_m), np.int64)
    return _Driven(route.places_of(np.array(way_m), trips), np.array(speeds))


def _logged(
    run_id: str, start_s: float, driven: _Driven, way: Alignment, device: _Device, generator: np.random.Generator
) -> RunLog:
    n = len(driven.axis_m)
    lat, lon, _ = way.position(driven.axis_m)
    north, east = (_wander(n, device.wander_m, generator) for _ in range(2))
    speed = np.maximum(driven.speed_mps + device.speed_noise_mps * generator.standard_normal(n), 0.0)
    t = start_s + np.arange(n)
    heard = device.in_tunnels | ~way.inside("tunnel", driven.axis_m)
    columns = (t, lat + north / METRES_A_DEGREE, lon + east / (METRES_A_DEGREE * np.cos(np.radians(lat))), speed)
    return run_log(run_id, *(np.asarray(one[heard], np.float64) for one in columns))


def _wander(n: int, sigma_m: float, generator: np.random.Generator) -> Floats:
    """Error of a coordinate [m], one value a second: Gauss-Markov, smoothed as receivers smooth their fixes."""
    keep = float(np.exp(-1.0 / WANDER_S))
    drawn = generator.standard_normal(n) * sigma_m
    found = np.empty(n)
    raw = smooth = float(drawn[0])
    for k in range(n):
        raw = keep * raw + np.sqrt(1.0 - keep * keep) * float(drawn[k])
        smooth += (raw - smooth) / SMOOTH_S
        found[k] = smooth
    return found
