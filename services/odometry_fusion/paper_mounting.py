"""Whether the inertial sensor's axes are those of the vehicle: by gravity always, by every departure from rest."""

from __future__ import annotations

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import PERIOD_S
from services.odometry_fusion.tick_layout import Records

MOST_SIDEWAYS_MPS2 = 3.0
LEAST_UPWARD_MPS2 = 7.0
"""On a railway gravity leaves the vertical axis by cant, gradient and braking: well within these."""
TILTED_TICKS = 20
PROOF_MPS = 4.0
"""The wheel's speed at which a departure is judged."""
LONGEST_PROOF_S = 20.0
NEAR = 0.3
"""What another axis shows of the departure differs at most by this share from what the wheel shows."""
FAR = 0.5
"""And what the forward axis shows, by at least this: more than any spin hides without showing elsewhere."""


@kernel
def watch_mounting(ticks: Records, at: int, state: Records) -> bool:
    """Whether the axes are wrong. Gravity may come back into its place; a departure is believed for good."""
    now, tick = state[0], ticks[at]
    tilted = (
        max(abs(tick.ax_mps2), abs(tick.ay_mps2)) > MOST_SIDEWAYS_MPS2 or tick.az_mps2 < LEAST_UPWARD_MPS2
    ) and tick.imu_missing_s <= PERIOD_S
    now.tilted = min(now.tilted + 1, 2 * TILTED_TICKS) if tilted else max(now.tilted - 1, 0)
    if now.wrong_axes == 0 and now.rest_s <= 0.0 and now.proof_s >= 0.0:
        _watch_departure(ticks, at, state)
    elif now.rest_s > 0.0:
        share = PERIOD_S / now.rest_s
        now.rest_ax_mps2 += share * (tick.ax_mps2 - now.rest_ax_mps2)
        now.rest_ay_mps2 += share * (tick.ay_mps2 - now.rest_ay_mps2)
        now.proof_s = now.proof_x_mps = now.proof_y_mps = 0.0
    return bool(now.wrong_axes != 0 or now.tilted >= TILTED_TICKS)


@kernel
def _watch_departure(ticks: Records, at: int, state: Records) -> None:
    """Speeds that the horizontal axes show since rest, against the wheel's once it is fast enough."""
    now, tick = state[0], ticks[at]
    now.proof_s += PERIOD_S
    now.proof_x_mps += (tick.ax_mps2 - now.rest_ax_mps2) * PERIOD_S
    now.proof_y_mps += (tick.ay_mps2 - now.rest_ay_mps2) * PERIOD_S
    wheel_mps = tick.wheel_speed_mps  # negative where the counter can tell backwards
    least_mps = abs(wheel_mps)
    if tick.imu_missing_s > PERIOD_S or now.proof_s > LONGEST_PROOF_S:
        now.proof_s = -1.0
    elif least_mps >= PROOF_MPS:
        backwards = abs(now.proof_x_mps + wheel_mps) < NEAR * least_mps
        sideways = abs(abs(now.proof_y_mps) - least_mps) < NEAR * least_mps
        if abs(now.proof_x_mps - wheel_mps) > FAR * least_mps and (backwards or sideways):
            now.wrong_axes = 1
        now.proven = 1
        now.proof_s = -1.0
