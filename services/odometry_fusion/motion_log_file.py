"""Motion logs: a folder with motion.toml, imu.parquet|csv and tacho.parquet|csv (docs/odometry_fusion.md).

The truth that may lie beside them is never opened here. What cannot be meant (no such column, other
units, no usable sample) is refused; single samples that are broken are left out, counted and named.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import duckdb
import numpy as np
from numpy.typing import NDArray

from services.odometry_fusion.motion_log import Floats, MotionLog, SixAxes

IMU_COLUMNS: Final = ("t_s", "ax_mps2", "ay_mps2", "az_mps2", "gx_radps", "gy_radps", "gz_radps")
TACHO_COLUMNS: Final = ("t_s", "pulses")
AXES: Final = "x forward, y left, z up"
LIMITS: Final = {
    "pulses_per_revolution": (1.0, 100_000.0),
    "wheel_diameter_m": (0.1, 3.0),
    "imu_latency_s": (0.0, 5.0),
    "max_gradient_permille": (0.0, 300.0),
}
"""Smallest and largest value of each number in motion.toml."""
SLOWEST_S: Final = {"imu": 0.11, "tacho": 1.1}
"""Longest median time between samples: the inertial sensor feeds a 10 Hz process."""
FASTEST_S: Final = 1e-5
MOST_BROKEN: Final = 0.05
"""Share of samples that may be left out before the whole table is refused."""
LONGEST_GAP_S: Final = 3_600.0
GRAVITY_MPS2: Final = (6.0, 14.0)
"""Between these lies the median of |specific force| of any train, in m/s²."""
MOST_PULSES: Final = 1e15
MOST_RATE_RADPS: Final = 1.0
"""No train turns faster for a second."""


class MotionLogError(ValueError):
    """A folder or file that is no motion log: path, row, what is wrong."""

    def __init__(self, path: Path, text: str, line: int = 0) -> None:
        """Name the file and the line (csv) or row (parquet), counted from 1 (0: the file as a whole)."""
        super().__init__(f"{path}:{line}: {text}" if line else f"{path}: {text}")


@dataclass(frozen=True, slots=True)
class ReadLog:
    """A log, and what was left out of it."""

    log: MotionLog
    issues: tuple[str, ...]


def read_motion_log(folder: Path) -> ReadLog:
    """Read and check a motion log. Raises MotionLogError, OSError."""
    if not folder.is_dir():
        raise MotionLogError(folder, "no such folder; a motion log is a folder with motion.toml, imu and tacho")
    about = read_about(folder / "motion.toml")
    imu_path, tacho_path = _table_path(folder, "imu"), _table_path(folder, "tacho")
    issues: list[str] = []
    imu_t_s, imu = _samples(imu_path, "imu", IMU_COLUMNS, issues)
    _require_units(imu_path, imu_t_s, imu)
    tacho_t_s, counts = _samples(tacho_path, "tacho", TACHO_COLUMNS, issues)
    if imu_t_s[0] > tacho_t_s[-1] or tacho_t_s[0] > imu_t_s[-1]:
        raise MotionLogError(folder, f"{imu_path.name} and {tacho_path.name} share no time: two clocks?")
    if np.abs(counts).max() > MOST_PULSES:
        raise MotionLogError(tacho_path, f"pulses reach {np.abs(counts).max():g}: no count")
    pulses = np.rint(counts[:, 0]).astype(np.int64)
    return ReadLog(MotionLog(imu_t_s, imu, tacho_t_s, pulses, **about), tuple(issues))


def read_about(path: Path) -> dict[str, float]:
    """Numbers of motion.toml, checked. Raises MotionLogError, OSError."""
    try:
        table = tomllib.loads(path.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise MotionLogError(path, str(error)) from error
    axes = table.get("axes", AXES)
    if not isinstance(axes, str) or not " ".join(axes.lower().replace("=", " ").split()).startswith(AXES):
        raise MotionLogError(path, f"axes {axes!r}: the samples must be given as {AXES!r}; turn them first")
    found: dict[str, float] = {}
    for name, (least, most) in LIMITS.items():
        if name not in table:
            raise MotionLogError(path, f"{name} is missing")
        value = table[name]
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise MotionLogError(path, f"{name} is {value!r}, no number")
        if not least <= value <= most:
            raise MotionLogError(path, f"{name} is {value:g}; it must lie between {least:g} and {most:g}")
        found[name] = float(value)
    return found


def _table_path(folder: Path, name: str) -> Path:
    for ending in ("parquet", "csv"):
        if (path := folder / f"{name}.{ending}").is_file():
            return path
    raise MotionLogError(folder, f"neither {name}.parquet nor {name}.csv is there")


def read_table(path: Path, columns: Sequence[str]) -> NDArray[np.float64]:
    """Columns of a Parquet or CSV table as numbers, shape (rows, columns), NaN where blank. Raises MotionLogError."""
    reader = "read_parquet(?)" if path.suffix == ".parquet" else "read_csv(?, header = true, delim = ',')"
    try:
        with duckdb.connect() as base:
            base.execute("SET threads = 1")
            present = base.execute(f"SELECT * FROM {reader} LIMIT 0", [str(path)]).description or []  # noqa: S608 - reader is one of two literals
            missing = [name for name in columns if name not in [one[0] for one in present]]
            if missing:
                raise MotionLogError(path, f"column {missing[0]!r} is missing; there must be {', '.join(columns)}")
            wanted = ", ".join(f"CAST({name} AS DOUBLE) AS {name}" for name in columns)
            found = base.execute(f"SELECT {wanted} FROM {reader}", [str(path)]).fetchnumpy()  # noqa: S608 - our own names
    except duckdb.Error as error:
        raise MotionLogError(path, " ".join(str(error).split())[:300]) from error
    return np.column_stack([np.ma.filled(found[name], np.nan) for name in columns])


def _samples(path: Path, kind: str, columns: tuple[str, ...], issues: list[str]) -> tuple[Floats, NDArray[np.float64]]:
    """Times and values of the usable samples; adds to `issues` what is left out."""
    table = read_table(path, columns)
    if len(table) < 2:  # noqa: PLR2004 - a rate needs two samples
        raise MotionLogError(path, "fewer than two samples")
    finite = np.isfinite(table).all(axis=1)
    risen = np.r_[-np.inf, np.fmax.accumulate(table[:, 0])[:-1]]
    ordered = table[:, 0] > risen
    first = 2 if path.suffix == ".csv" else 1
    for kept, words in ((finite, "not a finite number"), (ordered | ~finite, "time does not rise")):
        if kept.all():
            continue
        count, line = int((~kept).sum()), int(np.flatnonzero(~kept)[0]) + first
        text = f"{words} in {count} of {len(table)} rows, here first"
        if count > MOST_BROKEN * len(table):
            raise MotionLogError(path, text, line)
        issues.append(str(MotionLogError(path, f"{text}; left out", line)))
    usable = np.flatnonzero(finite & ordered)
    t_s = np.ascontiguousarray(table[usable, 0])
    steps_s = np.diff(t_s)
    usual_s = float(np.median(steps_s))
    if not FASTEST_S <= usual_s <= SLOWEST_S[kind]:
        text = f"t_s rises by {usual_s:g} per row; seconds between {FASTEST_S:g} and {SLOWEST_S[kind]:g} are expected"
        raise MotionLogError(path, text)
    if steps_s.max() > LONGEST_GAP_S:
        line = int(usable[int(steps_s.argmax()) + 1]) + first
        raise MotionLogError(path, f"t_s leaps by {steps_s.max():g} s: cut the log there", line)
    return t_s, np.ascontiguousarray(table[usable, 1:])


def _require_units(path: Path, t_s: Floats, imu: SixAxes) -> None:
    """Refuse a table in g or in degrees."""
    force = float(np.median(np.sqrt((imu[:, :3] ** 2).sum(axis=1))))
    least, most = GRAVITY_MPS2
    if not least <= force <= most:
        text = f"the median of the specific force is {force:.3g}, not about 9.8 m/s²: other units?"
        raise MotionLogError(path, text)
    width = max(1, min(len(t_s) // 4, round(1.0 / float(np.median(np.diff(t_s))))))
    whole = len(imu) // width * width
    means = imu[:whole, 3:].reshape(-1, width, 3).mean(axis=1)
    rate = float(np.percentile(np.abs(means).max(axis=1), 90.0))
    if rate > MOST_RATE_RADPS:
        raise MotionLogError(path, f"angular rates reach {rate:.3g} for seconds on end: degrees instead of radians?")
