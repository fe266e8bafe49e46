"""How far the front end can have moved between two instants: odometry, its documented error, gaps, shifts.

Three sums run along: the least, the greatest and the likeliest displacement of the front end along
`axis_m`. A place known at one instant becomes an interval at another by the differences of these sums,
in either order of time; so a measurement that arrives late is taken at its own time. With `s` the sense
of the vehicle on the line and ε in [ε₁, ε₂] the wheel's relative error, a step of the odometry gives

    greatest += max(s Δd (1 + ε₁), s Δd (1 + ε₂)) + (Δway - |Δd|) max|ε| + Δexcess

and the least the mirror image. What an unfinished slip adds for now (`provisional_m`) is no sum: it is
added at both instants (schemas.motion.Odometry).
"""

from __future__ import annotations

import bisect
from typing import Final

from schemas.motion import Odometry
from services.train_position.instants import Instant, Physics, Scale, Sense, tube

HISTORY: Final = 6000
"""Instants that are kept: ten minutes of 10 Hz."""
STEP_NOISE_M: Final = 0.01
"""Standard deviation that one step of the odometry adds to the estimate: pulses, timing."""
CREEP: Final = 1e-3
"""Variance per metre [m]: under effort micro-slip of some per mille lasts for hundreds of metres, 1 m per kilometre."""
BOUND_SIGMAS: Final = 3.0
"""A bound on what slips add is taken for so many standard deviations in the estimate."""
SLACK_M: Final = 5.0
"""What a step of the odometry may be beyond every physical limit before it is refused."""


