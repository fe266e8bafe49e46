"""Whether a wheel that stands when odometry begins stands because the train does: it may be locked, and sliding.

At rest an inertial sensor is quiet; under way track and car shake it. So a wheel that stands from the first count on
is taken for a train at rest once the sensor has been quiet. Until then the train may go as fast as any, which goes
into the error that is vouched for. A departure in which wheel and inertial sensor gain the same speed settles it, too.
"""

from __future__ import annotations

from enum import Enum
from typing import Final, NamedTuple

import numpy as np

from services.odometry_fusion.motion_log import Counts, Floats, SixAxes

FASTEST_MPS: Final = 100.0
"""No train is faster: what is vouched for while nothing excludes that the wheel is locked."""
SLOW_MPS: Final = 10.0
"""And a train that is shaken by no more than ROUGHLY_QUIET is not faster than this."""
UNVOUCHED: Final = "the wheel stands since odometry began, and the inertial sensor shows no rest: it may be locked"
WINDOW_S: Final = 1.0
LEAST_SAMPLES: Final = 8
SILENT_S: Final = 1.5
"""Without an inertial sensor for so long it is not waited for."""
ROUGHLY_QUIET: Final = (0.2, 2.2e-3)
"""Standard deviations over a window of the specific force [m/s²] and of the angular rates [rad/s], three axes together:
cheap sensors show as much at rest. Rails shake a car's turning by more from about 5 m/s on."""
QUIET: Final = (0.03, 2.2e-3)
"""What a sensor of which nothing is known may show at rest: 2 m/s shake a car by more."""
LEAST_QUIET: Final = (0.03, 1.3e-3)
LEARNED: Final = (1.5, 1.25)
"""Where it is known what sensor and vehicle show at rest, so many times that, and LEAST_QUIET at least: 1 to 2 m/s are
seen then."""
QUIET_AGAIN: Final = 2
"""Windows in a row that end a doubt."""
SHAKEN_AGAIN: Final = 3
"""Windows in a row after which a train that stood, and whose wheel has not turned since, may be pulled along: people
who get on shake it for less."""
UNFELT_NS: Final = 13_000_000_000
"""So long before their end it was at rest: a train that departs is felt after ten seconds."""
TURNING_MPS: Final = 0.5
"""A slower wheel stands, or is all but locked."""
SPEED_S: Final = 0.5
GONE_MPS: Final = 1.5
LONGEST_DEPARTURE_S: Final = 20.0
AGREE_MPS: Final = 0.5
AGREE_SHARE: Final = 0.15
"""A departure: wheel and inertial sensor have gained the same speed to within these, GONE_MPS at least."""
KEPT_S: Final = 2.0
LONGEST_STEP_S: Final = 0.2
FOLLOWING: Final = 1.05
"""By how much what is learned rises or falls with a window: a running median."""


class Rest(Enum):
    """What is known of the beginning."""

    WAITING = "waiting"
    """Samples are too few: no rows yet."""
    SURE = "sure"
    """At rest, or the wheel turns; the method sees to everything else."""
    UNSURE = "unsure"
    """The wheel stands, and nothing shows that the train does."""
    OVER = "over"
    """It was unsure and has stopped being so: odometry is to begin anew."""


class Shaking(NamedTuple):
    """Standard deviations over a window, three axes together."""

    force_mps2: float
    rate_radps: float

    def within(self, limits: Shaking) -> bool:
        """Whether neither is more."""
        return self.force_mps2 <= limits.force_mps2 and self.rate_radps <= limits.rate_radps


def shaking_of(imu: SixAxes) -> Shaking:
    """What samples of one window show."""
    variances = np.var(imu, axis=0)
    return Shaking(float(np.sqrt(np.sum(variances[:3]))), float(np.sqrt(np.sum(variances[3:]))))


def stated_rest(force_mps2: float | None, rate_radps: float | None) -> Shaking | None:
    """What somebody says of it; None where a half is missing."""
    return None if force_mps2 is None or rate_radps is None else Shaking(force_mps2, rate_radps)


