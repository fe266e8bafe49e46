"""Standstill, and the gyros' biases that show in it (Iwata et al., section 3.1.4: sensors are reset at stops)."""

from __future__ import annotations

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import PERIOD_S
from services.odometry_fusion.tick_layout import Records

REST_TICKS = 20
"""The wheel has not turned for so long."""
MOST_RATE_RADPS = 0.05
"""A vehicle at rest turns less, biases included: those of cheap sensors reach 0.02 rad/s and more."""
STILL_M = 0.003
"""In a tick: no pulse, or the noise of a counter that is made of a measured speed."""
LONGEST_MEAN_S = 20.0
SURE_S = 3.0
"""By then the brakes' last force is out of the moving average."""
DEPARTURE_MPS2 = 0.25
"""Slower departures do not exist; the body on its springs shows less."""


@kernel
def departs_unseen(ax_mps2: float, state: Records) -> bool:
    """Whether the force along the train has changed while the wheel stands: a counter that is stuck.

    At rest the gradient's share is known, so this is far finer than equation (1).
    """
    now = state[0]
    return bool(now.rest_s > SURE_S and abs(ax_mps2 - now.rest_ax_mps2) > DEPARTURE_MPS2)


@kernel
def watch_rest(ticks: Records, at: int, no_pulses: bool, state: Records) -> bool:  # noqa: FBT001 - a kernel takes its arguments by place
    """Whether the train stands; takes in biases while it does.

    The wheel alone cannot tell standing from sliding with locked wheels; this is only asked while it adheres.
    """
    now, tick = state[0], ticks[at]
    still = at > 0 and abs(tick.way_m - ticks[at - 1].way_m) < STILL_M and not no_pulses
    steady = max(abs(tick.gx_radps), abs(tick.gy_radps), abs(tick.gz_radps)) < MOST_RATE_RADPS
    now.rest_ticks = now.rest_ticks + 1 if still and steady else 0
    if now.rest_ticks < REST_TICKS or tick.imu_missing_s > 0.3:  # noqa: PLR2004 - as long as samples are bridged
        now.rest_s = 0.0
        now.since_rest_s += PERIOD_S
        return bool(now.rest_ticks >= REST_TICKS)
    now.rest_s = min(now.rest_s + PERIOD_S, LONGEST_MEAN_S)
    share = PERIOD_S / now.rest_s
    now.roll_bias_radps += share * (tick.gx_radps - now.roll_bias_radps)
    now.pitch_bias_radps += share * (-tick.gy_radps - now.pitch_bias_radps)
    now.yaw_bias_radps += share * (tick.gz_radps - now.yaw_bias_radps)
    now.since_rest_s = 0.0
    return True
