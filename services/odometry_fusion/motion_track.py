"""Speeds of a wheel's rim and of what the inertial sensor feels, beside each other, and where they part.

Force along x is acceleration, gravity's share by the gradient, and a bias; the gyro shows how the gradient changes. So
the rim is ahead of the inertial sensor by what grows evenly with time as long as the wheel adheres, or slips evenly.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from services.odometry_fusion.first_rest import LEAST_SAMPLES, WINDOW_S, Shaking, shaking_of
from services.odometry_fusion.motion_log import Counts, Floats, SixAxes

TICK_NS: Final = 100_000_000
TICK_S: Final = TICK_NS / 1e9
SPEED_TICKS: Final = 5
"""Speeds are means over half a second."""
APART_TICKS: Final = 20
APART_MPS: Final = 0.6
"""Wheel and inertial sensor part where they gain speeds that differ by so much more over two seconds than over the
two before: pulses, creep under effort and changes of gradient that the gyro does not see stay below."""
WILD_MPS2: Final = 2.0
"""No train changes its speed so fast, whatever the inertial sensor says."""
PULSES_MPS: Final = 0.4
"""Pulses in a speed over half a second, and stamps that jitter."""
SILENT_NS: Final = 1_500_000_000
"""A sensor is not waited for any longer."""
GRAVITY_MPS2: Final = 9.80665
UNKNOWN: Final = Shaking(np.inf, np.inf)


class MotionTrack:
    """Speeds of rim and inertial sensor at the ends of ticks, as far as both are known."""

    def __init__(self, latency_s: float) -> None:
        """`latency_s`: by which the inertial sensor's stamps are late."""
        self.begun_ns: int | None = None
        self._latency_ns = round(latency_s * 1e9)
        self._way_ns: Counts = np.empty(0, np.int64)
        self._way_m: Floats = np.empty(0)
        self._imu_ns: Counts = np.empty(0, np.int64)
        self._imu: SixAxes = np.empty((0, 6))
        self._rim_m: list[float] = []
        """Way of the rim at the ends of ticks."""
        self._felt_mps: list[float] = []
        """Speed that the inertial sensor has gained by then, but for a share that grows evenly: NaN without it."""
        self.shaking: list[Shaking] = []
        """What the inertial sensor has shown in the second before the ends of ticks."""
        self._window: deque[SixAxes] = deque(maxlen=round(WINDOW_S / TICK_S))
        self._pitch_rad = 0.0
        self._gained_mps = 0.0

    @property
    def ticks(self) -> int:
        """Ticks that are complete."""
        return len(self._rim_m)

    def end_ns(self, at: int) -> int:
        """End of a tick, as the inertial sensor stamps it: the first count shows in it that much later."""
        return (self.begun_ns or 0) + self._latency_ns + (at + 1) * TICK_NS

    def take(self, imu_ns: Counts, imu: SixAxes, way_ns: Counts, way_m: Floats) -> None:
        """Samples in the order of time, shapes (n,), (n, 6), (m,), (m,): finite ones."""
        if self.begun_ns is None and len(way_ns):
            self.begun_ns = int(way_ns[0])
        self._imu_ns, self._imu = np.concatenate([self._imu_ns, imu_ns]), np.concatenate([self._imu, imu])
        self._way_ns, self._way_m = np.concatenate([self._way_ns, way_ns]), np.concatenate([self._way_m, way_m])
        while self._complete():
            self._tick()
        self._forget()

    def rim_mps(self, at: int) -> float:
        """Rim's speed over the SPEED_TICKS before a tick's end."""
        return (self._rim_m[at] - self._rim_m[at - SPEED_TICKS]) / (SPEED_TICKS * TICK_S)

    def parts(self, at: int) -> bool:
        """Whether rim and inertial sensor have parted in the latest ticks before one's end."""
        if at > SPEED_TICKS and abs(self.rim_mps(at) - self.rim_mps(at - 1)) > WILD_MPS2 * TICK_S + PULSES_MPS:
            return True
        if at < SPEED_TICKS + 2 * APART_TICKS:
            return False
        now_mps, before_mps, first_mps = (self.ahead_mps(at - k * APART_TICKS) for k in range(3))
        # Without the inertial sensor in between this is NaN, and nothing parts.
        return abs(now_mps - 2.0 * before_mps + first_mps) > APART_MPS

    def ahead_mps(self, at: int) -> float:
        """By how much the rim is ahead of what the inertial sensor feels, but for a share that grows evenly."""
        return self.rim_mps(at) - float(np.mean(self._felt_mps[at - SPEED_TICKS + 1 : at + 1]))

    def _complete(self) -> bool:
        if self.begun_ns is None:
            return False
        counted_ns = int(self._way_ns[-1]) if len(self._way_ns) else 0
        felt_ns = int(self._imu_ns[-1]) if len(self._imu_ns) else 0
        waited_ns = max(counted_ns, felt_ns) - SILENT_NS
        end_ns = self.end_ns(self.ticks)
        return max(counted_ns, waited_ns) >= end_ns - self._latency_ns and max(felt_ns, waited_ns) >= end_ns

    def _tick(self) -> None:
        end_ns = self.end_ns(self.ticks)
        within = slice(*np.searchsorted(self._imu_ns, [end_ns - TICK_NS, end_ns], side="right").tolist())
        imu = self._imu[within]
        begun_ns = self.begun_ns or 0
        way_m = np.interp(end_ns - self._latency_ns - begun_ns, self._way_ns - begun_ns, self._way_m)
        self._rim_m.append(float(way_m))
        self._window.append(imu)
        if not len(imu):
            self._felt_mps.append(np.nan)
            self.shaking.append(UNKNOWN)
            return
        # Nose up is -gy (docs/odometry_fusion.md), and the specific force along x holds gravity's share.
        self._pitch_rad -= float(np.mean(imu[:, 4])) * TICK_S
        self._gained_mps += (float(np.mean(imu[:, 0])) - GRAVITY_MPS2 * self._pitch_rad) * TICK_S
        self._felt_mps.append(self._gained_mps)
        shaken = np.concatenate(self._window)
        self.shaking.append(shaking_of(shaken) if len(shaken) >= LEAST_SAMPLES else UNKNOWN)

    def _forget(self) -> None:
        """Samples before the newest tick's end; a count before it is needed still."""
        if not self.ticks:
            return
        end_ns = self.end_ns(self.ticks - 1)
        counts = max(int(np.searchsorted(self._way_ns, end_ns - self._latency_ns, side="right")) - 1, 0)
        felt = int(np.searchsorted(self._imu_ns, end_ns, side="right"))
        self._way_ns, self._way_m = self._way_ns[counts:], self._way_m[counts:]
        self._imu_ns, self._imu = self._imu_ns[felt:], self._imu[felt:]
