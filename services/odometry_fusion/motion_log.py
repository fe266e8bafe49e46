"""What odometry is made of and what it gives: samples of one run, and rows at 10 Hz.

Axes x forward, y left, z up, right-handed; specific force; angular rates right-handed about these axes.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
"""Shape (n,)."""
SixAxes = NDArray[np.float64]
"""Shape (n, 6): ax, ay, az [m/s²], gx, gy, gz [rad/s]."""
Counts = NDArray[np.int64]
"""Shape (n,)."""

PERIOD_S: Final = 0.1
"""Processing period (Iwata et al., section 4.1)."""
VALID: Final = 0
DEGRADED: Final = 1
LOST: Final = 2
STATUSES: Final = ("valid", "degraded", "lost")
"""Words of the codes above."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What must be known of a vehicle and its sensors."""

    pulses_per_revolution: float
    wheel_diameter_m: float
    imu_latency_s: float
    """A sample of the inertial sensor stamped t shows the motion at t minus this."""
    max_gradient_permille: float

    @property
    def metres_per_pulse(self) -> float:
        """Way of the wheel's rim per pulse."""
        return float(np.pi * self.wheel_diameter_m / self.pulses_per_revolution)


@dataclass(frozen=True, slots=True, eq=False)
class MotionLog:
    """Samples of one run. Times rise strictly; both sensors share one clock; gaps are allowed."""

    imu_t_s: Floats
    imu: SixAxes
    tacho_t_s: Floats
    pulses: Counts
    """Cumulative counts; falls only where the counter can tell backwards, or where it began anew."""
    pulses_per_revolution: float
    wheel_diameter_m: float
    imu_latency_s: float
    max_gradient_permille: float

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle that the log describes."""
        return Vehicle(
            self.pulses_per_revolution, self.wheel_diameter_m, self.imu_latency_s, self.max_gradient_permille
        )

    @property
    def end_s(self) -> float:
        """Time of the last sample."""
        return float(max(self.imu_t_s[-1] if len(self.imu_t_s) else -np.inf, self.tacho_t_s[-1]))


@dataclass(frozen=True, slots=True)
class Episode:
    """Beginning or end of a slide or spin, as of `t_s`."""

    t_s: float
    number: int
    phase: Literal["began", "ended", "not_found"]
    slip: Literal[-1, 1]
    start_t_s: float
    correction_s: float
    corrected_m: float | None
    """Distance by the inertial sensor minus distance by the wheel."""
    bound_m: float
    stop_demanded: bool
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class MotionRows:
    """Odometry at instants `t_s`; every column has shape (n,). NaN where a value is not to be had.

    The meaning of the columns is that of the message `schemas.motion.Odometry`.
    """

    t_s: Floats
    distance_m: Floats
    way_m: Floats
    speed_mps: Floats
    speed_bound_mps: Floats
    acceleration_mps2: Floats
    slip: NDArray[np.int8]
    """-1 slide, +1 spin, 0 adhering."""
    standstill: NDArray[np.bool_]
    bound_m: Floats
    """Finite, for the error of `distance_m` since the first row."""
    excess_m: Floats
    provisional_m: Floats
    status: NDArray[np.int8]
    """VALID, DEGRADED or LOST."""
    reason: NDArray[np.int16]
    """Number in `reasons` of what is wrong."""
    curvature_per_m: Floats
    curvature_sigma_per_m: Floats
    curvature_distance_m: Floats
    gradient_permille: Floats
    wheel_scale: Floats
    gyro_bias_radps: Floats
    since_standstill_s: Floats
    share_bound: float
    """Relative error of distance outside slips."""
    sensor_delay_s: float
    reasons: tuple[str, ...] = ("",)
    """The first is empty: nothing is wrong."""
    episodes: tuple[Episode, ...] = ()
    """In order of time."""

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.t_s)


def columns_of(rows: MotionRows) -> dict[str, NDArray[np.generic]]:
    """The columns of rows by name, in the order of their declaration."""
    found = {field.name: getattr(rows, field.name) for field in fields(rows)}
    return {name: value for name, value in found.items() if isinstance(value, np.ndarray)}


@dataclass(frozen=True, slots=True)
class Remembered:
    """What outlives a restart: it holds for the vehicle and its sensors, not for one run."""

    roll_bias_radps: float = 0.0
    """Of the angular rates gx, gy, gz, in this order."""
    pitch_bias_radps: float = 0.0
    yaw_bias_radps: float = 0.0
    wheel_scale: float | None = None
    """True over nominal wheel diameter."""
    wheel_scale_sigma: float = 0.0
    """Its standard deviation."""
    rest_mps2: float | None = None
    rest_radps: float | None = None
    """How much the inertial sensor's forces and rates are shaken at rest (`first_rest`)."""


class OdometryStep(Protocol):
    """A method of odometry at work: the same object serves a whole file in one call and live samples bit by bit.

    However the samples are cut into calls, the rows are the same. The first row's time is that of the first
    tacho sample; further rows follow every PERIOD_S. A row uses the samples stamped at or before its time
    (times compared in whole nanoseconds).
    """

    def advance(self, until_s: float, imu_t_s: Floats, imu: SixAxes, tacho_t_s: Floats, pulses: Counts) -> MotionRows:
        """Take in new samples, which follow those of earlier calls, and give the rows due until `until_s`."""
        ...

    def remembered(self) -> Remembered | None:
        """What to keep for the next start; None while nothing has been learned."""
        ...
