"""One simulated train, a tenth of a second at a time: what its sensors send, and where it really is.

The same scenario, seed and start give the same messages, in files and live.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from schemas.gnss_time import NS
from schemas.position import BalisePassage, FaultKind, MotionTruth, TrainChange
from schemas.radio import RadioMeasurement, Weather
from services.line.alignment import Alignment
from services.simulator.fault_board import FaultBoard, command_of
from services.simulator.line_receiver import LineReceiver
from services.simulator.motion_simulator import MotionSamples, MotionSimulator
from services.simulator.motion_state import STEP_S
from services.simulator.radio_live import TrainRadio
from services.simulator.radio_world import RadioLine, RadioWorld
from services.simulator.random_track import TrackSettings, random_track
from services.simulator.simulation import Instant, utc_ns
from services.simulator.track_table import TrackTable
from services.simulator.train_route import RouteError, TrainRoute, route_of
from services.simulator.train_scenario import TrainScenario
from services.simulator.train_sensors import BLOCK, SensorBlock, TrainSensors
from services.simulator.weather_along import WeatherAlong

Floats = NDArray[np.float64]

TICK_NS = BLOCK * round(STEP_S * NS)
BALISE_BOUND_M = 1.0
"""Error of the moment of passing that a reader vouches for."""
READER_SIGMA_M = 0.2
"""Spread of the place where a reader sees a balise's centre."""


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """What happened within a tenth of a second."""

    gps_ns: int
    """Its end [ns since the GPS epoch]."""
    sensors: SensorBlock
    samples: MotionSamples
    truth: MotionTruth | None
    """None on a track that lies nowhere."""
    instant: Instant | None
    """An epoch of the receiver, when one is due."""
    balises: tuple[BalisePassage, ...]
    changes: tuple[TrainChange, ...]
    faults: dict[FaultKind, float] = field(default_factory=dict)
    readings: tuple[RadioMeasurement, ...] = ()
    """Of the radio device, at the end of its measuring periods."""
    weather: tuple[Weather, ...] = ()
    """Along the line, once a minute, where the train has a radio."""


def _require_stop(track: TrackTable, start_m: float, length_m: float) -> None:
    """Refuse a journey without a stop to go to."""
    if not (track.stops_m > start_m + length_m).any():
        msg = (
            f"journey: no stop is more than the train's length of {length_m:g} m ahead of its start, which is "
            f"{start_m:.0f} m along its way of {track.length_m:.0f} m: add a stop, or start elsewhere"
        )
        raise RouteError(msg)


