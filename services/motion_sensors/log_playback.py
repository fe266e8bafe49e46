"""A motion log as messages: its samples cut into blocks, at times that begin where one likes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Final

import numpy as np

from schemas.motion import ImuBlock, TachoBlock
from services.odometry_fusion.motion_log import MotionLog

NS: Final = 10**9


def blocks_of(log: MotionLog, block_s: float, start_ns: int) -> Iterator[ImuBlock | TachoBlock]:
    """Messages of a log in order of their times; the log's first sample is at `start_ns`.

    The latency of the inertial sensor is taken off its times, as a live sensor's is.
    """
    imu_s, tacho_s = log.imu_t_s - log.imu_latency_s, log.tacho_t_s
    zero_s = float(min([*imu_s[:1], *tacho_s[:1]]))
    imu_ns = np.round((imu_s - zero_s) * NS).astype(np.int64) + start_ns
    tacho_ns = np.round((tacho_s - zero_s) * NS).astype(np.int64) + start_ns
    block_ns = round(block_s * NS)
    cuts = {"imu": _cuts(imu_ns, block_ns, start_ns), "tacho": _cuts(tacho_ns, block_ns, start_ns)}
    order = sorted(
        [(int(imu_ns[b - 1]), 0, a, b) for a, b in cuts["imu"]]
        + [(int(tacho_ns[b - 1]), 1, a, b) for a, b in cuts["tacho"]]
    )
    for last_ns, kind, a, b in order:
        if kind == 0:
            columns = np.ascontiguousarray(log.imu[a:b].T, float)
            yield ImuBlock(
                t_ns=last_ns,
                first_sample=a,
                offset_ns=imu_ns[a:b] - last_ns,
                ax_mps2=columns[0],
                ay_mps2=columns[1],
                az_mps2=columns[2],
                gx_radps=columns[3],
                gy_radps=columns[4],
                gz_radps=columns[5],
            )
        else:
            yield TachoBlock(
                t_ns=last_ns,
                first_sample=a,
                offset_ns=tacho_ns[a:b] - last_ns,
                pulses=np.ascontiguousarray(log.pulses[a:b], np.int64),
                pulses_per_revolution=log.pulses_per_revolution,
                wheel_diameter_m=log.wheel_diameter_m,
            )


def _cuts(times_ns: np.ndarray[tuple[int], np.dtype[np.int64]], block_ns: int, start_ns: int) -> list[tuple[int, int]]:
    """First and last (exclusive) sample of every block."""
    if not len(times_ns):
        return []
    block = (times_ns - start_ns) // block_ns
    edges = [0, *(np.flatnonzero(np.diff(block)) + 1).tolist(), len(times_ns)]
    return list(itertools.pairwise(edges))
