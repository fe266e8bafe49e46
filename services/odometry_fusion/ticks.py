"""Samples of both sensors brought to the instants of the 10 Hz process, aligned to each other, whatever their rates.

The wheel is delayed by the inertial sensor's latency, so that both show the same motion (Iwata et al., section 4.1:
300 ms, three periods).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.even_stamps import GRID, even_times
from services.odometry_fusion.motion_log import PERIOD_S, Counts, Floats, SixAxes, Vehicle
from services.odometry_fusion.pulse_counter import COUNTER, count_way
from services.odometry_fusion.tick_layout import TICK, Records

PERIOD_NS: Final = round(PERIOD_S * 1e9)
KEPT_NS: Final = 8_000_000_000
"""Counts are kept for so long after their time: the longest latency and the longest window fit."""
FROZEN_NS: Final = 1_000_000_000
"""An inertial sensor whose six values stay the same for so long while the wheel turns has stopped measuring."""
LONGEST_USUAL_NS: Final = 1_100_000_000
"""Counters that report less often are taken for missing in between."""
LONGEST_HELD_NS: Final = 30_000_000_000
"""Without counts the last speed is held for so long."""
SPEED_WINDOW_NS: Final = 300_000_000
STOPPED_S: Final = 0.5
STOPPING_MPS2: Final = 1.0
STOPPING_TEETH: Final = 3.0
"""A wheel that turned so slowly that it could stop within so many teeth, and has been silent since, has stopped: its
counter may report every pulse and nothing else."""
MOST_FORCE_MPS2: Final = 160.0
MOST_RATE_RADPS: Final = 40.0
"""Beyond what such sensors can show: the sample is broken."""
MOST_TICKS: Final = 40_000_000

LEAST_ROWS: Final = 8
"""So many rows in a row, all by the same step, and the counter reports whenever it has come so far."""

STEPS: Final = np.dtype([("same", np.int64), ("way_m", np.float64), ("step_m", np.float64)])
"""How many rows have come by the same step (-1: not all have), the last way and step."""

INERTIAL: Final = np.dtype([
    ("seen", np.int64),
    ("t_ns", np.int64),
    ("changed_ns", np.int64),
    ("last", np.float64, (6,)),
    ("mean", np.float64, (6,)),
])  # fmt: skip
"""Last inertial sample, since when it has been the same, and the last mean."""


@kernel
def _mean_samples(first: int, last: int, imu_ns: Counts, imu: SixAxes, moving: int, inertial: Records) -> None:
    """Mean of samples first … last - 1 that are neither broken nor frozen; the former mean where none is left."""
    now = inertial[0]
    total = np.zeros(6)
    count = 0
    for k in range(first, last):
        same, broken = True, False
        for axis in range(6):
            value = imu[k, axis]
            broken = broken or not abs(value) <= (MOST_FORCE_MPS2 if axis < 3 else MOST_RATE_RADPS)  # noqa: PLR2004 - three forces, three rates
            same = same and value == now.last[axis]
        if broken:
            continue
        if not same or now.seen == 0:
            now.changed_ns = imu_ns[k]
        for axis in range(6):
            now.last[axis] = imu[k, axis]
        if moving and imu_ns[k] - now.changed_ns > FROZEN_NS:
            continue
        now.seen = 1
        now.t_ns = imu_ns[k]
        count += 1
        for axis in range(6):
            total[axis] += imu[k, axis]
    if count > 0:
        for axis in range(6):
            now.mean[axis] = total[axis] / count


@kernel
def _quanta(way_m: Floats, pulse_m: float, steps: Records, quantum_m: Floats) -> None:
    """By how much the way grows at least from row to row: a pulse, or the step of a counter that waits for several."""
    now = steps[0]
    for k in range(len(way_m)):
        step_m = abs(way_m[k] - now.way_m)
        if now.same == 1 or (now.same > 1 and abs(step_m - now.step_m) < 0.5 * pulse_m):
            now.same = now.same + 1 if step_m > 0.5 * pulse_m else -1
        elif now.same > 1:
            now.same = -1
        elif now.same == 0:
            now.same = 1
        now.way_m, now.step_m = way_m[k], step_m
        quantum_m[k] = max(pulse_m, step_m) if now.same > LEAST_ROWS else pulse_m


@kernel
def _way_at(t_ns: int, tacho_ns: Counts, way_m: Floats, count: int, pulse_m: float) -> float:
    """Way at an instant, between counts or held on by the last speed; counts from `count` on are not known yet.

    After a step of a single pulse it is held on by another one at most: counters that report every pulse would have.
    """
    after = np.searchsorted(tacho_ns[:count], t_ns, side="right")
    if after == 0:
        return float(way_m[0])
    before = after - 1
    if after < count:
        share = (t_ns - tacho_ns[before]) / (tacho_ns[after] - tacho_ns[before])
        return float(way_m[before] + share * (way_m[after] - way_m[before]))
    age_ns = min(t_ns - tacho_ns[before], LONGEST_HELD_NS)
    held_m = _rate(int(before), tacho_ns, way_m) * age_ns * 1e-9
    if before > 0 and abs(way_m[before] - way_m[before - 1]) < 1.5 * pulse_m:
        held_m = min(pulse_m, max(-pulse_m, held_m))
    return float(way_m[before] + held_m)


@kernel
def _rate(last: int, tacho_ns: Counts, way_m: Floats) -> float:
    """Speed over the last window that ends with count `last`, and at least one step."""
    first = last
    while first > 0 and tacho_ns[last] - tacho_ns[first] < SPEED_WINDOW_NS:
        first -= 1
    if first == last:
        return 0.0
    return float((way_m[last] - way_m[first]) / ((tacho_ns[last] - tacho_ns[first]) * 1e-9))


@kernel
def make_ticks(
    ticks: Records,
    latency_ns: int,
    imu_ns: Counts,
    imu: SixAxes,
    tacho_ns: Counts,
    even_ns: Counts,
    way_m: Floats,
    doubt_m: Floats,
    quantum_m: Floats,
    inertial: Records,
) -> None:
    """Fill ticks whose times are set; inertial samples begin after the tick before the first one.

    Counts are known from their stamps (`tacho_ns`) on, and were taken at `even_ns`.
    """
    now = inertial[0]
    next_imu = np.searchsorted(imu_ns, ticks[0].t_ns - PERIOD_NS, side="right")
    known = np.searchsorted(tacho_ns, ticks[0].t_ns - PERIOD_NS, side="right")
    for k in range(len(ticks)):
        tick = ticks[k]
        tick.doubt_m = 0.0
        while known < len(tacho_ns) and tacho_ns[known] <= tick.t_ns:
            tick.doubt_m += doubt_m[known]
            known += 1
        tick.quantum_m = pulse_m = quantum_m[max(known - 1, 0)]
        tick.way_m = _way_at(tick.t_ns, even_ns, way_m, known, pulse_m)
        tick.aligned_m = _way_at(tick.t_ns - latency_ns, even_ns, way_m, known, pulse_m)
        tick.wheel_speed_mps = _rate(known - 1, even_ns, way_m)
        usual_ns = min(tacho_ns[known - 1] - tacho_ns[known - 2], LONGEST_USUAL_NS) if known > 1 else 0
        tick.tacho_missing_s = max(0.0, (tick.t_ns - tacho_ns[known - 1] - usual_ns) * 1e-9)
        if (
            tick.tacho_missing_s > STOPPED_S
            and tick.wheel_speed_mps**2 < 2.0 * STOPPING_MPS2 * STOPPING_TEETH * pulse_m
        ):
            tick.wheel_speed_mps = 0.0
        last_imu = np.searchsorted(imu_ns, tick.t_ns, side="right")
        _mean_samples(next_imu, last_imu, imu_ns, imu, abs(tick.wheel_speed_mps) > 1.0, inertial)
        next_imu = last_imu
        tick.ax_mps2, tick.ay_mps2, tick.az_mps2 = now.mean[0], now.mean[1], now.mean[2]
        tick.gx_radps, tick.gy_radps, tick.gz_radps = now.mean[3], now.mean[4], now.mean[5]
        tick.imu_missing_s = (tick.t_ns - now.t_ns) * 1e-9 if now.seen else np.inf


class TickMaker:
    """Makes ticks of samples handed over in any cut."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Wait for the first count."""
        self._pulse_m = vehicle.metres_per_pulse
        self._latency_ns = round(vehicle.imu_latency_s * 1e9)
        self._counter = np.zeros(1, COUNTER)
        self._inertial = np.zeros(1, INERTIAL)
        self._imu_ns = np.empty(0, np.int64)
        self._imu = np.empty((0, 6))
        self._tacho_ns = np.empty(0, np.int64)
        self._grid = np.zeros(1, GRID)
        self._even_ns = np.empty(0, np.int64)
        self._way_m = np.empty(0)
        self._doubt_m = np.empty(0)
        self._steps = np.zeros(1, STEPS)
        self._quantum_m = np.empty(0)
        self._next_ns: int | None = None

    @property
    def resets(self) -> int:
        """How often the counter has begun anew."""
        return int(self._counter["resets"][0])

    def advance(self, until_s: float, imu_t_s: Floats, imu: SixAxes, tacho_t_s: Floats, pulses: Counts) -> Records:
        """Ticks due until `until_s`, with what the new samples say. Times rise across calls."""
        self._take(imu_t_s, imu, tacho_t_s, pulses)
        until_ns = round(until_s * 1e9)
        if self._next_ns is None:
            if not len(self._tacho_ns):
                self._forget(until_ns - KEPT_NS)
                return np.empty(0, TICK)
            self._next_ns = int(self._tacho_ns[0])
        due = max(0, (until_ns - self._next_ns) // PERIOD_NS + 1)
        if due > MOST_TICKS:
            msg = f"{due * PERIOD_S:g} s lie between samples: another clock?"
            raise ValueError(msg)
        ticks = np.zeros(due, TICK)
        if due == 0:
            return ticks
        ticks["t_ns"] = self._next_ns + PERIOD_NS * np.arange(due, dtype=np.int64)
        make_ticks(
            ticks,
            self._latency_ns,
            self._imu_ns,
            self._imu,
            self._tacho_ns,
            self._even_ns,
            self._way_m,
            self._doubt_m,
            self._quantum_m,
            self._inertial,
        )
        self._next_ns += due * PERIOD_NS
        self._forget(int(ticks["t_ns"][-1]))
        return ticks

    def _take(self, imu_t_s: Floats, imu: SixAxes, tacho_t_s: Floats, pulses: Counts) -> None:
        if len(imu_t_s):
            self._imu_ns = np.concatenate([self._imu_ns, _ns(imu_t_s)])
            self._imu = np.concatenate([self._imu, imu])
        if len(tacho_t_s):
            new_ns = _ns(tacho_t_s)
            way_m, doubt_m = np.empty(len(new_ns)), np.empty(len(new_ns))
            count_way(new_ns, np.array(pulses, np.int64), self._pulse_m, self._counter, way_m, doubt_m)
            quantum_m = np.empty(len(new_ns))
            _quanta(way_m, self._pulse_m, self._steps, quantum_m)
            even_ns = np.empty(len(new_ns), np.int64)
            even_times(new_ns, way_m, self._grid, even_ns)
            self._tacho_ns = np.concatenate([self._tacho_ns, new_ns])
            self._even_ns = np.concatenate([self._even_ns, even_ns])
            self._way_m = np.concatenate([self._way_m, way_m])
            self._doubt_m = np.concatenate([self._doubt_m, doubt_m])
            self._quantum_m = np.concatenate([self._quantum_m, quantum_m])

    def _forget(self, now_ns: int) -> None:
        kept = int(np.searchsorted(self._imu_ns, now_ns, side="right"))
        self._imu_ns, self._imu = self._imu_ns[kept:], self._imu[kept:]
        kept = max(0, min(int(np.searchsorted(self._tacho_ns, now_ns - KEPT_NS)), len(self._tacho_ns) - 2))
        self._tacho_ns, self._even_ns = self._tacho_ns[kept:], self._even_ns[kept:]
        self._way_m, self._doubt_m = self._way_m[kept:], self._doubt_m[kept:]
        self._quantum_m = self._quantum_m[kept:]


def _ns(t_s: Floats) -> Counts:
    return np.rint(t_s * 1e9).astype(np.int64)
