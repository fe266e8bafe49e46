"""All of a train's motion in one loop of 10 ms steps: driver, wheel, train, body, sensor."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import kernel
from services.simulator.car_body import feel, suspend
from services.simulator.inertial_sensor import NOISES as SENSOR_NOISES
from services.simulator.inertial_sensor import SensorConstants, sense
from services.simulator.motion_state import BRAKE, DWELL, POWER, STEP_S, Command, VehicleConstants
from services.simulator.track_table import STEP_M
from services.simulator.train_dynamics import draw_leg, drive, move
from services.simulator.wheel_adhesion import begin_episode, roll_on, tell_slip, wheel_step

Floats = NDArray[np.float64]

MOTION_COLUMNS: Final = ("way_m", "speed_mps", "acceleration_mps2", "wheel_way_m", "slip", "effort_mps2", "wheel_mps")
NOISES: Final = 6 + SENSOR_NOISES
"""Normals per step: creep, creep noise, grip, force, pitch, roll, then the sensor's."""
LOOK_AHEAD_S: Final = 2.0
ARRIVED_M: Final = 2.5
"""Nearer to the stop than this, or beyond it, a train at rest opens its doors."""
FORCE_NOISE_MPS2: Final = 0.015


class Run(NamedTuple):
    """What stays the same while a train runs along one table."""

    felt: Floats
    """Shape (n, COLUMNS), one row per STEP_M."""
    stops_m: Floats
    ranges: Floats
    """(5, 2): the driver's habits."""
    habits: Floats
    """(k, 5) uniform draws, a row per leg."""
    randoms: Floats
    sets: Floats
    started_s: Floats
    vehicle: VehicleConstants
    sensor: SensorConstants


@kernel
def look_up(felt: Floats, way_m: float, out: Floats, bend: Floats) -> None:
    """Row of the table at a place, linear between rows, into `out`; change per metre into `bend`."""
    at = min(max(way_m / STEP_M, 0.0), len(felt) - 1.001)
    i = int(at)
    share = at - i
    for k in range(len(out)):
        rise = felt[i + 1, k] - felt[i, k]
        out[k] = felt[i, k] + share * rise
        bend[k] = rise / STEP_M


@kernel
def wander(state: Any, noise: Floats) -> None:  # noqa: ANN401 - a numpy record
    """Unit Gauss-Markov processes: correlation times 4, 1.5, 0.8 and 0.5 s."""
    s = state[0]
    s.creep_factor += -s.creep_factor * STEP_S / 4.0 + np.sqrt(2.0 * STEP_S / 4.0) * noise[0]
    s.creep_noise += -s.creep_noise * STEP_S / 1.5 + np.sqrt(2.0 * STEP_S / 1.5) * noise[1]
    s.grip_noise += -s.grip_noise * STEP_S / 0.8 + np.sqrt(2.0 * STEP_S / 0.8) * noise[2]
    s.force_noise += -s.force_noise * STEP_S / 0.5 + np.sqrt(2.0 * STEP_S / 0.5) * noise[3]


@kernel
def run_steps(
    state: Any,  # noqa: ANN401 - a numpy record
    memory: Floats,
    run: Run,
    command: Command,
    noise: Floats,
    imu: Floats,
    motion: Floats,
) -> int:
    """As many steps as `noise` has rows; fewer when the train is ready to leave its last stop the other way.

    Rows of `imu` (n, 6) get the sensor's readings at the end of each step, rows of `motion` the columns
    MOTION_COLUMNS. How many rows were written is given back.
    """
    s = state[0]
    row, bend = np.zeros(run.felt.shape[1]), np.zeros(run.felt.shape[1])
    ahead, unused = np.zeros(run.felt.shape[1]), np.zeros(run.felt.shape[1])
    for i in range(len(noise)):
        if s.mode == DWELL and s.has_stop == 0 and s.dwell_s <= 0.0:
            return i
        wander(state, noise[i])
        look_up(run.felt, s.way_m, row, bend)
        look_up(run.felt, s.way_m + LOOK_AHEAD_S * s.speed_mps, ahead, unused)
        stop_m = run.stops_m[s.stop] - s.way_m if s.has_stop == 1 else np.inf
        drive(state, min(ahead[4], row[4]), stop_m, row[3], run.vehicle)
        if s.step % 10 == 0 and s.episode < 0:
            begin_episode(state, run.randoms, run.sets, run.started_s)
        rim_mps = s.wheel_mps
        effort = wheel_step(state, run.randoms, run.sets, (command.slip_mps, command.micro_share), run.vehicle)
        effort += FORCE_NOISE_MPS2 * s.force_noise * min(abs(effort) * 2.0, 1.0)
        if move(state, effort, row[3], row[0], run.vehicle):
            come_to_rest(state, run)
        roll_on(state, rim_mps)
        tell_slip(state)
        suspend(state, row, run.sensor.vibration, noise[i, 4:6], run.vehicle)
        look_up(run.felt, s.way_m, row, bend)
        feel(state, row, bend, imu[i])
        s.step += 1
        s.time_s = s.step * STEP_S
        sense(s.time_s, s.wheel_way_m, s.speed_mps, run.sensor, memory, noise[i, 6:], imu[i])
        motion[i, 0], motion[i, 1], motion[i, 2] = s.way_m, s.speed_mps, s.acceleration_mps2
        motion[i, 3], motion[i, 4], motion[i, 5], motion[i, 6] = s.wheel_way_m, s.told, s.effort_mps2, s.wheel_mps
    return len(noise)


@kernel
def come_to_rest(state: Any, run: Run) -> None:  # noqa: ANN401 - a numpy record
    """Open the doors at a stop; go on when it is not reached yet."""
    s = state[0]
    if s.has_stop == 0:
        s.mode = DWELL
        return
    if run.stops_m[s.stop] - s.way_m <= ARRIVED_M:
        s.mode = DWELL
        draw_leg(state, run.ranges, run.habits)
        s.stop += 1
        if s.stop >= len(run.stops_m):
            s.has_stop = 0
    elif s.mode == BRAKE:
        s.mode = POWER