class TrainSimulation:
    """An endless sequence of ticks."""

    def __init__(
        self,
        scenario: TrainScenario,
        alignment: Alignment | None,
        start_gps_ns: int,
        generator: np.random.Generator,
        radio_line: RadioLine | None = None,
    ) -> None:
        """Put the train at its start. `alignment` is that of the scenario's line and branch, `radio_line` its radios.

        Raises RouteError for a journey that the line does not allow.
        """
        self.scenario = scenario
        self.faults = FaultBoard(scenario.faults)
        settings = scenario.motion
        seeds = generator.spawn(4)
        self.route: TrainRoute | None = None
        if alignment is None:
            track, start_m, places = random_track(scenario.track or TrackSettings(), seeds[0]), 0.0, {}
        else:
            self.route = route_of(alignment, scenario.journey)
            track, start_m = self.route.track, self.route.start_m
            wanted = [one.at_axis_m for one in scenario.adhesion.episodes if one.at_axis_m is not None]
            places = {axis_m: self.route.way_of(axis_m) for axis_m in wanted}
        _require_stop(track, start_m, settings.vehicle.length_m)
        self.motion = MotionSimulator(
            track,
            settings,
            seeds[1],
            start_m=start_m,
            places=places,
            turns_back=scenario.journey.turns_back,
            fixed_sensors=scenario.journey.fixed_sensors,
        )
        self.sensors = TrainSensors(settings, seeds[2])
        self._balise_generator = np.random.default_rng(seeds[2].integers(2**32))
        self.receiver: LineReceiver | None = None
        if scenario.gnss is not None and alignment is not None:
            self.receiver = LineReceiver(scenario, scenario.gnss, alignment, seeds[3])
        self.radio: TrainRadio | None = None
        if scenario.radio is not None and radio_line is not None:
            world = RadioWorld(radio_line, scenario.radio, WeatherAlong(scenario.weather))
            self.radio = TrainRadio(world, utc_ns(start_gps_ns))
        self._start_ns, self._ticks = start_gps_ns, 0
        self._interval_ns = round(scenario.receiver.interval_s * NS)
        self._reader_m: float | None = None
        self._trip = 0

    @property
    def next_gps_ns(self) -> int:
        """End of the next tick [ns since the GPS epoch]."""
        return self._start_ns + (self._ticks + 1) * TICK_NS

    @property
    def now_s(self) -> float:
        """Time since the start."""
        return self._ticks * TICK_NS / NS

    def warm_up(self) -> None:
        """Take two ticks, which hold every kind of step: what has to be compiled is compiled then."""
        self.step()
        self.step()

    def skip(self, count: int) -> None:
        """Let `count` ticks pass unheard: the train runs on, the receiver measures nothing."""
        for _ in range(count):
            self.step(measured=False)

    def step(self, *, measured: bool = True) -> Tick:
        """Next tick; without an epoch unless it is to be `measured`."""
        faults = self.faults.at(self.now_s)
        samples = self.motion.advance(BLOCK, command_of(faults))
        gps_ns = self.next_gps_ns
        self._ticks += 1
        sensors = self.sensors.block(samples, faults)
        truth: MotionTruth | None = None
        instant: Instant | None = None
        balises: tuple[BalisePassage, ...] = ()
        changes: tuple[TrainChange, ...] = ()
        readings: tuple[RadioMeasurement, ...] = ()
        weather: tuple[Weather, ...] = ()
        if self.route is not None:
            truth = self._truth(gps_ns, samples)
            changes = self._changes(gps_ns, samples)
            balises = self._balises(gps_ns, samples)
            if measured and self.receiver is not None and gps_ns % self._interval_ns == 0:
                leading_m = self.route.axis_of(float(samples.way_m[-1]), self._trip)
                instant = self.receiver.epoch(
                    gps_ns,
                    self._antenna_front_m(leading_m),
                    truth.speed_mps,
                    rises=self.route.rises(self._trip),
                    received="gnss_lost" not in faults,
                )
            if measured and self.radio is not None:
                befallen = self.faults.radio()
                rises = self.faces_up
                readings = self.radio.readings(truth, self._trip, befallen, rises=rises)
                weather = self.radio.weather(truth.t_ns, befallen)
        return Tick(gps_ns, sensors, samples, truth, instant, balises, changes, faults, readings, weather)

    @property
    def faces_up(self) -> bool:
        """Whether the front end looks towards rising `axis_m`: where the train runs, unless it is propelled."""
        assert self.route is not None  # noqa: S101 - only asked on a line
        return self.route.rises(0 if self.scenario.journey.propels else self._trip)

    def _behind_m(self, behind_front_m: float) -> float:
        """How far what is so far behind the front end of cab A is behind the end that goes first now."""
        turned = self.scenario.journey.fixed_sensors and self._trip % 2
        return self.scenario.motion.vehicle.length_m - behind_front_m if turned else behind_front_m

    def _antenna_front_m(self, axis_m: float) -> float:
        """Where the front end were if the antenna stood as far behind it as behind cab A's."""
        route, gnss = self.route, self.scenario.gnss
        if route is None or gnss is None:
            return axis_m
        further_m = self._behind_m(gnss.antenna_behind_front_m) - gnss.antenna_behind_front_m
        return axis_m - further_m if route.rises(self._trip) else axis_m + further_m

    def _truth(self, gps_ns: int, samples: MotionSamples) -> MotionTruth:
        route = self.route
        assert route is not None  # noqa: S101 - only called on a line
        trip = int(samples.trip[-1])
        # The end that goes first is the rear one while the train is propelled.
        behind_m = self.scenario.motion.vehicle.length_m if self.scenario.journey.propels and trip % 2 else 0.0
        axis_m = route.axis_of(float(samples.way_m[-1]) - behind_m, trip)
        alignment = route.alignment
        slip = int(samples.slip[-1])
        junction = alignment.junction_axis_m
        return MotionTruth(
            t_ns=utc_ns(gps_ns),
            axis_m=axis_m,
            branch=alignment.branch if junction is not None and axis_m > junction else "",
            chainage_m=float(alignment.chainage.at(axis_m)),
            distance_m=float(samples.distance_m[-1]),
            speed_mps=float(samples.speed_mps[-1]),
            acceleration_mps2=float(samples.acceleration_mps2[-1]),
            slip=-1 if slip < 0 else 1 if slip > 0 else 0,
            gradient_permille=float(alignment.gradient_permille(axis_m)),
            curvature_per_m=float(alignment.curvature_per_m(axis_m)),
        )

    def _changes(self, gps_ns: int, samples: MotionSamples) -> tuple[TrainChange, ...]:
        """The other cab leads from the sample on at which the train turned back, unless it is propelled."""
        trip = int(samples.trip[-1])
        if trip == self._trip:
            return ()
        self._trip, self._reader_m = trip, None
        if self.scenario.journey.propels:
            return ()
        own = self.scenario.journey.sensors == "cab"
        note = f"the other end leads; {'its own sensors look forward' if own else 'sensors look as before'}"
        return (TrainChange(t_ns=utc_ns(gps_ns), kind="cab", cab="B" if trip % 2 else "A", note=note),)

    def _balises(self, gps_ns: int, samples: MotionSamples) -> tuple[BalisePassage, ...]:
        """Balises that the reader has passed since the last tick, at the time of passing."""
        route = self.route
        assert route is not None  # noqa: S101 - only called on a line
        behind_front_m = self.scenario.balise_reader_behind_front_m
        behind_m = self._behind_m(behind_front_m)
        before, reader = self._reader_m, samples.way_m - behind_m
        self._reader_m = float(reader[-1])
        if before is None:
            return ()
        ways, passed = np.concatenate([[before], reader]), []
        for balise in route.alignment.balises:
            place_m = balise.axis_m if route.rises(self._trip) else route.track.length_m - balise.axis_m
            if not ways[0] < place_m <= ways[-1]:
                continue
            late_m = READER_SIGMA_M * float(np.clip(self._balise_generator.standard_normal(), -3.0, 3.0))
            at = float(np.interp(place_m, ways, np.arange(len(ways))))
            speed = max(float(samples.speed_mps[-1]), 0.1)
            age_ns = round((len(ways) - 1 - at) * STEP_S * NS - late_m / speed * NS)
            passed.append(
                BalisePassage(
                    t_ns=utc_ns(gps_ns) - max(age_ns, 0),
                    balise=balise.id,
                    sensor_offset_m=behind_front_m if self.scenario.journey.propels else behind_m,
                    detection_bound_m=BALISE_BOUND_M,
                )
            )
        return tuple(passed)
