"""What the radio device of a simulated train says, as messages: period by period, or a whole pass in time-lapse."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import isfinite
from typing import Final

import msgspec
import numpy as np

from schemas.position import MotionTruth
from schemas.radio import RadioMeasurement, Weather
from services.simulator.radio_device import Reading
from services.simulator.radio_draws import stream
from services.simulator.radio_faults import RadioFault
from services.simulator.radio_passes import MEASURED, NS, RadioPass
from services.simulator.radio_world import Journey, Link, RadioWorld
from services.simulator.weather_along import stations

WEATHER_NS: Final = 60 * NS
PLACES: Final = {"frequency_offset_hz": 1, "received_ratio": 3, "corrected_bits": 3}


def timed(faults: tuple[RadioFault, ...], start_s: float) -> tuple[RadioFault, ...]:
    """The same faults with Unix times instead of times since `start_s`."""
    return tuple(replace(one, since_s=one.since_s + start_s, until_s=one.until_s + start_s) for one in faults)


class TrainRadio:
    """The radio device of a train, and the weather stations of its line."""

    def __init__(self, world: RadioWorld, start_ns: int) -> None:
        """Begin at a time."""
        self.world = world
        self._start_ns = start_ns
        self._period_ns = round(world.settings.period_s * NS)
        self._period = start_ns // self._period_ns
        self._told = start_ns // WEATHER_NS - 1

    def readings(
        self, truth: MotionTruth, trip: int, faults: tuple[RadioFault, ...], *, rises: bool
    ) -> tuple[RadioMeasurement, ...]:
        """What it says at the end of a measuring period, without the place, which it does not know; else nothing.

        Times of the faults count from the start.
        """
        if truth.t_ns // self._period_ns == self._period:
            return ()
        self._period = truth.t_ns // self._period_ns
        journey = Journey(
            number=stream(self._start_ns // NS, trip) >> 33,
            rises=rises,
            t_s=np.array([truth.t_ns / NS]),
            axis_m=np.array([truth.axis_m]),
            speed_mps=np.array([truth.speed_mps]),
        )
        heard = self.world.measure(journey, timed(faults, self._start_ns / NS))
        return tuple(_message(truth.t_ns, link, reading, self.world) for link, reading in heard)

    def weather(self, t_ns: int, faults: tuple[RadioFault, ...]) -> tuple[Weather, ...]:
        """What the stations say once a minute; else nothing."""
        if t_ns // WEATHER_NS == self._told:
            return ()
        self._told = t_ns // WEATHER_NS
        now = timed(faults, self._start_ns / NS)
        return tuple(self.world.weather.message(t_ns, axis_m, now) for axis_m in stations(self.world.line.length_m))


def _message(t_ns: int, link: Link, reading: Reading, world: RadioWorld) -> RadioMeasurement:
    site = world.line.sites[link.site]
    values = {name: _number(name, float(getattr(reading, name)[0])) for name in MEASURED}
    known = RadioMeasurement(t_ns=t_ns, radio=site.id, channel=link.channel, cell=site.id)
    return msgspec.structs.replace(known, **values)


def pass_messages(one: RadioPass, world: RadioWorld, train: str) -> Iterator[RadioMeasurement]:
    """Readings of a pass by a logger that knows its place."""
    for row in range(len(one.t_ns)):
        link = world.links[one.link[row]]
        site = world.line.sites[link.site]
        values = {name: _number(name, float(one.measured[name][row])) for name in MEASURED}
        known = RadioMeasurement(
            t_ns=int(one.t_ns[row]),
            radio=site.id,
            channel=link.channel,
            cell=site.id,
            chainage_m=round(float(one.chainage_m[row]), 2),
            axis_m=round(float(one.axis_m[row]), 2),
            place_bound_m=0.0,
            direction=one.direction,
            speed_mps=float(one.speed_mps[row]),
            pass_id=one.pass_id,
            train=train,
        )
        yield msgspec.structs.replace(known, **values)


def _number(name: str, value: float) -> float | None:
    return round(value, PLACES.get(name, 2)) if isfinite(value) else None