class Reach:
    """The sums, with their history."""

    def __init__(self, physics: Physics, sense: Sense = 0) -> None:
        """Nothing heard yet."""
        self.sense: Sense = sense
        self._physics: Final = physics
        self._instants: list[Instant] = []
        self._times: list[int] = []
        self._turned_ns: int | None = None
        """Time of the newest instant that no plain step led to: a gap, a shift, a new beginning."""
        self.share = 0.0
        """Largest relative error that the odometry has vouched for since the newest reference."""

    @property
    def now(self) -> Instant | None:
        """Newest instant."""
        return self._instants[-1] if self._instants else None

    def begin(self, instant: Instant, share: float) -> None:
        """Go on from an instant kept before a restart, or after the calendar was set; the history is gone."""
        self._instants, self._times = [instant], [instant.t_ns]
        self._turned_ns = instant.t_ns
        self.share = share

    def at(self, t_ns: int) -> Instant | None:
        """Instant at a time, interpolated; None before the history and after now."""
        i = bisect.bisect_left(self._times, t_ns)
        if i == len(self._times):
            return None
        after = self._instants[i]
        if after.t_ns == t_ns:
            return after
        if i == 0:
            return None
        before = self._instants[i - 1]
        share = (t_ns - before.t_ns) / (after.t_ns - before.t_ns)
        values = [one + share * (other - one) for one, other in zip(before[1:], after[1:], strict=True)]
        between = Instant(t_ns, *values)
        # When within the step its error arose is not known; and at most this far off the chord can the train be.
        arose_m = share * (after.greatest_m - after.least_m - before.greatest_m + before.least_m)
        off_chord_m = self._physics.acceleration_mps2 * (t_ns - before.t_ns) * (after.t_ns - t_ns) / 2e18
        worst_m = max(before.provisional_m, after.provisional_m) + arose_m + off_chord_m
        return between._replace(
            provisional_m=worst_m, speed_bound_mps=max(before.speed_bound_mps, after.speed_bound_mps)
        )

    def refusal(self, odometry: Odometry) -> str:
        """Why a step of the same origin cannot be; empty when it can."""
        now = self.now
        if now is None:
            return ""
        if odometry.t_ns <= now.t_ns:
            return f"odometry of {(now.t_ns - odometry.t_ns) / 1e9:.1f} s ago"
        if odometry.way_m < now.way_m - 1e-6 or odometry.excess_m < now.excess_m - 1e-6:
            return "the way gone, or what slips have added to its error, has fallen"
        dt_s = (odometry.t_ns - now.t_ns) / 1e9
        allowed_m = self._physics.speed_mps * dt_s + odometry.excess_m - now.excess_m + SLACK_M
        allowed_m += odometry.provisional_m + now.provisional_m
        if abs(odometry.distance_m - now.distance_m) > allowed_m:
            return f"{odometry.distance_m - now.distance_m:.0f} m within {dt_s:.1f} s"
        return ""

    def step(self, odometry: Odometry, scale: Scale, since_m: float) -> None:
        """Go one message of the same origin on; `since_m` is the way that the newest reference is behind."""
        now = self._instants[-1]
        moved_m = odometry.distance_m - now.distance_m
        way_m = max(odometry.way_m - now.way_m, abs(moved_m))
        excess_m = max(odometry.excess_m - now.excess_m, 0.0)
        # A share that rises holds for the way behind as well: it is said of any two instants.
        excess_sum_m = excess_m + max(odometry.share_bound - self.share, 0.0) * since_m
        self.share = max(self.share, odometry.share_bound)
        rolled_m, least_m, greatest_m = self._rolled(moved_m, way_m, excess_sum_m, scale)
        variance_m2 = (excess_m / BOUND_SIGMAS) ** 2 + CREEP * way_m + (STEP_NOISE_M**2 if moved_m else 0.0)
        self._add(
            Instant(
                odometry.t_ns,
                odometry.distance_m,
                odometry.way_m,
                now.greatest_m + greatest_m,
                now.least_m + least_m,
                now.likeliest_m + rolled_m,
                now.rolled_m + rolled_m,
                now.variance_m2 + variance_m2,
                odometry.excess_m,
                odometry.provisional_m,
                odometry.speed_mps,
                odometry.speed_bound_mps,
            )
        )

    def _rolled(self, moved_m: float, way_m: float, excess_m: float, scale: Scale) -> tuple[float, float, float]:
        """Likeliest, least and greatest displacement of a step."""
        if self.sense == 0:
            span_m = way_m * (1.0 + scale.largest) + excess_m
            return 0.0, -span_m, span_m
        rolled_m = self.sense * moved_m
        ends_m = (rolled_m * (1.0 + scale.least), rolled_m * (1.0 + scale.greatest))
        rest_m = (way_m - abs(moved_m)) * scale.largest + excess_m
        return rolled_m, min(ends_m) - rest_m, max(ends_m) + rest_m

    @property
    def plain_since_ns(self) -> int:
        """Time from which on plain steps of one origin have followed one another."""
        first_ns = self._times[0] if self._times else 0
        return first_ns if self._turned_ns is None else max(self._turned_ns, first_ns)

    def orient(self, sense: Sense, scale: Scale) -> None:
        """Learn the sense, and make the sums since `plain_since_ns` what they had been had it been known.

        Claims of that time must be taken anew.
        """
        self.sense = sense
        start = bisect.bisect_left(self._times, self.plain_since_ns)
        for i in range(start + 1, len(self._instants)):
            before, now = self._instants[i - 1], self._instants[i]
            moved_m, excess_m = now.distance_m - before.distance_m, now.excess_m - before.excess_m
            way_m = max(now.way_m - before.way_m, abs(moved_m))
            rolled_m, least_m, greatest_m = self._rolled(moved_m, way_m, excess_m, scale)
            self._instants[i] = now._replace(
                greatest_m=before.greatest_m + greatest_m,
                least_m=before.least_m + least_m,
                likeliest_m=before.likeliest_m + rolled_m,
                rolled_m=before.rolled_m + rolled_m,
            )

    def first(self, odometry: Odometry) -> None:
        """Begin with a message."""
        self.begin(_of(odometry, 0.0, 0.0, 0.0, 0.0, 0.0), odometry.share_bound)

    def gap(self, odometry: Odometry) -> None:
        """Go on under another origin: between the two, the train can have gone what physics allows.

        From speed v₀ to v₁ within T at no more than a: (v₀ + v₁) T / 2 ± (a T² / 4 - (v₁ - v₀)² / (4 a)).
        """
        now = self._instants[-1]
        dt_s = (odometry.t_ns - now.t_ns) / 1e9
        mean_m = (now.speed_mps + odometry.speed_mps) / 2.0 * dt_s
        most = self._physics.acceleration_mps2
        change_mps = abs(odometry.speed_mps - now.speed_mps)
        reach_m = most * dt_s**2 / 4.0 - change_mps**2 / (4.0 * most)
        doubt_m = max(reach_m, 0.0) + (now.speed_bound_mps + odometry.speed_bound_mps) * dt_s
        doubt_m += change_mps * dt_s / 2.0 if reach_m < 0.0 else 0.0
        limit_m = self._physics.speed_mps * dt_s
        self.share = max(self.share, odometry.share_bound)
        self._jump(odometry, mean_m, doubt_m, limit_m)

    def blind(self, t_ns: int, onward: Sense = 0) -> None:
        """Go on without odometry: speed by now is what it was, and what physics lets it become.

        `onward`: the way that the wheels turn: however they slip, the train does not move against them.
        """
        self._turned_ns = t_ns
        self._add(self.ahead(t_ns, onward))

    def ahead(self, t_ns: int, onward: Sense = 0) -> Instant:
        """The instant that physics alone leads to from the newest one."""
        now = _settled(self._instants[-1])
        dt_s = (t_ns - now.t_ns) / 1e9
        most = self._physics.acceleration_mps2
        limit = self._physics.speed_mps
        mean_m = now.speed_mps * dt_s
        doubt_m = now.speed_bound_mps * dt_s + most * dt_s**2 / 2.0
        bound_mps = min(now.speed_bound_mps + most * dt_s, limit + abs(now.speed_mps))
        following = now._replace(t_ns=t_ns, speed_bound_mps=bound_mps)
        moved = self._moved(following, now, mean_m, doubt_m, limit * dt_s)
        if self.sense * onward > 0:
            return moved._replace(least_m=max(moved.least_m, now.least_m))
        if self.sense * onward < 0:
            return moved._replace(greatest_m=min(moved.greatest_m, now.greatest_m))
        return moved

    def doubt_speed(self, speed_mps: float, bound_mps: float) -> None:
        """Hold another speed at the newest instant, before `blind` goes on from it."""
        limit = self._physics.speed_mps
        self._instants[-1] = self._instants[-1]._replace(
            speed_mps=speed_mps, speed_bound_mps=min(bound_mps, limit + abs(speed_mps))
        )

    def widen(self, sure: Instant) -> None:
        """Let the newest instant be wherever physics allows since an earlier one, beside where the odometry has it."""
        now = self._instants.pop()
        self._times.pop()
        self._turned_ns = now.t_ns
        if now.t_ns - 1 not in self._times[-1:]:
            self._add(now._replace(t_ns=now.t_ns - 1))
        least_m, greatest_m = tube(sure, now.t_ns, self._physics, self.sense)
        widened = now._replace(
            least_m=min(now.least_m, sure.least_m + least_m),
            greatest_m=max(now.greatest_m, sure.greatest_m + greatest_m),
        )
        doubt_m = max(widened.greatest_m - now.greatest_m, now.least_m - widened.least_m)
        self._add(_settled(widened._replace(variance_m2=now.variance_m2 + (doubt_m / BOUND_SIGMAS) ** 2)))

    def shift(self, least_m: float, greatest_m: float) -> None:
        """Move the front end along the train, by something between these (towards rising `axis_m`)."""
        now = self._instants.pop()
        self._times.pop()
        self._turned_ns = now.t_ns
        if now.t_ns - 1 not in self._times[-1:]:
            self._add(now._replace(t_ns=now.t_ns - 1))
        middle_m = (least_m + greatest_m) / 2.0
        self._add(
            now._replace(
                greatest_m=now.greatest_m + greatest_m,
                least_m=now.least_m + least_m,
                likeliest_m=now.likeliest_m + middle_m,
                variance_m2=now.variance_m2 + ((greatest_m - least_m) / (2.0 * BOUND_SIGMAS)) ** 2,
            )
        )

    def _jump(self, odometry: Odometry, mean_m: float, doubt_m: float, limit_m: float) -> None:
        now = _settled(self._instants[-1])
        self._turned_ns = odometry.t_ns
        following = _of(odometry, now.greatest_m, now.least_m, now.likeliest_m, now.rolled_m, now.variance_m2)
        self._add(self._moved(following, now, mean_m, doubt_m, limit_m))

    def _moved(self, following: Instant, now: Instant, mean_m: float, doubt_m: float, limit_m: float) -> Instant:
        """An instant after a move of `mean_m` ± `doubt_m` along the vehicle, of `limit_m` at most."""
        ends_m = (self.sense * mean_m - doubt_m, self.sense * mean_m + doubt_m)
        if self.sense == 0:
            ends_m = (-abs(mean_m) - doubt_m, abs(mean_m) + doubt_m)
        least_m, greatest_m = max(ends_m[0], -limit_m), min(ends_m[1], limit_m)
        return following._replace(
            greatest_m=now.greatest_m + greatest_m,
            least_m=now.least_m + least_m,
            likeliest_m=now.likeliest_m + self.sense * mean_m,
            variance_m2=now.variance_m2 + (doubt_m / BOUND_SIGMAS) ** 2,
        )

    def _add(self, instant: Instant) -> None:
        self._instants.append(instant)
        self._times.append(instant.t_ns)
        if len(self._times) > 2 * HISTORY:
            del self._instants[:HISTORY], self._times[:HISTORY]


def _settled(now: Instant) -> Instant:
    """An instant whose provisional part has gone into the sums: no message of its slip will take it back.

    Places known before are as wide as ever, and what is claimed from here on owes nothing to that slip.
    """
    return now._replace(
        least_m=now.least_m - now.provisional_m,
        greatest_m=now.greatest_m + now.provisional_m,
        variance_m2=now.variance_m2 + (now.provisional_m / BOUND_SIGMAS) ** 2,
        provisional_m=0.0,
    )


def _of(
    odometry: Odometry, greatest_m: float, least_m: float, likeliest_m: float, rolled_m: float, variance_m2: float
) -> Instant:
    """Instant of a message with these sums."""
    return Instant(
        odometry.t_ns,
        odometry.distance_m,
        odometry.way_m,
        greatest_m,
        least_m,
        likeliest_m,
        rolled_m,
        variance_m2,
        odometry.excess_m,
        odometry.provisional_m,
        odometry.speed_mps,
        odometry.speed_bound_mps,
    )
