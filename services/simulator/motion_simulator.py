"""A train under way, some steps at a time: the same samples however they are asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.simulator.inertial_sensor import MODES, drawn_sensor
from services.simulator.motion_settings import Driving, MotionSettings
from services.simulator.motion_state import NO_COMMAND, STEP_S, Command, fresh_state, vehicle_constants
from services.simulator.motion_steps import MOTION_COLUMNS, NOISES, Run, run_steps
from services.simulator.slip_episodes import random_rows, set_rows
from services.simulator.track_table import TrackTable, felt_by
from services.simulator.train_dynamics import draw_leg

Floats = NDArray[np.float64]

CHUNK = 5_000
"""Steps whose noise is drawn at once: 50 s."""
HABITS = 211


@dataclass(frozen=True, slots=True, eq=False)
class MotionSamples:
    """Consecutive samples, 10 ms apart; each column has shape (n,)."""

    first: int
    """Number of the first one; sample k is at (k + 1) * STEP_S since the start."""
    imu: Floats
    """Shape (n, 6): what the sensor reads at these instants, not yet late."""
    distance_m: Floats
    """Gone since the start; rises however the train runs, unless its sensors are fixed to the vehicle."""
    way_m: Floats
    """Along the table that the train is on."""
    trip: NDArray[np.int64]
    """How often the train has turned back."""
    speed_mps: Floats
    acceleration_mps2: Floats
    wheel_way_m: Floats
    slip: NDArray[np.int8]
    effort_mps2: Floats
    forward: Floats
    """+1 while the train runs where its sensors look, -1 while it runs the other way."""

    @property
    def t_s(self) -> Floats:
        """Times since the start."""
        return np.asarray((self.first + 1 + np.arange(len(self.way_m))) * STEP_S)


class MotionSimulator:
    """One train, from rest at a place of its track."""

    def __init__(
        self,
        track: TrackTable,
        settings: MotionSettings,
        generator: np.random.Generator,
        *,
        start_m: float = 0.0,
        places: dict[float, float] | None = None,
        turns_back: bool = True,
        fixed_sensors: bool = False,
    ) -> None:
        """Draw sensor, habits and slips. `places` gives the way along the table for places of episodes.

        `fixed_sensors`: they look where the train ran at first; else each cab has its own, which are alike.
        At the last stop the train turns back if `turns_back`, else it stays there. Raises ValueError
        when there is no stop ahead of `start_m`.
        """
        self.settings = settings
        self._generator = generator
        self._tables = (track, track.reversed_way())
        self._places = places or {}
        self._turns_back = turns_back
        self._sensor = drawn_sensor(settings.imu, settings.vehicle.wheel_diameter_m, generator)
        self._habits = generator.uniform(size=(HABITS, 5))
        self._randoms = random_rows(settings.adhesion, generator)
        self._sets = [set_rows(settings.adhesion, self._places, generator)]
        self._sets.append(_from_other_end(self._sets[0], track.length_m))
        self._started_s = np.full(len(self._sets[0]), -1e9)
        self._state = fresh_state()
        self._memory = np.zeros(6 + 2 * len(MODES))
        self._fixed_sensors = fixed_sensors
        self._trip, self._gone_m, self._trip_start_m = 0, 0.0, start_m
        self._rim_m, self._trip_rim_m = 0.0, 0.0
        """Way of the rim by its counter, and by its wear, when the trip began."""
        self._state["way_m"] = start_m
        self._run = self._begin_trip()

    @property
    def steps(self) -> int:
        """Steps done so far."""
        return int(self._state["step"][0])

    @property
    def finished(self) -> bool:
        """Whether the train has reached its last stop and stays there."""
        return not self._turns_back and int(self._state["has_stop"][0]) == 0 and float(self._state["speed_mps"][0]) == 0

    @property
    def way_left_m(self) -> float:
        """Way to the last stop of this trip."""
        return float(self._run.stops_m[-1] - self._state["way_m"][0])

    def advance(self, count: int, command: Command = NO_COMMAND) -> MotionSamples:
        """Next `count` samples."""
        noise = self._generator.standard_normal((count, NOISES))
        imu, motion = np.empty((count, 6)), np.empty((count, len(MOTION_COLUMNS)))
        distance, trip, forward = np.empty(count), np.empty(count, np.int64), np.empty(count)
        first, done = self.steps, 0
        while done < count:
            rest = slice(done, None)
            new = run_steps(self._state, self._memory, self._run, command, noise[rest], imu[rest], motion[rest])
            part = slice(done, done + new)
            sign = self._forward
            distance[part] = self._gone_m + sign * (motion[part, 0] - self._trip_start_m)
            motion[part, 3] = self._rim_m + sign * (motion[part, 3] - self._trip_rim_m)
            trip[part], forward[part] = self._trip, sign
            done += new
            if done < count:
                self._leave_again()
        columns = motion.T
        return MotionSamples(
            first, imu, distance, columns[0], trip, columns[1], columns[2], columns[3],
            columns[4].astype(np.int8), columns[5], forward,
        )  # fmt: skip

    def _leave_again(self) -> None:
        """Turn back at the last stop: the rear end becomes the front end. Or dwell on, as where no stop lies behind."""
        behind_m = self._tables[0].length_m - float(self._state["way_m"][0]) + 2.0 * self.settings.vehicle.length_m
        if not self._turns_back or not (self._tables[(self._trip + 1) % 2].stops_m > behind_m).any():
            self._state["dwell_s"] = 1e9
            return
        way_m, rim_m = float(self._state["way_m"][0]), float(self._state["wheel_way_m"][0])
        self._gone_m += self._forward * (way_m - self._trip_start_m)
        self._rim_m += self._forward * (rim_m - self._trip_rim_m)
        self._trip_rim_m = rim_m
        self._trip += 1
        self._trip_start_m = self._tables[0].length_m - way_m + self.settings.vehicle.length_m
        self._state["way_m"] = self._trip_start_m
        self._run = self._begin_trip()

    @property
    def _forward(self) -> float:
        """-1 while the train runs away from where its sensors look."""
        return -1.0 if self._fixed_sensors and self._trip % 2 else 1.0

    def _begin_trip(self) -> Run:
        track = self._tables[self._trip % 2]
        settings = self.settings
        behind_m, sensor = settings.imu.behind_front_m, self._sensor
        if self._forward < 0.0:
            behind_m = settings.vehicle.length_m - behind_m
            # Half a turn about the vertical: x and y look the other way.
            sensor = sensor._replace(turned=sensor.turned * np.array([-1.0, -1.0, 1.0, -1.0, -1.0, 1.0]))
        ahead = np.flatnonzero(track.stops_m > self._trip_start_m + settings.vehicle.length_m)
        if not len(ahead):
            msg = f"no stop ahead of {self._trip_start_m:.0f} m on a track of {track.length_m:.0f} m"
            raise ValueError(msg)
        run = Run(
            felt_by(track, settings.vehicle, behind_m, settings.driving.brake_mps2[0]),
            np.ascontiguousarray(track.stops_m),
            _ranges(settings.driving),
            self._habits,
            self._randoms,
            self._sets[self._trip % 2],
            self._started_s,
            vehicle_constants(settings),
            sensor,
        )
        self._state["stop"], self._state["has_stop"], self._state["mode"] = ahead[0], 1, 0
        draw_leg(self._state, run.ranges, run.habits)
        return run


def _ranges(driving: Driving) -> Floats:
    return np.array([driving.margin_mps, driving.band_mps, driving.brake_mps2, driving.power_share, driving.dwell_s])


def _from_other_end(rows: Floats, length_m: float) -> Floats:
    """Rows of episodes with places counted from the table's other end."""
    turned = rows.copy()
    at_place = turned[:, 0] == 2.0  # noqa: PLR2004 - AT_PLACE
    turned[at_place, 1] = length_m - turned[at_place, 1]
    return turned
