"""Whether the inertial sensor still looks forward: its horizontal axes against the wheel's acceleration.

A sensor turned by a quarter about the vertical shows the train's acceleration on y, and v ωz on x. Both axes and the
wheel's acceleration go through the same filter, which takes off what is slow (gradient, cant, mounting). Evidence is
gathered only while the wheel's acceleration fits an axis: that of a slip fits neither.
"""

from __future__ import annotations

from typing import Final

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_branch import acceleration
from services.odometry_fusion.fused_layout import Record, State, V

SMOOTH_S: Final = 1.0
"""The wheel's acceleration is that of its speed against its mean over so long; the axes' means likewise."""
MEAN_S: Final = 30.0
"""What changes more slowly is not motion."""
SETTLING_S: Final = 2.0
FIT: Final = 0.12
"""An axis fits when the square of what is missing is below this share of the wheel's."""
UNFIT: Final = 0.4
"""And speaks for nothing unless the other one misses more than this."""
CONTRADICTION: Final = 0.5
"""Only what looks like a slip speaks for a turned sensor: it never agrees with the wheel."""
LEAST_MPS2: Final = 0.25
MOST: Final = 0.6
"""A tick counts for at most so much [(m/s²)²]."""
PAUSE_TICKS: Final = 30
"""After a rim that was wild nothing is compared."""
DEPARTURE_S: Final = 15.0
TURNED_AT_DEPARTURE: Final = 1.5
TURNED: Final = 5.0
RIGHT: Final = 2.5
"""Evidence for believing that the sensor is turned, and that it is right again: (m/s²)² s. Under way a slip in
a transition may look like it for seconds; at departures the train is slow, and y shows nothing but gravity."""


@kernel
def forget_axes(now: Record) -> None:
    """After a gap the filters begin anew."""
    now.axes_s = 0.0


@kernel
def _weigh(evidence: float, missing: float, other: float, wheel: float, dt_s: float) -> float:
    """Evidence after a step for an axis that misses the wheel's acceleration by the square `missing` [(m/s²)²].

    Against one that misses it by `other`.
    """
    if abs(wheel) > LEAST_MPS2 and missing < FIT * wheel * wheel and other > UNFIT * wheel * wheel:
        return float(evidence + min(other - missing, MOST) * dt_s)
    return float(max(0.0, evidence - (missing + LEAST_MPS2**2) * dt_s))


@kernel
def watch_axes(tick: Record, now: Record, x: State, dt_s: float) -> bool:
    """Take in one tick of wheel and inertial sensor, the believed state; gives whether `now.turned` changed."""
    lateral_mps2 = tick.ay_mps2 - x[V] * (tick.gz_radps - now.yaw_bias_radps)
    ahead_mps2 = acceleration(x, tick)
    now.axes_s += dt_s
    if now.axes_s < 1.5 * dt_s:
        now.smooth_rim_mps, now.smooth_ax_mps2, now.smooth_ay_mps2 = now.rim_mps, ahead_mps2, lateral_mps2
        now.mean_rim_mps2, now.mean_ax_mps2, now.mean_ay_mps2 = 0.0, ahead_mps2, lateral_mps2
        now.left_turned = now.right_turned = now.not_turned = 0.0
        return False
    rim_mps2 = (now.rim_mps - now.smooth_rim_mps) / SMOOTH_S
    share = dt_s / SMOOTH_S
    now.smooth_rim_mps += share * (now.rim_mps - now.smooth_rim_mps)
    now.smooth_ax_mps2 += share * (ahead_mps2 - now.smooth_ax_mps2)
    now.smooth_ay_mps2 += share * (lateral_mps2 - now.smooth_ay_mps2)
    if now.tick - now.wild_tick < PAUSE_TICKS:
        now.left_turned = now.right_turned = now.not_turned = 0.0
        return False
    slow = dt_s / min(MEAN_S, max(now.axes_s, SETTLING_S))
    now.mean_rim_mps2 += slow * (rim_mps2 - now.mean_rim_mps2)
    now.mean_ax_mps2 += slow * (now.smooth_ax_mps2 - now.mean_ax_mps2)
    now.mean_ay_mps2 += slow * (now.smooth_ay_mps2 - now.mean_ay_mps2)
    if now.axes_s < SETTLING_S:
        return False
    wheel = rim_mps2 - now.mean_rim_mps2
    ahead = (now.smooth_ax_mps2 - now.mean_ax_mps2 - wheel) ** 2
    aside = now.smooth_ay_mps2 - now.mean_ay_mps2
    left, right = (aside - wheel) ** 2, (aside + wheel) ** 2
    if now.slip_share > CONTRADICTION or now.turned:
        now.left_turned = _weigh(now.left_turned, left, ahead, wheel, dt_s)
        now.right_turned = _weigh(now.right_turned, right, ahead, wheel, dt_s)
    now.not_turned = _weigh(now.not_turned, ahead, min(left, right), wheel, dt_s)
    return _decide(now)


@kernel
def _decide(now: Record) -> bool:
    wanted = TURNED_AT_DEPARTURE if now.since_rest_s < DEPARTURE_S else TURNED
    turned = max(now.left_turned, now.right_turned) > wanted
    changes = now.not_turned > RIGHT if now.turned else turned
    if changes:
        now.turned = 1 - now.turned
        now.left_turned = now.right_turned = now.not_turned = 0.0
    return bool(changes)
