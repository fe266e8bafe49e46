"""Moving averages of both sensors over one window (Iwata et al., section 4.1: 3 s), and their changes.

The paper's rates: roll positive right side down, pitch positive nose up, yaw positive to the left. With x forward,
y left, z up, right-handed, that is gx, -gy, gz.
"""

from __future__ import annotations

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import PERIOD_S
from services.odometry_fusion.paper_layout import Record
from services.odometry_fusion.tick_layout import Records

LONGEST_SILENCE_S = 0.5
"""The wheel's last speed is held for so long after its last count."""
MISSED_TEETH = 3.0
"""So many should have come meanwhile; fewer, and the wheel stands or creeps."""
LONGEST_STILL_S = 120.0
"""A silent counter is taken for a standing wheel's for at most so long."""
LONGEST_HOLD_S = 0.3
"""Missing samples are bridged so long by the last ones."""


@kernel
def counts_missing(tick: Record, pulse_m: float) -> bool:
    """Whether counts should have come that have not. A counter that reports pulse by pulse is silent at rest."""
    silent_s = tick.tacho_missing_s
    missed = abs(tick.wheel_speed_mps) * silent_s > MISSED_TEETH * pulse_m or silent_s > LONGEST_STILL_S
    return bool(silent_s > LONGEST_SILENCE_S and missed)


@kernel
def smooth(ticks: Records, at: int, rules: Records, out: Records) -> None:
    """Means of the inertial sensor over the window up to `at`; way, speed and acceleration of the wheel alike.

    The first tick is that of the first count: the wheel, delayed by the latency, is only known so long after it.

    Ap is the change of speed from the window's first `speed_window` ticks to its last ones: its mean acceleration.
    With a speed of a single period (0.3 m/s per pulse) Ap would be coarser than what it is compared with. That weighs
    accelerations in the window by a trapezoid, and `matched_mps2` is the mean of ax with the same weights: otherwise
    every change of effort would show as a difference of the two for as long as it is in the window.
    """
    now = out[at]
    now.ready = now.wheel_ready = 0
    window, speed_window = rules[0].window, rules[0].speed_window
    if at < window + 1 + rules[0].latency:
        return
    ax = ay = az = gx = gy = gz = way = matched = 0.0
    ready = wheel_ready = 1
    for k in range(at - window + 1, at + 1):
        tick = ticks[k]
        ax += tick.ax_mps2
        matched += min(k - at + window - 0.5, float(speed_window), at - k + 0.5) * tick.ax_mps2
        ay += tick.ay_mps2
        az += tick.az_mps2
        gx += tick.gx_radps
        gy += tick.gy_radps
        gz += tick.gz_radps
        way += 0.5 * (tick.aligned_m + ticks[k - 1].aligned_m)
        if tick.imu_missing_s > LONGEST_HOLD_S:
            ready = 0
        if counts_missing(tick, rules[0].pulse_m):
            wheel_ready = 0
    now.ax_mps2, now.ay_mps2, now.az_mps2 = ax / window, ay / window, az / window
    now.matched_mps2 = matched / (speed_window * (window - speed_window))
    now.roll_radps, now.pitch_radps, now.yaw_radps = gx / window, -gy / window, gz / window
    now.way_m = way / window
    now.speed_mps = (ticks[at].aligned_m - ticks[at - window].aligned_m) / (window * PERIOD_S)
    late_mps = (ticks[at].aligned_m - ticks[at - speed_window].aligned_m) / (speed_window * PERIOD_S)
    early_mps = (ticks[at - window + speed_window].aligned_m - ticks[at - window].aligned_m) / (speed_window * PERIOD_S)
    now.wheel_mps2 = (late_mps - early_mps) / ((window - speed_window) * PERIOD_S)
    now.jerk_imu = now.matched_mps2 - out[at - 1].matched_mps2
    now.jerk_wheel = now.wheel_mps2 - out[at - 1].wheel_mps2
    now.ready, now.wheel_ready = ready, wheel_ready
