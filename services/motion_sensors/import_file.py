"""Other people's motion recordings read, and motion logs written.

comma2k19: a segment's folder (processed_log/CAN/wheel_speed, processed_log/IMU, global_pose), axes forward,
right, down. Tables: one CSV for the inertial sensor, one for pulses or speed, columns named by the user.
"""

from __future__ import annotations

import gzip
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import duckdb
import numpy as np
from numpy.typing import NDArray

from services.motion_sensors.imu_sample import STANDARD_GRAVITY_MPS2
from services.odometry_fusion.motion_log_writing_file import write_about, write_imu, write_table

Floats = NDArray[np.float64]

WHEEL_M: Final = 0.6
PULSES: Final = 10_000.0
"""Of the counter that is made of a measured speed: fine enough to add nothing to it."""
UNITS: Final = {
    "g": STANDARD_GRAVITY_MPS2,
    "mps2": 1.0,
    "dps": float(np.radians(1.0)),
    "radps": 1.0,
    "kmh": 1 / 3.6,
    "mps": 1.0,
}


LARGEST: Final = 1e6
"""No sensor of a vehicle measures more, in whatever unit; rows beyond are no measurements."""
LARGEST_BY_NAME: Final = {"t": 1e19, "pulses": 2.0**53}
"""Nanoseconds since 1970, with room; counts as long as they are exact."""
LONGEST_S: Final = 2.7e6
"""A recording of more than a month has its times in another unit."""
MOST_UNPAIRED: Final = 0.01


class ImportFileError(ValueError):
    """A recording that cannot be read; names the file and what is wrong."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A run as motion logs hold it (vehicle axes, seconds from its start)."""

    imu_t_s: Floats
    imu: NDArray[np.float64]
    tacho_t_s: Floats
    pulses: NDArray[np.int64]
    pulses_per_revolution: float
    wheel_diameter_m: float
    truth: tuple[Floats, Floats, Floats] | None = None
    """Time, distance and speed, where the recording knows better than its wheels."""
    notes: tuple[str, ...] = ()
    """What was left out."""


def read_comma2k19(segment: Path) -> Recording:
    """A segment of comma2k19. Raises ImportFileError, OSError."""
    log, pose = segment / "processed_log", segment / "global_pose"
    force_t, force = _series(log / "IMU/accelerometer/t", log / "IMU/accelerometer/value", 3)
    rate_t, rate = _series(log / "IMU/gyro/t", log / "IMU/gyro/value", 3)
    wheel_t, wheel = _series(log / "CAN/wheel_speed/t", log / "CAN/wheel_speed/value", 4)
    truth_t, velocity = _series(pose / "frame_times", pose / "frame_velocities", 3)
    zero = float(min(force_t[0], wheel_t[0], truth_t[0]))
    if len(rate_t) == len(force_t):
        rates = rate
    else:
        rates = np.stack([np.interp(force_t, rate_t, rate[:, k]) for k in range(3)], axis=1)
    signs = np.array([1.0, -1.0, -1.0])
    speed = np.linalg.norm(velocity, axis=1)
    tacho_t, pulses = pulses_of_speed(wheel_t - zero, wheel.mean(axis=1))
    return Recording(
        *_rising(force_t - zero, np.concatenate([force * signs, rates * signs], axis=1)),
        tacho_t,
        pulses,
        PULSES,
        WHEEL_M,
        (truth_t - zero, integral(truth_t, speed), speed),
    )


