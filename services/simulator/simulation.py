"""Epochs of a simulated receiver on a simulated train, one after another, with the truth beside them.

The same scenario, seed and start give the same bytes, however fast the epochs are taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.gnss import Ephemeris, Epoch, Ionosphere
from schemas.gnss_time import NS, WEEK_S, unix_ns_from_gps
from schemas.position import TrainTruth
from services.simulator.line_shape import LineShape
from services.simulator.local_plane import LocalPlane
from services.simulator.paths import Reception, paths_to
from services.simulator.receiver import Measured, ReceiverChannels
from services.simulator.receiver_clock import ReceiverClock
from services.simulator.scenario import Scenario, axis_of
from services.simulator.sky import VisibleSky
from services.simulator.street_scene import draw_boxes, place_name
from services.simulator.surroundings import Surroundings
from services.simulator.train_run import TrainRun

Floats = NDArray[np.float64]
SIGNAL = "1C"
"""RINEX 3: C/A on L1; pilot of E1."""


@dataclass(frozen=True, slots=True)
class Instant:
    """One epoch and what really was."""

    epoch: Epoch
    truth: TrainTruth
    """At the true instant of measurement: the receiver's clock is off by up to half a millisecond."""
    code_error_m: Floats
    """Shape of the epoch's columns: share of paths and noise in each pseudorange."""
    visible: tuple[str, ...]
    """Satellites above the mask, blocked ones included."""
    reception: tuple[Reception, ...]
    """How each visible satellite's signal comes in."""


class Simulation:
    """An endless sequence of instants."""

    def __init__(self, scenario: Scenario, start_gps_ns: int, generator: np.random.Generator) -> None:
        """Draw sky, surroundings and receiver; the train leaves its first station at `start_gps_ns`.

        That is on the receiver's clock, [ns] since the GPS epoch.
        """
        line, train, receiver = scenario.line, scenario.train, scenario.receiver
        self.scenario = scenario
        self.axis: LineShape = axis_of(line)
        self.plane = LocalPlane(line.origin_lat_deg, line.origin_lon_deg, line.rail_height_m)
        self.run = TrainRun(
            tuple(station.axis_m for station in line.stations),
            cruise_mps=train.cruise_mps,
            acceleration_mps2=train.acceleration_mps2,
            braking_mps2=train.braking_mps2,
            dwell_s=train.dwell_s,
        )
        self.sky = VisibleSky(scenario.sky, generator)
        self.surroundings = Surroundings(draw_boxes(scenario.scene, self.axis, generator))
        self._channels = ReceiverChannels(receiver, len(self.sky.satellites), generator)
        self._clock = ReceiverClock(
            bias_s=receiver.clock_bias_s,
            drift=receiver.clock_drift,
            walk=receiver.clock_drift_walk,
            step_s=receiver.clock_jump_s,
        )
        self._generator = generator
        self._start_ns = start_gps_ns
        self._interval_ns = round(receiver.interval_s * NS)
        self._next = self._clock_at = 0

    @property
    def next_gps_ns(self) -> int:
        """Tag of the next epoch, [ns] since the GPS epoch."""
        return self._start_ns + self._next * self._interval_ns

    def ephemerides(self) -> tuple[Ephemeris, ...]:
        """What the satellites broadcast at the next epoch."""
        return self.sky.ephemerides(self.next_gps_ns)

    def ionosphere(self) -> Ionosphere:
        """What is broadcast of the ionosphere at the next epoch."""
        return self.sky.ionosphere(self.next_gps_ns)

    def skip_until(self, gps_ns: int) -> int:
        """Leave out the epochs tagged before `gps_ns`, as if they had been lost; how many those were."""
        skipped = max(-(-(gps_ns - self.next_gps_ns) // self._interval_ns), 0)
        self._next += skipped
        return skipped

    def __iter__(self) -> Iterator[Instant]:
        """Go on for ever."""
        while True:
            yield self.step()

    def step(self) -> Instant:
        """Next instant."""
        tag_ns = self.next_gps_ns
        passed_s = (self._next - self._clock_at) * self._interval_ns / NS
        self._clock.advance(passed_s, float(self._generator.standard_normal()))
        self._clock_at = self._next
        bias_s = self._clock.bias_s
        since_s = (tag_ns - self._start_ns) / NS - bias_s
        place, velocity, truth = self._train(tag_ns, since_s)
        arrivals = self.sky.arrivals(tag_ns, bias_s, self.plane.ecef(place), self.plane.ecef_velocity(place, velocity))
        satellite = self._channels.visible(arrivals.elevation_rad)
        towards = arrivals.towards[satellite] @ self.plane.enu_from_ecef.T
        paths = paths_to(self.surroundings, place, velocity, towards)
        measured = self._channels.measure(
            since_s, satellite, arrivals, paths, (bias_s, self._clock.drift), self._generator
        )
        self._next += 1
        names = self.sky.satellites
        return Instant(
            epoch=epoch_of(tag_ns, names, measured),
            truth=truth,
            code_error_m=measured.code_error_m,
            visible=tuple(names[i] for i in satellite),
            reception=tuple(paths.reception()),
        )

    def _train(self, tag_ns: int, since_s: float) -> tuple[Floats, Floats, TrainTruth]:
        """Antenna's place and velocity in the line's plane, and the truth message."""
        motion = self.run.at(since_s)
        axis = self.axis.at(motion.axis_m)
        heading = float(axis.heading_rad[0])
        height_m = self.scenario.train.antenna_above_rail_m
        place = np.array([axis.x_m[0], axis.y_m[0], height_m])
        velocity = motion.speed_mps * np.array([np.cos(heading), np.sin(heading), 0.0])
        lat_deg, lon_deg, h_m = self.plane.geodetic_deg(place)
        truth = TrainTruth(
            t_ns=utc_ns(tag_ns),
            lat_deg=float(lat_deg),
            lon_deg=float(lon_deg),
            h_m=float(h_m),
            ve_mps=float(velocity[0]),
            vn_mps=float(velocity[1]),
            vu_mps=0.0,
            axis_m=motion.axis_m,
            speed_mps=motion.speed_mps,
            surroundings=place_name(self.scenario.scene, motion.axis_m),
        )
        return place, velocity, truth


def utc_ns(gps_ns: int) -> int:
    """UTC [ns] in Unix time of a GPS time [ns] since the GPS epoch."""
    week, rest_ns = divmod(gps_ns, WEEK_S * NS)
    return unix_ns_from_gps(week, rest_ns / NS)


def epoch_of(tag_ns: int, names: tuple[str, ...], measured: Measured) -> Epoch:
    """Message of what was measured at the tag."""
    week, rest_ns = divmod(tag_ns, WEEK_S * NS)
    satellites = tuple(names[i] for i in measured.satellite)
    return Epoch(
        t_ns=utc_ns(tag_ns),
        gps_week=week,
        tow_s=rest_ns / NS,
        satellites=satellites,
        signals=(SIGNAL,) * len(satellites),
        pseudorange_m=measured.pseudorange_m,
        carrier_phase_cycles=measured.carrier_phase_cycles,
        doppler_hz=measured.doppler_hz,
        cn0_dbhz=measured.cn0_dbhz,
        lock_lost=measured.lock_lost,
    )
