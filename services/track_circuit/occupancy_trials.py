"""Trials of the occupancy's decision on the model of the rail: for the benchmark, and in small for the tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from services.track_circuit.occupancy import Occupancy, OccupancySettings
from services.track_circuit.rail import BALLAST_RANGE_S_PER_KM, Rail, level_db, transfer

DRY, WET = BALLAST_RANGE_S_PER_KM
STEP_S: Final = 0.2
SEEN_S: Final = 1.0
"""A train must be seen within this time."""
STAY_S: Final = 3.0
LEVEL_RMS_DB: Final = 0.2
PAIR_STEP_S: Final = 1.0
CARRIERS_HZ: Final = (1700.0, 2300.0, 12_000.0, 20_000.0)


@dataclass(frozen=True, slots=True)
class TrainTrials:
    """Trains in random circuits."""

    cases: int
    undetected: int
    """Clear was said with a train in the circuit, SEEN_S after it entered or later."""
    smallest_drop_db: float


@dataclass(frozen=True, slots=True)
class RampTrials:
    """Circuits without trains that get wet."""

    ramps: int
    false_occupied: int
    """Ramps in which occupied was said after the beginning."""


@dataclass(frozen=True, slots=True)
class PairTrials:
    """Circuits that dry while two trains stand in them; then the first leaves, and later the second."""

    cases: int
    undetected: int
    """Clear was said while a train was in the circuit."""
    released: int
    """Clear by themselves once both had left; the others wait for a person."""


def _fed(one: Occupancy, level: float, begin_s: float, seconds: float, rng: np.random.Generator) -> float:
    for k in range(round(seconds / STEP_S)):
        one.telegram(begin_s + k * STEP_S)
        one.level(level + float(rng.normal(0.0, LEVEL_RMS_DB)), begin_s + k * STEP_S)
    return begin_s + round(seconds / STEP_S) * STEP_S


def train_trials(cases: int, shunt_ohm: float, rng: np.random.Generator, settings: OccupancySettings) -> TrainTrials:
    """A shunt at random places of random circuits, 50 m to 2 km long, from dry to wet, at usual carriers."""
    rail = Rail()
    length_km = rng.uniform(0.05, 2.0, cases)
    ballast = np.exp(rng.uniform(np.log(DRY), np.log(WET), cases))
    hz = rng.choice(CARRIERS_HZ, cases)
    clear = level_db(transfer(rail, hz, length_km, ballast))
    place_km = rng.random(cases) * length_km
    shunted = level_db(transfer(rail, hz, length_km, ballast, shunt_ohm=shunt_ohm, shunt_km=place_km))
    undetected = 0
    for clear_db, shunted_db in zip(clear.tolist(), shunted.tolist(), strict=True):
        one = Occupancy(settings, 0.0)
        one.confirm_clear(clear_db, 0.0)
        t_s = _fed(one, clear_db, 0.0, settings.pick_up_s + SEEN_S, rng)
        t_s = _fed(one, shunted_db, t_s, SEEN_S, rng)
        seen = one.verdict(t_s).state == "occupied"
        t_s = _fed(one, shunted_db, t_s, STAY_S, rng)
        undetected += not (seen and one.verdict(t_s).state == "occupied")
    return TrainTrials(cases, undetected, float((clear - shunted).min()))


def ramp_trials(ramps: int, hours: float, rng: np.random.Generator, settings: OccupancySettings) -> RampTrials:
    """Circuits of up to 1 km whose ballast goes from dry to wet within `hours`, one level per half second."""
    false_occupied = 0
    for _ in range(ramps):
        count = round(hours * 7200.0)
        hz, length_km = float(rng.choice(CARRIERS_HZ[:3])), float(rng.uniform(0.2, 1.0))
        levels = level_db(transfer(Rail(), hz, length_km, np.geomspace(DRY, WET, count)))
        noisy = levels + rng.normal(0.0, LEVEL_RMS_DB, count)
        one = Occupancy(settings, 0.0)
        one.confirm_clear(float(levels[0]), 0.0)
        wrong = False
        for k, level in enumerate(noisy.tolist()):
            one.telegram(0.5 * k)
            one.level(level, 0.5 * k)
            wrong |= 0.5 * k > 2.0 * settings.pick_up_s and one.verdict(0.5 * k).state == "occupied"
        false_occupied += wrong
    return RampTrials(ramps, false_occupied)


def pair_trials(
    cases: int, hours: float, shunt_ohm: float, rng: np.random.Generator, settings: OccupancySettings
) -> PairTrials:
    """Two trains in random circuits as in `train_trials`, soaked at first, whose ballast dries within `hours`.

    Telegrams are taken to come all the while: the level alone must tell.
    """
    rail = Rail()
    undetected = released = 0
    for _ in range(cases):
        hz, length_km = float(rng.choice(CARRIERS_HZ)), float(rng.uniform(0.05, 2.0))
        near_km, far_km = np.sort(rng.uniform(0.0, length_km, 2)).tolist()
        first = {"shunt_ohm": shunt_ohm, "shunt_km": far_km}
        both = first | {"second_ohm": shunt_ohm, "second_km": near_km}
        drying = np.geomspace(WET, DRY, round(hours * 3600.0 / PAIR_STEP_S))
        wet_db = float(level_db(transfer(rail, hz, length_km, WET)))
        one = Occupancy(settings, 0.0)
        one.confirm_clear(wet_db, 0.0)
        t_s = _fed(one, wet_db, 0.0, settings.pick_up_s + SEEN_S, rng)
        seen = True
        for state in (first, both):
            t_s = _fed(one, float(level_db(transfer(rail, hz, length_km, WET, **state))), t_s, 20.0, rng)
            seen &= one.verdict(t_s).state == "occupied"
        for level in level_db(transfer(rail, hz, length_km, drying, **both)).tolist():
            t_s += PAIR_STEP_S
            one.telegram(t_s)
            one.level(level + float(rng.normal(0.0, LEVEL_RMS_DB)), t_s)
            seen &= one.verdict(t_s).state == "occupied"
        left = {"shunt_ohm": shunt_ohm, "shunt_km": near_km}
        t_s = _fed(one, float(level_db(transfer(rail, hz, length_km, DRY, **left))), t_s, 30.0, rng)
        seen &= one.verdict(t_s).state == "occupied"
        t_s = _fed(one, float(level_db(transfer(rail, hz, length_km, DRY))), t_s, 30.0, rng)
        undetected += not seen
        released += one.verdict(t_s).state == "clear"
    return PairTrials(cases, undetected, released)
