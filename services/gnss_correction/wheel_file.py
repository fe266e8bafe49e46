"""Reads speed by the wheels: CSV with gps_week, tow_s, speed_mps, or the odometry lines of a libRSF input file.

libRSF (TU Chemnitz; the smartLoc data set comes in it) writes one measurement a line. Of `odom3` lines
the second field is the time [s] since the first epoch of the recording, the third the speed forwards [m/s];
turn rates and covariances follow. Lines of other kinds are left alone.
"""

from __future__ import annotations

import csv
import io
import math
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from schemas.gnss_time import WEEK_S
from services.gnss_correction.wheel_speed import WheelSpeeds

COLUMNS: Final = ("gps_week", "tow_s", "speed_mps")
ODOMETRY: Final = "odom3"
FASTEST_MPS: Final = 200.0
LARGEST_BYTES: Final = 512_000_000


class WheelFileError(ValueError):
    """A file that holds no wheel speeds: path, line, what is wrong."""

    def __init__(self, path: Path, line: int, text: str) -> None:
        """Name the file and the line, counted from 1 (0: the file as a whole)."""
        super().__init__(f"{path}:{line}: {text}" if line else f"{path}: {text}")


def read_wheel(path: Path, first_epoch_s: float) -> WheelSpeeds:
    """Speeds in a file; `first_epoch_s` is the recording's first epoch, seconds of GPS time since 1980.

    Samples must rise in time. Raises WheelFileError, OSError.
    """
    if path.stat().st_size > LARGEST_BYTES:
        raise WheelFileError(path, 0, f"larger than {LARGEST_BYTES // 1_000_000} MB")
    try:
        text = path.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise WheelFileError(path, 0, f"not a text file (byte {error.start})") from error
    header = text.split("\n", 1)[0]
    samples = _from_table(path, text) if "," in header else _from_librsf(path, text, first_epoch_s)
    if not samples:
        raise WheelFileError(path, 0, f"holds neither rows of {', '.join(COLUMNS)} nor lines of {ODOMETRY}")
    for (_, before_s, _), (line, now_s, _) in pairwise(samples):
        if now_s <= before_s:
            raise WheelFileError(path, line, "time does not rise")
    return WheelSpeeds(np.array([t_s for _, t_s, _ in samples]), np.array([speed for _, _, speed in samples]))


def _from_table(path: Path, text: str) -> list[tuple[int, float, float]]:
    reader = csv.DictReader(io.StringIO(text), restval="")
    missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
    if missing:
        raise WheelFileError(path, 1, f"no column {', '.join(missing)}")
    samples = []
    try:
        for row in reader:
            week, tow_s, speed = (_figure(path, reader.line_num, name, row[name]) for name in COLUMNS)
            samples.append((reader.line_num, week * WEEK_S + tow_s, _speed(path, reader.line_num, speed)))
    except csv.Error as error:
        raise WheelFileError(path, reader.line_num, f"not a table: {error}") from error
    return samples


def _from_librsf(path: Path, text: str, first_epoch_s: float) -> list[tuple[int, float, float]]:
    samples = []
    for line, words in enumerate(map(str.split, text.splitlines()), 1):
        if not words or words[0] != ODOMETRY:
            continue
        if len(words) < 3:  # noqa: PLR2004 - kind, time, speed
            raise WheelFileError(path, line, f"{ODOMETRY} without time and speed")
        since_s, speed = _figure(path, line, "time", words[1]), _figure(path, line, "speed", words[2])
        samples.append((line, first_epoch_s + since_s, _speed(path, line, speed)))
    return samples


def _figure(path: Path, line: int, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise WheelFileError(path, line, f"{name} is {text!r}, which is no number")
    return value


def _speed(path: Path, line: int, speed_mps: float) -> float:
    if abs(speed_mps) > FASTEST_MPS:
        raise WheelFileError(path, line, f"a speed of {speed_mps:g} m/s is none of a train")
    return speed_mps
