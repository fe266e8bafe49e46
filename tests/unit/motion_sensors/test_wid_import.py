"""Drives of the Wheel Inertial Dataset: clocks brought together, files read, refused where they are no one drive."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from services.motion_sensors.clock_alignment import align, running_mean
from services.motion_sensors.import_file import ImportFileError
from services.motion_sensors.wid_file import read_wid
from services.odometry_fusion.motion_log import Floats

RADIUS_M = 0.29
RATE_HZ = 120.0
CAR_S, WHEEL_S, OTHER_S, FIX_S = 0.0, 0.37, 0.25, -0.4
"""When each clock shows nought."""


def speed_at(t_s: Floats) -> Floats:
    """Two runs with a stop between them, unlike each other."""
    return np.interp(t_s, [0, 12, 18, 30, 35, 45, 49, 60, 66, 90], [0, 0, 6, 6, 0, 0, 4, 5, 0, 0])


def test_an_offset_between_clocks_is_found_and_likeness_told() -> None:
    one_s, two_s = np.arange(0.0, 80.0, 0.008), np.arange(0.0, 70.0, 0.01)
    found = align(one_s, speed_at(one_s), two_s, speed_at(two_s + 3.21))
    # The offset is found to the grid of 0.01 s.
    assert found.offset_s == pytest.approx(3.21, abs=0.011)
    # Not 1: each lacks a piece of the other at its ends, and has another mean.
    assert found.likeness > 0.9
    noise = np.random.default_rng(1).normal(size=len(two_s))
    assert align(one_s, speed_at(one_s), two_s, noise).likeness < 0.5
    assert align(one_s, speed_at(one_s), two_s, 0.0 * two_s).likeness == 0.0


def test_a_running_mean_is_centred_and_shorter_at_the_ends() -> None:
    assert running_mean(np.array([1.0, 2.0, 3.0, 4.0, 8.0]), 3) == pytest.approx([1.5, 2.0, 3.0, 5.0, 6.0])


def xsens(path: Path, zero_s: float, columns: dict[int, Floats], t_s: Floats) -> None:
    """A file as the logger writes it: `sep=`, a trailing comma, an empty first sample, microseconds."""
    head = "PacketCounter,SampleTimeFine,Euler_X,Euler_Y,Euler_Z,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,"
    rows = np.zeros((len(t_s), 11))
    rows[:, 0], rows[:, 1] = np.arange(len(t_s)), np.rint(2.6e9 + (t_s - zero_s) * 1e6)
    for place, values in columns.items():
        rows[1:, place] = values[1:]
    with gzip.open(path, "wt") as file:
        file.write(f"sep=,\n{head}\n")
        file.writelines(", ".join(f"{value:.9g}" for value in row) + ", \n" for row in rows)


def write_trial(folder: Path, wheel_sign: float = -1.0) -> None:
    rng = np.random.default_rng(2)
    t_s = np.arange(CAR_S, 85.0, 1.0 / RATE_HZ)
    noise = rng.normal(0.0, 0.05, (len(t_s), 3))
    pull = np.gradient(speed_at(t_s), t_s)
    xsens(
        folder / "CAR.csv.gz",
        CAR_S,
        {5: noise[:, 0] + 0.2, 6: pull + noise[:, 1], 7: noise[:, 2] + 9.8, 10: 0.5 + 0 * t_s},
        t_s,
    )
    for name, zero_s in (("IMU1", WHEEL_S), ("IMU2", OTHER_S)):
        wheel_s = np.arange(zero_s, 84.0, 1.0 / RATE_HZ)
        rate = wheel_sign * np.degrees(speed_at(wheel_s) / RADIUS_M) + 0.6 + 0.003 * wheel_s
        xsens(folder / f"{name}.csv.gz", zero_s, {10: rate}, wheel_s)
    fix_s = np.arange(FIX_S, 84.0, 0.01)
    fixed_s = np.floor((fix_s - FIX_S) / 0.2) * 0.2 + FIX_S
    grid_s = np.arange(-1.0, 90.0, 0.01)
    way_m = np.interp(fixed_s, grid_s, np.cumsum(speed_at(grid_s)) * 0.01)
    with gzip.open(folder / "GNSS.csv.gz", "wt") as file:
        file.write("Timestamp,Lat_GNSS,Long_GNSS\n")
        lat = 32.77 + np.degrees(way_m / 6_371_000.0)
        file.writelines(f"{k / 10},{one:.9f},35.047\n" for k, one in enumerate(lat))


def test_a_trial_becomes_a_recording_on_one_clock(tmp_path: Path) -> None:
    write_trial(tmp_path)
    run = read_wid(tmp_path)
    # Satellites give the wheel's size: steps below 0.03 m between fixes are left out, which is 0.1 % here.
    assert run.wheel_diameter_m == pytest.approx(2.0 * RADIUS_M, rel=0.005)
    way_m = run.pulses * np.pi * run.wheel_diameter_m / run.pulses_per_revolution
    speed_mps = np.interp(20.0, run.tacho_t_s[1:], np.diff(way_m) / np.diff(run.tacho_t_s))
    assert speed_mps == pytest.approx(6.0, abs=0.05)
    # Times are those of the chassis, from its second sample on; clocks fit to 0.02 s, at up to 1 m/s².
    starts_s = np.array([14.0, 20.0, 33.0, 47.0])
    wheel_mps = np.interp(starts_s, run.tacho_t_s[1:], np.diff(way_m) / np.diff(run.tacho_t_s))
    assert wheel_mps == pytest.approx(speed_at(starts_s + 1.0 / RATE_HZ), abs=0.05)
    assert run.truth is not None
    true_t_s, true_m, _ = run.truth
    # 18 m, 72 m and 15 m until the stop; fixes are 0.2 s apart at up to 6 m/s, steps below 0.03 m are left out.
    assert np.interp(40.0, true_t_s, true_m) == pytest.approx(105.0, abs=0.3)
    # The wheels' gyros drift by 0.1 °/s from one stop to the next, and the counter keeps still at both.
    for first_s, last_s in ((1.0, 11.0), (36.0, 44.0), (67.0, 83.0)):
        assert np.ptp(run.pulses[(run.tacho_t_s > first_s) & (run.tacho_t_s < last_s)]) == 0
    assert np.median(run.imu[:, 2]) == pytest.approx(9.8, abs=0.01)
    assert np.median(run.imu[:, 1]) == pytest.approx(-0.2, abs=0.01)
    assert np.median(run.imu[:, 5]) == pytest.approx(np.radians(0.5), abs=1e-6)


def test_files_of_different_drives_are_refused(tmp_path: Path) -> None:
    write_trial(tmp_path)
    t_s = np.arange(0.0, 60.0, 1.0 / RATE_HZ)
    xsens(tmp_path / "CAR.csv.gz", 0.0, {6: np.random.default_rng(3).normal(size=len(t_s)), 7: 9.8 + 0.0 * t_s}, t_s)
    with pytest.raises(ImportFileError, match="CAR and IMU1 cannot be brought together"):
        read_wid(tmp_path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"CAR\.csv\.gz"):
        read_wid(tmp_path)