def read_tables(
    imu_path: Path,
    imu_columns: dict[str, str],
    tacho_path: Path,
    tacho_columns: dict[str, str],
    rotation: NDArray[np.float64],
    *,
    time_scale: float = 1.0,
    force_unit: str = "mps2",
    rate_unit: str = "radps",
    speed_unit: str = "mps",
    pulses_per_revolution: float = PULSES,
    wheel_diameter_m: float = WHEEL_M,
) -> Recording:
    """Two CSV tables. Column names by `t`, `ax` … `gz`, and `t` with `pulses` or `speed`. Raises ImportFileError."""
    imu, imu_note = _rows(imu_path, imu_columns, ("t", "ax", "ay", "az", "gx", "gy", "gz"))
    named = "pulses" if "pulses" in tacho_columns else "speed"
    tacho, tacho_note = _rows(tacho_path, tacho_columns, ("t", named))
    notes = tuple(note for note in (imu_note, tacho_note) if note)
    zero = min(float(imu[0, 0]), float(tacho[0, 0]))
    forces = imu[:, 1:4] * UNITS[force_unit] @ rotation.T
    rates = imu[:, 4:7] * UNITS[rate_unit] @ rotation.T
    imu_t, six = _rising((imu[:, 0] - zero) * time_scale, np.concatenate([forces, rates], axis=1))
    tacho_t = (tacho[:, 0] - zero) * time_scale
    if named == "speed":
        counted_t, pulses = pulses_of_speed(tacho_t, tacho[:, 1] * UNITS[speed_unit])
        return Recording(imu_t, six, counted_t, pulses, PULSES, WHEEL_M, notes=notes)
    counted_t, counts = _rising(tacho_t, tacho[:, 1:])
    pulses = np.rint(counts[:, 0]).astype(np.int64)
    return Recording(imu_t, six, counted_t, pulses, pulses_per_revolution, wheel_diameter_m, notes=notes)


