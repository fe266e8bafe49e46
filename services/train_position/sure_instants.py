"""Instants at which the odometry could be relied on, and what it says later held against them by physics.

A train's speed changes by no more than it can start and brake, so that an instant that was sure bounds speed and way
of those that follow, whatever the odometry makes of its sensors. A speed or way beyond that means that the wheels,
the inertial sensor or their times are not what the odometry takes them for.
"""

from __future__ import annotations

from typing import Final

from services.train_position.instants import Instant, Physics, Sense, tube

APART_S: Final = 0.5
SETTLED_S: Final = 3.0
"""An instant is sure when no slip has been seen for so long after it: slips are under way for up to two before."""
MOST: Final = 4
SLACK_MPS: Final = 0.3
SLACK_M: Final = 2.0
"""Pulses, and times that jitter by some ten milliseconds."""


class SureInstants:
    """The newest of them."""

    def __init__(self, physics: Physics) -> None:
        """None yet."""
        self._physics = physics
        self._kept: list[Instant] = []
        self._waiting: list[Instant] = []
        self.newest: Instant | None = None

    @property
    def oldest(self) -> Instant | None:
        """From before whatever has begun meanwhile."""
        return (*self._kept, *self._waiting, self.newest)[0]

    def take(self, now: Instant) -> None:
        """Another one without slip."""
        self.newest = now
        if not self._waiting or now.t_ns - self._waiting[-1].t_ns >= APART_S * 1e9:
            self._waiting.append(now)
        while self._waiting and now.t_ns - self._waiting[0].t_ns >= SETTLED_S * 1e9:
            self._kept.append(self._waiting.pop(0))
            del self._kept[:-MOST]

    def slip(self) -> None:
        """A slip is seen: it may have been under way for a while."""
        self._waiting.clear()

    def begin(self, instant: Instant | None) -> None:
        """Rely on this one alone, or on none: the sums count otherwise now, or the odometry is not believed."""
        self._kept = [] if instant is None else [instant]
        self._waiting = []
        self.newest = instant

    def against(self, now: Instant, sense: Sense) -> str:
        """Why an instant cannot follow those that were sure; empty when it can."""
        return next((text for text in (self._contradiction(one, now, sense) for one in self._kept) if text), "")

    def _contradiction(self, sure: Instant, now: Instant, sense: Sense) -> str:
        dt_s = (now.t_ns - sure.t_ns) / 1e9
        most_mps = sure.speed_bound_mps + now.speed_bound_mps + self._physics.acceleration_mps2 * dt_s + SLACK_MPS
        if abs(now.speed_mps - sure.speed_mps) > most_mps:
            return f"from {sure.speed_mps:.1f} to {now.speed_mps:.1f} m/s within {dt_s:.1f} s"
        least_m, greatest_m = tube(sure, now.t_ns, self._physics, sense)
        doubt_m = sure.provisional_m + now.provisional_m + SLACK_M
        too_far = now.least_m - sure.least_m - doubt_m > greatest_m
        too_short = now.greatest_m - sure.greatest_m + doubt_m < least_m
        if too_far or too_short:
            gone_m = now.likeliest_m - sure.likeliest_m
            return f"{gone_m:.0f} m within {dt_s:.1f} s at {sure.speed_mps:.1f} m/s"
        return ""
