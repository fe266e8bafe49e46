"""Motion logs of simulated trains, for files and for Monte Carlo.

    >>> generator = np.random.default_rng(1)
    >>> track = random_track(TrackSettings(length_m=4_000.0, max_gradient_permille=33.0), generator)
    >>> log = simulate_motion_log(track, MotionSettings(), generator, duration_s=60.0)
    >>> log.imu.shape, log.pulses.shape, log.slip.shape
    ((6000, 6), (600,), (600,))

For thousands of slips take `slip_runs`: each run has a track, a vehicle and sensors of its own, and
depends on the seed and its own number alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.simulator.motion_settings import MotionSettings
from services.simulator.motion_simulator import CHUNK, MotionSamples, MotionSimulator
from services.simulator.motion_state import STEP_S
from services.simulator.random_track import TrackSettings, random_track
from services.simulator.tachometer import Tachometer
from services.simulator.track_table import TrackTable

Floats = NDArray[np.float64]

TRUTH_EVERY = 10
"""Samples between two rows of truth: 10 Hz."""
BARREN = 10


@dataclass(frozen=True, slots=True, eq=False)
class MotionLog:
    """A motion log with its truth. Sensor columns are those of docs/odometry_fusion.md; times from 0 on.

    A sample of the inertial sensor stamped t shows the motion at t - `imu_latency_s`; tachometer and
    truth are stamped when they hold.
    """

    imu_t_s: Floats
    """Shape (n,), 100 Hz."""
    imu: Floats
    """Shape (n, 6): ax, ay, az [m/s²], gx, gy, gz [rad/s]."""
    tacho_t_s: Floats
    pulses: NDArray[np.int64]
    """Cumulative counts."""
    pulses_per_revolution: float
    wheel_diameter_m: float
    """Nominal; the true one is `true_wheel_diameter_m`."""
    imu_latency_s: float
    max_gradient_permille: float
    truth_t_s: Floats
    """10 Hz."""
    distance_m: Floats
    speed_mps: Floats
    slip: NDArray[np.int8]
    """-1 slide, +1 spin, 0 adhering (micro-slip up to 2 % or 0.3 m/s included)."""
    acceleration_mps2: Floats
    way_m: Floats
    """Of the front end along the track."""
    trip: NDArray[np.int64]
    wheel_slip_m: Floats
    """Way of the wheel's rim minus way of the train, so far."""
    true_wheel_diameter_m: float

    @property
    def slips(self) -> int:
        """Slides and spins in the log."""
        return int(np.count_nonzero((self.slip[1:] != 0) & (self.slip[:-1] == 0)))


def simulate_motion_log(
    track: TrackTable,
    settings: MotionSettings,
    generator: np.random.Generator,
    *,
    duration_s: float | None = None,
    start_m: float = 0.0,
) -> MotionLog:
    """A run along `track` from rest at `start_m`: `duration_s` of it, there and back as often as fits.

    Without a duration until the train has come to rest at the last stop. The same track, settings and
    generator state give the same log.
    """
    simulator = MotionSimulator(track, settings, generator, start_m=start_m, turns_back=duration_s is not None)
    late = round(settings.imu.latency_s / STEP_S)
    parts: list[MotionSamples] = []
    wanted = None if duration_s is None else round(duration_s / STEP_S) + late
    done = 0
    while (wanted is None and not simulator.finished) or (wanted is not None and done < wanted):
        count = CHUNK if wanted is None else min(CHUNK, wanted - done)
        parts.append(simulator.advance(count))
        done += count
    return motion_log_of(parts, settings, generator)


def motion_log_of(parts: list[MotionSamples], settings: MotionSettings, generator: np.random.Generator) -> MotionLog:
    """A log of consecutive samples; its time 0 is when the inertial sensor's first sample comes in."""
    late = round(settings.imu.latency_s / STEP_S)
    imu = np.concatenate([part.imu for part in parts])
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts])[late:]
        for name in ("distance_m", "way_m", "trip", "speed_mps", "acceleration_mps2", "wheel_way_m", "slip")
    }
    t_s: Floats = np.asarray(np.arange(1, len(imu) - late + 1) * STEP_S, np.float64)
    tacho = Tachometer(settings.tacho, settings.vehicle, generator)
    every = 100 // settings.tacho.rate_hz
    rows, truth = slice(every - 1, None, every), slice(TRUTH_EVERY - 1, None, TRUTH_EVERY)
    start_m, rim_m = columns["distance_m"][0], columns["wheel_way_m"][0]
    distance = columns["distance_m"] - start_m
    return MotionLog(
        imu_t_s=t_s,
        imu=imu[: len(t_s)],
        tacho_t_s=t_s[rows],
        pulses=tacho.counts(columns["wheel_way_m"][rows] - rim_m),
        pulses_per_revolution=float(settings.vehicle.teeth),
        wheel_diameter_m=settings.vehicle.wheel_diameter_m,
        imu_latency_s=settings.imu.latency_s,
        max_gradient_permille=settings.max_gradient_permille,
        truth_t_s=t_s[truth],
        distance_m=distance[truth],
        speed_mps=columns["speed_mps"][truth],
        slip=columns["slip"][truth],
        acceleration_mps2=columns["acceleration_mps2"][truth],
        way_m=columns["way_m"][truth],
        trip=columns["trip"][truth],
        wheel_slip_m=(columns["wheel_way_m"] - rim_m - distance)[truth],
        true_wheel_diameter_m=tacho.diameter_m,
    )


def slip_runs(
    seed: int,
    count: int,
    settings: MotionSettings | None = None,
    track: TrackSettings | None = None,
    *,
    duration_s: float = 1800.0,
) -> Iterator[MotionLog]:
    """Motion logs until `count` slips are in them, each `duration_s` long on a track of its own.

    Settings without random slips get one about every 45 s. Of use are, in `settings`,
    `adhesion.micro_slip`, `imu.gyro_bias_dps`, `imu.accelerometer_bias_mps2`, `imu.vibration`,
    `imu.mounting_deg`, `imu.grade`, `tacho.wheel_scale`, `vehicle`; in `track`, `max_gradient_permille`
    (16 and 33 are the paper's lines) and `radius_m`. Run i depends on `seed` and i alone. Raises ValueError
    when the first BARREN runs hold no slip, as with an axle that is neither driven nor braked.
    """
    settings = settings or MotionSettings()
    track = track or TrackSettings()
    if settings.adhesion.random_gap_s is None:
        slippery = msgspec.structs.replace(settings.adhesion, random_gap_s=45.0)
        settings = msgspec.structs.replace(settings, adhesion=slippery)
    seen, run = 0, 0
    while seen < count:
        generator = np.random.default_rng([seed, run])
        log = simulate_motion_log(random_track(track, generator), settings, generator, duration_s=duration_s)
        seen, run = seen + log.slips, run + 1
        if not seen and run >= BARREN:
            msg = f"{run} runs without a slip: the settings allow none"
            raise ValueError(msg)
        yield log
