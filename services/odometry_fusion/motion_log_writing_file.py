"""Writes motion logs: motion.toml, imu.parquet, tacho.parquet, truth.parquet (docs/simulator.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import duckdb
import numpy as np
from numpy.typing import NDArray

AXES = "x forward, y left, z up; right-handed; accelerometers give specific force"
IMU_COLUMNS = ("ax_mps2", "ay_mps2", "az_mps2", "gx_radps", "gy_radps", "gz_radps")


def write_about(path: Path, numbers: dict[str, float | int | str]) -> None:
    """Write motion.toml: the axes, and what must be known of vehicle and sensors."""
    lines = [f'axes = "{AXES}"']
    lines += [
        f'{name} = "{value}"' if isinstance(value, str) else f"{name} = {value!r}" for name, value in numbers.items()
    ]
    path.write_text("\n".join(lines) + "\n", "utf-8")


def write_imu(path: Path, t_s: NDArray[np.float64], imu: NDArray[np.float64]) -> None:
    """Write samples of shape (n, 6); single precision holds more than any sensor gives."""
    single = imu.astype(np.float32)
    write_table(path, {"t_s": t_s, **{name: single[:, k] for k, name in enumerate(IMU_COLUMNS)}})


def write_table(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    """Write columns of one length as Parquet. The same columns give the same bytes. Raises OSError."""
    table = {name: np.ascontiguousarray(column) for name, column in columns.items()}
    target = str(path).replace("'", "''")
    with duckdb.connect() as base:
        base.execute("SET threads = 1")
        base.register("written", table)
        base.execute(f"COPY (SELECT * FROM written) TO '{target}' (FORMAT parquet, COMPRESSION zstd)")  # noqa: S608 - our own path, quotes doubled
