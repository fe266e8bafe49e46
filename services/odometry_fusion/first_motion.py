"""Whether a wheel that turns when odometry begins adheres: it may slide or spin already, and nothing of before says no.

While slip does not change, wheel and inertial sensor agree as they do without any; once the wheel returns, its speed
changes and that of the train does not. So a wheel that turns from the first count on is vouched for once it has
agreed with the inertial sensor for longer than slips last. Until then the train may go as fast as any, or stand. Where
they part a slip has begun or ended: odometry begins anew then, with what the wheel shows from there on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from services.odometry_fusion.first_rest import FASTEST_MPS, TURNING_MPS, Shaking, limits_of, shaking_of
from services.odometry_fusion.motion_log import DEGRADED, LOST, Counts, Floats, MotionRows, SixAxes

UNSEEN: Final = "begun under way: the wheel has not been seen to adhere yet, it may slip since before"
TICK_NS: Final = 100_000_000
TICK_S: Final = TICK_NS / 1e9
CALM_S: Final = 20.0
"""A wheel that has agreed with the inertial sensor for so long adheres: slips are over by then."""
UNSEEN_M: Final = 20.0
"""What a slip that fades too slowly to be seen may have cost by then."""
SPEED_TICKS: Final = 5
"""Speeds are means over half a second."""
APART_TICKS: Final = 20
APART_MPS: Final = 0.6
"""Wheel and inertial sensor part where they gain speeds that differ by so much more over two seconds than over the
two before: pulses, creep under effort and changes of gradient that the gyro does not see stay below."""
WILD_MPS2: Final = 2.0
"""Without an inertial sensor: no train changes its speed so fast."""
SILENT_NS: Final = 1_500_000_000
"""A sensor is not waited for any longer."""
PULSES_MPS: Final = 0.4
"""Pulses in a speed over half a second, and stamps that jitter."""
QUIET_TICKS: Final = 20
"""The train stands once the sensor has been quiet for so long over a wheel that stands."""
GRAVITY_MPS2: Final = 9.80665


class FirstMotion:
    """Watches one axle from the first count on, until it has been seen to adhere."""

    def __init__(self, latency_s: float, rest: Shaking | None = None) -> None:
        """`latency_s`: by which the inertial sensor's stamps are late. `rest`: what it shows at rest, where known."""
        self.settled_ns: int | None = None
        """From when on the wheel is vouched for."""
        self.over = False
        """Wheel and inertial sensor have parted, or the train has come to rest: odometry is to begin anew."""
        self._track = _Track(round(latency_s * 1e9))
        self._limits = limits_of(rest)
        self._calm_ticks = 0
        self._quiet_ticks = 0
        self._slipping = False

    def note(self, rows: MotionRows) -> None:
        """What the method made of the samples that follow: a slip that it sees may be the end of another."""
        if self.settled_ns is not None or not len(rows):
            return
        slips = rows.slip != 0
        if slips.any():
            self._calm_ticks = 0
        self.over = self.over or bool((self._slipping or slips.any()) and not slips[-1])
        self._slipping = bool(slips[-1])

    def take(self, imu_ns: Counts, imu: SixAxes, way_ns: Counts, way_m: Floats) -> None:
        """Samples of both sensors in the order of time, shapes (n,), (n, 6), (m,), (m,): finite ones."""
        if self.settled_ns is not None or self.over:
            return
        first = self._track.ticks
        self._track.take(imu_ns, imu, way_ns, way_m)
        for at in range(first, self._track.ticks):
            self._judge(at)

    def vouched(self, rows: MotionRows, base_ns: int) -> MotionRows:
        """The rows with what a slip of before may cost; `base_ns` is the time of their zero."""
        t_ns = base_ns + np.rint(rows.t_s * 1e9).astype(np.int64)
        open_ = t_ns < self.settled_ns if self.settled_ns is not None else np.ones(len(rows), np.bool_)
        begun_ns = base_ns if self._track.begun_ns is None else self._track.begun_ns
        provisional_m = np.where(open_, FASTEST_MPS * np.maximum(t_ns - begun_ns, 0) / 1e9, 0.0)
        excess_m = np.where(open_, 0.0, UNSEEN_M)
        unknown = np.where(open_, np.nan, 0.0)
        return replace(
            rows,
            bound_m=rows.bound_m + provisional_m + excess_m,
            excess_m=rows.excess_m + excess_m,
            provisional_m=rows.provisional_m + provisional_m,
            speed_bound_mps=np.where(open_, FASTEST_MPS, rows.speed_bound_mps),
            standstill=rows.standstill & ~open_,
            status=np.where(open_ & (rows.status != LOST), DEGRADED, rows.status).astype(np.int8),
            reason=np.where(open_, len(rows.reasons), rows.reason).astype(np.int16),
            reasons=(*rows.reasons, UNSEEN),
            curvature_per_m=rows.curvature_per_m + unknown,
            curvature_sigma_per_m=rows.curvature_sigma_per_m + unknown,
            curvature_distance_m=rows.curvature_distance_m + unknown,
        )

    def _judge(self, at: int) -> None:
        """One tick more."""
        if self.settled_ns is not None or self.over or at < SPEED_TICKS:
            return
        track = self._track
        turns = abs(track.rim_mps(at)) > TURNING_MPS
        quiet = not turns and track.shaking[at].within(self._limits)
        self._quiet_ticks = self._quiet_ticks + 1 if quiet else 0
        # A wheel that stands tells nothing: it may have locked meanwhile.
        self._calm_ticks += 1 if turns else 0
        self.over = self._quiet_ticks >= QUIET_TICKS or (turns and self._parts(at))
        if self._calm_ticks * TICK_S >= CALM_S and turns:
            self.settled_ns = track.end_ns(at)

    def _parts(self, at: int) -> bool:
        """Whether wheel and inertial sensor have parted within the newest ticks."""
        track = self._track
        gained_mps = track.rim_mps(at) - track.rim_mps(at - 1) if at > SPEED_TICKS else 0.0
        if abs(gained_mps) > WILD_MPS2 * TICK_S + PULSES_MPS:
            return True
        if at < SPEED_TICKS + 2 * APART_TICKS:
            return False
        now_mps, before_mps, first_mps = (track.ahead_mps(at - k * APART_TICKS) for k in range(3))
        # Without the inertial sensor in between this is NaN, and nothing parts.
        return abs(now_mps - 2.0 * before_mps + first_mps) > APART_MPS