def limits_of(rest: Shaking | None) -> Shaking:
    """What a standing train shows at most, by what it has shown before."""
    if rest is None:
        return Shaking(*QUIET)
    return Shaking(*(max(least, times * one) for one, times, least in zip(rest, LEARNED, LEAST_QUIET, strict=True)))


class FirstRest:
    """Watches the samples from the beginning until it is sure."""

    def __init__(self, rest: Shaking | None = None, *, limits: Shaking | None = None) -> None:
        """`rest`: what the inertial sensor has shown at rest before. `limits`: what counts as rest, instead."""
        self.state = Rest.WAITING
        self._learned = rest is not None or limits is not None
        """It is known what the sensor shows at rest; also once it has been quiet."""
        self._limits = limits or limits_of(rest)
        self._slow = not self._learned
        """What shakes the train has been so little that it is not fast."""
        self._times_ns = np.empty(0, np.int64)
        self._imu: SixAxes = np.empty((0, 6))
        self._was_quiet = True
        self._alike = 0
        """Windows in a row that were like the newest."""
        self._done = False
        """The wheel has turned: nothing is left to watch."""
        self._level_mps2: float | None = None
        """Mean of the force along the train while the wheel stood."""
        self._gained_mps = 0.0
        self._counts: dict[str, tuple[Counts, Floats]] = {}
        self._begun_ns: int | None = None
        self._departed_ns: int | None = None
        self._forced_ns: int | None = None
        self.begun_turning = False
        """The wheel turned before anything showed a train at rest (`first_motion`)."""
        self.unsure_since_ns: int | None = None
        """Begin of what is not vouched for."""

    @property
    def fastest_mps(self) -> float:
        """Speed of the train, at most, while nothing is sure."""
        return SLOW_MPS if self._slow else FASTEST_MPS

    @property
    def settled(self) -> bool:
        """Whether nothing more can change."""
        return self._done

    def take_imu(self, t_ns: Counts, imu: SixAxes) -> None:
        """Samples of the inertial sensor, finite ones."""
        if self._done or not len(t_ns):
            return
        self._begin(int(t_ns[0]))
        if self._departed_ns is not None:
            self._integrate(t_ns, imu[:, 0])
            return
        self._times_ns = np.concatenate([self._times_ns, t_ns])
        self._imu = np.concatenate([self._imu, imu])
        if (self._times_ns[-1] - self._times_ns[0]) / 1e9 >= WINDOW_S:
            self._judge_window()

    def take_way(self, axle: str, t_ns: Counts, way_m: Floats) -> None:
        """Way of an axle's rim by its counts, shape (n,)."""
        if self._done or not len(t_ns):
            return
        self._begin(int(t_ns[0]))
        old_ns, old_m = self._counts.get(axle, (np.empty(0, np.int64), np.empty(0)))
        all_ns, all_m = np.concatenate([old_ns, t_ns]), np.concatenate([old_m, way_m])
        kept = all_ns >= all_ns[-1] - KEPT_S * 1e9
        self._counts[axle] = (all_ns[kept], all_m[kept])
        newest_ns = int(all_ns[-1])
        self._judge_wheel(newest_ns)
        if self.state is Rest.WAITING and self._begun_ns is not None and newest_ns - self._begun_ns >= SILENT_S * 1e9:
            self._slow = False
            self._doubt(self._begun_ns)

    def _integrate(self, t_ns: Counts, ax_mps2: Floats) -> None:
        """Speed gained since the wheel began to turn, by the force beyond that of before."""
        if self._level_mps2 is None:
            return
        before_ns = np.r_[t_ns[0] if self._forced_ns is None else self._forced_ns, t_ns[:-1]]
        steps_s = np.clip((t_ns - before_ns) / 1e9, 0.0, LONGEST_STEP_S)
        self._gained_mps += float(np.sum((ax_mps2 - self._level_mps2) * steps_s))
        self._forced_ns = int(t_ns[-1])

    def _begin(self, t_ns: int) -> None:
        if self._begun_ns is None:
            self._begun_ns = t_ns

    def _doubt(self, since_ns: int | None) -> None:
        self.state = Rest.UNSURE
        self.unsure_since_ns = since_ns

    def _judge_window(self) -> None:
        """The inertial sensor over one window."""
        enough = len(self._times_ns) >= LEAST_SAMPLES
        shaking = shaking_of(self._imu)
        quiet = enough and shaking.within(self._limits)
        self._slow = self._slow and enough and shaking.within(Shaking(*ROUGHLY_QUIET))
        self._level_mps2 = float(np.mean(self._imu[:, 0]))
        last_ns = int(self._times_ns[-1])
        self._times_ns, self._imu = np.empty(0, np.int64), np.empty((0, 6))
        self._alike = self._alike + 1 if quiet == self._was_quiet else 1
        self._was_quiet = quiet
        if self.state is Rest.WAITING and not quiet:
            self._doubt(self._begun_ns)
        elif self.state is Rest.WAITING:
            self.state, self._learned = Rest.SURE, True
        elif self.state is Rest.UNSURE and quiet and self._alike >= QUIET_AGAIN:
            self.state = Rest.OVER
        elif self.state is Rest.SURE and not quiet and self._alike >= SHAKEN_AGAIN:
            self._doubt(max(self._begun_ns or 0, last_ns - UNFELT_NS))

    def _speed_mps(self) -> float:
        """Speed of the fastest axle's rim."""
        speeds = [0.0]
        for t_ns, way_m in self._counts.values():
            at = int(np.searchsorted(t_ns, t_ns[-1] - SPEED_S * 1e9))
            if t_ns[-1] > t_ns[at]:
                speeds.append(float((way_m[-1] - way_m[at]) / ((t_ns[-1] - t_ns[at]) / 1e9)))
        return max(speeds, key=abs)

    def _judge_wheel(self, now_ns: int) -> None:
        speed_mps = self._speed_mps()
        if abs(speed_mps) <= TURNING_MPS and self._departed_ns is None:
            return
        if self.state in {Rest.WAITING, Rest.SURE}:
            self.begun_turning = self.state is Rest.WAITING
            self.state, self._done = Rest.SURE, True
            return
        if self._departed_ns is None:
            # No train gains more within the window over which the wheel's speed is taken.
            self._departed_ns, self._gained_mps = now_ns, min(GONE_MPS, max(-GONE_MPS, speed_mps))
            return
        long = now_ns - self._departed_ns > LONGEST_DEPARTURE_S * 1e9
        if abs(speed_mps) < GONE_MPS and not long:
            return
        # Of a sensor whose rest is not known the train may have been under way, and the wheel may still lag behind.
        agrees = self._learned and abs(speed_mps - self._gained_mps) <= AGREE_MPS + AGREE_SHARE * abs(speed_mps)
        known = self._level_mps2 is not None
        self._done = True
        self.state = Rest.SURE if agrees and known and not long else Rest.OVER


class RestShaking:
    """How much an inertial sensor, and what hums in its vehicle, shows at rest."""

    def __init__(self, known: Shaking | None = None) -> None:
        """`known`: what was learned before."""
        self.level = known
        self._since_ns: int | None = None
        self._imu: list[SixAxes] = []

    def take_imu(self, t_ns: Counts, imu: SixAxes, *, stands: bool) -> None:
        """Samples, and whether the train stands for sure."""
        if not stands or not len(t_ns):
            self._since_ns, self._imu = None, []
            return
        self._since_ns = int(t_ns[0]) if self._since_ns is None else self._since_ns
        self._imu.append(imu)
        if (int(t_ns[-1]) - self._since_ns) / 1e9 < WINDOW_S:
            return
        seen = shaking_of(np.concatenate(self._imu))
        self._since_ns, self._imu = None, []
        if self.level is None:
            self.level = seen
        else:
            steps = (FOLLOWING if new > old else 1.0 / FOLLOWING for new, old in zip(seen, self.level, strict=True))
            self.level = Shaking(*(old * step for old, step in zip(self.level, steps, strict=True)))
