"""Drives of the Wheel Inertial Dataset (Nemec et al. 2024, figshare 27129999): a car as a motion log.

A trial holds CAR (inertial sensor on the chassis: y forward, x right, z up), IMU1 and IMU2 (on the front wheels, z
along the axle: their rate is the wheel's) and GNSS (satellite positions), each with a clock of its own. The clocks
are brought together by the motion itself: the wheels' acceleration against the chassis', the satellites' speed
against the wheels'. GNSS times run ten times too slow.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.motion_sensors.clock_alignment import LEAST_LIKENESS, Alignment, align, running_mean
from services.motion_sensors.import_file import (
    PULSES,
    WHEEL_M,
    Floats,
    ImportFileError,
    Recording,
    integral,
    pulses_of_speed,
    read_columns,
)

XSENS: Final = {
    "t": "SampleTimeFine",
    **{f"{kind}{axis}": f"{word}_{axis.upper()}" for kind, word in (("a", "Acc"), ("g", "Gyr")) for axis in "xyz"},
}
GNSS: Final = {"t": "Timestamp", "lat": "Lat_GNSS", "lon": "Long_GNSS"}
GNSS_SECOND: Final = 10.0
TICK_S: Final = 1e-6
REST_S: Final = 1.5
MOST_BIAS_RADPS: Final = 0.1
QUIET_RADPS: Final = 0.04
"""A wheel stands where its rate is below the one and spreads by less than the other over REST_S."""
TURNING_RADPS: Final = 0.03
"""A slower wheel, its bias taken off, stands: the counter of a standing one keeps still."""
LEAST_STEP_M: Final = 0.03
"""Smaller steps between fixes are noise of a standing car."""
EARTH_M: Final = 6_371_000.0
SMOOTHING_S: Final = 0.5


def read_wid(trial: Path) -> Recording:
    """A trial's folder, its wheels as large as the satellites say. Raises ImportFileError, OSError."""
    car, wheels = _xsens(trial / "CAR.csv.gz"), [_xsens(trial / f"IMU{k}.csv.gz") for k in (1, 2)]
    rate = round(1.0 / float(np.median(np.diff(car[:, 0]))))
    turning = [_wheel_rate(one) for one in wheels]
    other = _told(align(wheels[0][:, 0], turning[0], wheels[1][:, 0], turning[1]), trial, "IMU1 and IMU2")
    wheel_radps = 0.5 * (turning[0] + np.interp(wheels[0][:, 0], wheels[1][:, 0] + other, turning[1]))
    smooth = running_mean(wheel_radps, round(SMOOTHING_S * rate))
    pull = running_mean(car[:, 2], round(SMOOTHING_S * rate))
    wheel_s = wheels[0][:, 0]
    wheel_s = wheel_s + _told(align(car[:, 0], pull, wheel_s, np.gradient(smooth, wheel_s)), trial, "CAR and IMU1")
    fix_s, way_m = _satellite_way(trial / "GNSS.csv.gz")
    middle_s, speed_mps = 0.5 * (fix_s[1:] + fix_s[:-1]), np.diff(way_m) / np.diff(fix_s)
    fix_s = fix_s + _told(align(wheel_s, wheel_radps, middle_s, speed_mps), trial, "IMU1 and GNSS")
    first_s, last_s = max(wheel_s[0], fix_s[0]), min(wheel_s[-1], fix_s[-1])
    turned = np.diff(np.interp([first_s, last_s], wheel_s, integral(wheel_s, wheel_radps)))
    radius_m = float(np.diff(np.interp([first_s, last_s], fix_s, way_m))[0] / turned[0])
    zero = float(min(car[0, 0], wheel_s[0]))
    counted = _standing(wheel_radps, round(SMOOTHING_S * rate))
    tacho_s, pulses = pulses_of_speed(wheel_s - zero, counted * WHEEL_M / 2.0)
    six = np.column_stack([car[:, 2], -car[:, 1], car[:, 3], car[:, 5], -car[:, 4], car[:, 6]])
    reached = fix_s >= zero
    true_s, true_m = fix_s[reached] - zero, way_m[reached] - way_m[reached][0]
    truth = (true_s, true_m, np.gradient(true_m, true_s))
    return Recording(car[:, 0] - zero, six, tacho_s, pulses, PULSES, 2.0 * radius_m, truth)


def _told(found: Alignment, trial: Path, names: str) -> float:
    if found.likeness < LEAST_LIKENESS:
        msg = f"{trial}: {names} cannot be brought together (correlation {found.likeness:.2f}): not one drive?"
        raise ImportFileError(msg)
    return found.offset_s


def _xsens(path: Path) -> NDArray[np.float64]:
    """Time [s] from the start, specific force, angular rates [rad/s], shape (n, 7); without the first, empty row."""
    table = read_columns(path, XSENS, tuple(XSENS))[1:]
    table[:, 0] = (table[:, 0] - table[0, 0]) * TICK_S
    table[:, 4:] = np.radians(table[:, 4:])
    risen: NDArray[np.float64] = table[np.r_[True, np.diff(table[:, 0]) > 0.0]]
    return risen


def _wheel_rate(wheel: NDArray[np.float64]) -> Floats:
    """Rate of the wheel [rad/s], forwards, without the bias that it has at rest, wherever in the drive that is."""
    rate: Floats = wheel[:, 6]
    samples = round(REST_S / float(np.median(np.diff(wheel[:, 0]))))
    mean = running_mean(rate, samples)
    spread = np.sqrt(np.maximum(running_mean(rate * rate, samples) - mean * mean, 0.0))
    rest = (np.abs(mean) < MOST_BIAS_RADPS) & (spread < QUIET_RADPS)
    rate = rate - (np.median(rate[rest]) if rest.any() else 0.0)
    return rate if rate.sum() > 0.0 else -rate


def _standing(rate_radps: Floats, samples: int) -> Floats:
    """The wheels' rate, nought where they stand."""
    return np.where(np.abs(running_mean(rate_radps, samples)) < TURNING_RADPS, 0.0, rate_radps)


def _satellite_way(path: Path) -> tuple[Floats, Floats]:
    """Times and way of the fixes, which are repeated many times over; over gaps in them the car has stood."""
    table = read_columns(path, GNSS, tuple(GNSS))
    fresh = np.r_[True, (np.diff(table[:, 1:], axis=0) != 0.0).any(axis=1)]
    east_m = np.radians(table[:, 2]) * EARTH_M * np.cos(np.radians(table[0, 1]))
    north_m = np.radians(table[:, 1]) * EARTH_M
    t_s = table[fresh, 0] / GNSS_SECOND
    steps_m = np.hypot(np.diff(east_m[fresh]), np.diff(north_m[fresh]))
    steps_m[steps_m < LEAST_STEP_M] = 0.0
    return t_s, np.concatenate([[0.0], np.cumsum(steps_m)])