class _Track:
    """Speeds of rim and inertial sensor at the ends of ticks, as far as both are known."""

    def __init__(self, latency_ns: int) -> None:
        self.begun_ns: int | None = None
        self._latency_ns = latency_ns
        self._way_ns: Counts = np.empty(0, np.int64)
        self._way_m: Floats = np.empty(0)
        self._imu_ns: Counts = np.empty(0, np.int64)
        self._imu: SixAxes = np.empty((0, 6))
        self._rim_m: list[float] = []
        """Way of the rim at the ends of ticks."""
        self._felt_mps: list[float] = []
        """Speed that the inertial sensor has gained by then, but for a share that grows evenly: NaN without it."""
        self.shaking: list[Shaking] = []
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
        """New samples."""
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
        if not len(imu):
            self._felt_mps.append(np.nan)
            self.shaking.append(Shaking(np.inf, np.inf))
            return
        # Nose up is -gy (docs/odometry_fusion.md), and the specific force along x holds gravity's share.
        self._pitch_rad -= float(np.mean(imu[:, 4])) * TICK_S
        self._gained_mps += (float(np.mean(imu[:, 0])) - GRAVITY_MPS2 * self._pitch_rad) * TICK_S
        self._felt_mps.append(self._gained_mps)
        self.shaking.append(shaking_of(imu))

    def _forget(self) -> None:
        """Samples before the newest tick's end; a count before it is needed still."""
        if not self.ticks:
            return
        end_ns = self.end_ns(self.ticks - 1)
        counts = max(int(np.searchsorted(self._way_ns, end_ns - self._latency_ns, side="right")) - 1, 0)
        felt = int(np.searchsorted(self._imu_ns, end_ns, side="right"))
        self._way_ns, self._way_m = self._way_ns[counts:], self._way_m[counts:]
        self._imu_ns, self._imu = self._imu_ns[felt:], self._imu[felt:]