def pulses_of_speed(t_s: Floats, speed_mps: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Cumulative pulses of a wheel of WHEEL_M with PULSES, whose speed was measured; times that rise."""
    times, speeds = _rising(t_s, speed_mps[:, None])
    return times, np.rint(integral(times, speeds[:, 0]) * PULSES / (np.pi * WHEEL_M)).astype(np.int64)


def write_motion_log(folder: Path, run: Recording, latency_s: float, max_gradient_permille: float) -> None:
    """Write a motion log beside `folder`, then put it there; an existing folder is not touched.

    Raises ImportFileError for a recording that is no run, and OSError.
    """
    _require_run(run)
    if folder.exists():
        msg = f"{folder} is there already: remove it, or name another"
        raise FileExistsError(msg)
    beside = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir(parents=True)
    try:
        about: dict[str, float | int | str] = {
            "pulses_per_revolution": run.pulses_per_revolution,
            "wheel_diameter_m": run.wheel_diameter_m,
            "imu_latency_s": latency_s,
            "max_gradient_permille": max_gradient_permille,
        }
        write_about(beside / "motion.toml", about)
        write_imu(beside / "imu.parquet", run.imu_t_s, run.imu)
        write_table(beside / "tacho.parquet", {"t_s": run.tacho_t_s, "pulses": run.pulses})
        if run.truth is not None:
            t_s, distance_m, speed_mps = run.truth
            slip = np.zeros(len(t_s), np.int8)
            write_table(
                beside / "truth.parquet", {"t_s": t_s, "distance_m": distance_m, "speed_mps": speed_mps, "slip": slip}
            )
        beside.rename(folder)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _require_run(run: Recording) -> None:
    """Refuse a recording without a beginning and an end. Raises ImportFileError."""
    for name, t_s in (("inertial sensor", run.imu_t_s), ("counter", run.tacho_t_s)):
        if len(t_s) < 2 or not 0.0 < t_s[-1] - t_s[0] <= LONGEST_S:  # noqa: PLR2004 - a beginning and an end
            long_s = float(t_s[-1] - t_s[0]) if len(t_s) else 0.0
            msg = f"the {name}'s {len(t_s)} samples last {long_s:g} s: are the column and the unit of time right?"
            raise ImportFileError(msg)


def _series(times: Path, values: Path, width: int) -> tuple[Floats, NDArray[np.float64]]:
    """Times (n,) and their values (n, width); of more times than values, or the other way round, the common beginning.

    Raises ImportFileError.
    """
    t_s, table = _array(times, LARGEST_BY_NAME["t"]), _array(values, LARGEST)
    if t_s.ndim != 1 or table.ndim != 2 or table.shape[1] != width:  # noqa: PLR2004 - rows and columns
        msg = f"{values}: an array of n rows of {width} beside n times is wanted, not {table.shape} beside {t_s.shape}"
        raise ImportFileError(msg)
    count = min(len(t_s), len(table))
    if abs(len(t_s) - len(table)) > MOST_UNPAIRED * count:
        msg = f"{values}: {len(table)} rows, but {len(t_s)} times in {times.name}: one of the files is cut off"
        raise ImportFileError(msg)
    return t_s[:count], table[:count]


def _array(path: Path, largest: float) -> NDArray[np.float64]:
    try:
        array = np.load(path, allow_pickle=False)
    except (FileNotFoundError, ValueError) as error:
        msg = f"{path}: {error} (a comma2k19 segment holds processed_log and global_pose)"
        raise ImportFileError(msg) from error
    if array.size == 0 or array.dtype.kind not in "iuf" or not (np.abs(array) <= largest).all():
        msg = f"{path}: empty, or not all numbers that can be measured"
        raise ImportFileError(msg)
    return np.asarray(array, np.float64)


def read_columns(path: Path, names: dict[str, str], wanted: tuple[str, ...]) -> NDArray[np.float64]:
    """Wanted columns as numbers, rows with anything else left out."""
    return _rows(path, names, wanted)[0]


def _rows(path: Path, names: dict[str, str], wanted: tuple[str, ...]) -> tuple[NDArray[np.float64], str]:
    """Wanted columns as numbers, and in words how many rows with anything else were left out."""
    missing = [one for one in wanted if one not in names]
    if missing:
        msg = f"{path}: say which column is {', '.join(missing)}"
        raise ImportFileError(msg)
    # Some loggers write a line `sep=,` before the header, which has the longest line after it.
    with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
        start = file.read(4)
    skip = 1 if start == b"sep=" else 0
    connection = duckdb.connect()
    try:
        # A row that holds anything but numbers in these columns is left out.
        relation = connection.read_csv(
            str(path),
            skiprows=skip,
            header=True,
            dtype={names[one]: "DOUBLE" for one in wanted},
            store_rejects=True,
            null_padding=True,
        )
        missing = [names[one] for one in wanted if names[one] not in relation.columns]
        if missing:
            msg = f"{path}: no column {', '.join(missing)} among {', '.join(relation.columns)}"
            raise ImportFileError(msg)
        rows = relation.fetchnumpy()
        rejected = connection.execute("select count(distinct line), min(line) from reject_errors").fetchone()
    except duckdb.Error as error:
        msg = f"{path}: {str(error).splitlines()[0]}"
        raise ImportFileError(msg) from error
    finally:
        connection.close()
    table = np.stack(
        [np.ma.filled(np.ma.asarray(one, np.float64), np.nan) for one in (rows[names[name]] for name in wanted)], axis=1
    )
    whole = len(table)
    most = np.array([LARGEST_BY_NAME.get(name, LARGEST) for name in wanted])
    table = table[(np.abs(table) <= most).all(axis=1)]
    if len(table) < 2:  # noqa: PLR2004 - a run has a beginning and an end
        msg = f"{path}: no rows of numbers in the columns {', '.join(names[one] for one in wanted)}"
        raise ImportFileError(msg)
    count, first = rejected or (0, None)
    left_out = count + whole - len(table)
    where = f", line {first} for one" if first else ""
    return table, f"{path}: {left_out} rows that are no measurements left out{where}" if left_out else ""


def _rising(t_s: Floats, values: NDArray[np.float64]) -> tuple[Floats, NDArray[np.float64]]:
    """In order of time, each time once."""
    times, first = np.unique(t_s, return_index=True)
    return np.ascontiguousarray(times), np.ascontiguousarray(values[first])


def integral(t_s: Floats, values: Floats) -> Floats:
    """Running integral by trapezia, from 0."""
    return np.concatenate([[0.0], np.cumsum(np.diff(t_s) * (values[1:] + values[:-1]) / 2.0)])
