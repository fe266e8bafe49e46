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

from services.odometry_fusion.first_rest import FASTEST_MPS, TURNING_MPS, Shaking, limits_of
from services.odometry_fusion.motion_log import DEGRADED, LOST, Counts, Floats, MotionRows, SixAxes
from services.odometry_fusion.motion_track import SPEED_TICKS, TICK_S, MotionTrack

UNSEEN: Final = "begun under way: the wheel has not been seen to adhere yet, it may slip since before"
CALM_S: Final = 20.0
"""A wheel that has agreed with the inertial sensor for so long adheres: slips are over by then."""
UNSEEN_M: Final = 20.0
"""What a slip that fades too slowly to be seen may have cost by then."""
QUIET_TICKS: Final = 20
"""The train stands once the sensor has been quiet for so long over a wheel that stands."""


class FirstMotion:
    """Watches one axle from the first count on, until it has been seen to adhere."""

    def __init__(self, latency_s: float, rest: Shaking | None = None) -> None:
        """`latency_s`: by which the inertial sensor's stamps are late. `rest`: what it shows at rest, where known."""
        self.settled_ns: int | None = None
        """From when on the wheel is vouched for."""
        self.over = False
        """Wheel and inertial sensor have parted, or the train has come to rest: odometry is to begin anew."""
        self._track = MotionTrack(latency_s)
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
        self.over = self._quiet_ticks >= QUIET_TICKS or (turns and track.parts(at))
        if self._calm_ticks * TICK_S >= CALM_S and turns:
            self.settled_ns = track.end_ns(at)
