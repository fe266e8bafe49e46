"""Inertial speed and distance from one start point on, in smoothed time, and brought to the present."""

from __future__ import annotations

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import PERIOD_S
from services.odometry_fusion.paper_attitude import forward_acceleration, initial_pitch, initial_roll, pitch_rate
from services.odometry_fusion.tick_layout import Records

FASTEST_MPS = 100.0
"""No train runs faster, however long the inertial sensor drifts."""
LATEST_TICKS = 5
"""Over so many the latest acceleration is averaged, which is held for the sensor's latency."""


@kernel
def begin_track(track: Records, smoothed: Records, start: int, start_ns: int, offset_m: float, biases: Records) -> None:
    """Set off from the wheel's speed and way at the start point, with the attitude there."""
    own, point, bias = track[0], smoothed[start], biases[0]
    own.start_ns, own.agreeing, own.t_s = start_ns, 0, 0.0
    own.pitch_rad = initial_pitch(point.matched_mps2, point.wheel_mps2)
    yaw_radps = point.yaw_radps - bias.yaw_bias_radps
    own.roll_rad = initial_roll(point.ay_mps2, point.az_mps2, point.speed_mps, yaw_radps)
    own.forward_mps2 = forward_acceleration(point.ax_mps2, own.pitch_rad)
    own.speed_mps = point.speed_mps
    own.distance_m = point.way_m + offset_m


@kernel
def step_track(track: Records, smoothed: Records, at: int, correction: int, biases: Records) -> None:
    """One period on: equations (4), (6) and the integrals of (2), by trapezoids."""
    own, now, bias = track[0], smoothed[at], biases[0]
    roll_radps = now.roll_radps - bias.roll_bias_radps
    pitch_radps = now.pitch_radps - bias.pitch_bias_radps
    yaw_radps = now.yaw_radps - bias.yaw_bias_radps
    own.roll_rad += roll_radps * PERIOD_S
    own.pitch_rad += pitch_rate(correction, roll_radps, pitch_radps, yaw_radps, own.roll_rad) * PERIOD_S
    forward_mps2 = forward_acceleration(now.ax_mps2, own.pitch_rad)
    speed_mps = own.speed_mps + 0.5 * (own.forward_mps2 + forward_mps2) * PERIOD_S
    speed_mps = min(FASTEST_MPS, max(-FASTEST_MPS, speed_mps))
    own.distance_m += 0.5 * (own.speed_mps + speed_mps) * PERIOD_S
    own.speed_mps, own.forward_mps2 = speed_mps, forward_mps2
    own.t_s += PERIOD_S


@kernel
def present(track: Records, ticks: Records, at: int, window: int) -> tuple[float, float, float]:
    """Distance and speed at the instant that the latest inertial sample shows, and the acceleration there.

    Means over a window are undone with the unsmoothed accelerations in it: going back from the window's end,
    speed and distance differ from those at the end by what the accelerations add up to.
    """
    own = track[0]
    lost_mps = lost_m = 0.0
    mean_mps = mean_m = 0.0
    for k in range(at, at - window, -1):
        own_mps2 = forward_acceleration(ticks[k].ax_mps2, own.pitch_rad)
        mean_mps += lost_mps + 0.5 * own_mps2 * PERIOD_S
        # the way between the middle of this period and the end, by which speeds fall short of the final one
        mean_m += lost_m + 0.5 * lost_mps * PERIOD_S + 0.125 * own_mps2 * PERIOD_S * PERIOD_S
        lost_m += (lost_mps + 0.5 * own_mps2 * PERIOD_S) * PERIOD_S
        lost_mps += own_mps2 * PERIOD_S
    speed_mps = own.speed_mps + mean_mps / window
    distance_m = own.distance_m + speed_mps * 0.5 * window * PERIOD_S - mean_m / window
    latest_mps2 = 0.0
    for k in range(at - LATEST_TICKS + 1, at + 1):
        latest_mps2 += forward_acceleration(ticks[k].ax_mps2, own.pitch_rad)
    return distance_m, speed_mps, latest_mps2 / LATEST_TICKS
