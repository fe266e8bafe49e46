"""What changes from step to step in a simulated train, and the constants of its steps.

The state is one numpy record that the kernels change in place; the constants are named tuples, which
compiled code takes as they are.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.simulator.motion_settings import MotionSettings

STEP_S: Final = 0.01
"""Sampling of inertial sensors here, and the step of everything."""
DWELL: Final = 0
POWER: Final = 1
COAST: Final = 2
BRAKE: Final = 3

STATE: Final = np.dtype(
    [
        (name, np.float64)
        for name in (
            "time_s",
            "way_m",  # of the front end along the table
            "speed_mps",
            "acceleration_mps2",
            "wanted_mps2",
            "effort_mps2",
            "mode_s",
            "dwell_s",
            "margin_mps",
            "band_mps",
            "planned_brake_mps2",
            "power_share",
            "wheel_mps",  # of the rim
            "slip_mps",  # of the rim against the train, where it is not free
            "wheel_way_m",
            "hold",  # share of the effort that slide protection lets through
            "episode_s",
            "stuck_s",
            "free_since_s",
            "asked_mps2",  # at the episode's onset
            "onset_mps",  # speed of the train then
            "away_mps",  # of the rim against the train beside creep, of a wheel that breaks away
            "creep_factor",
            "creep_noise",
            "grip_noise",
            "force_noise",
            "pitch_rad",
            "pitch_radps",
            "roll_rad",
            "roll_radps",
        )
    ]
    + [
        (name, np.int64)
        for name in (
            "mode",
            "stop",
            "has_stop",
            "episode",
            "next_random",
            "sliding",
            "free",
            "slip",  # adhesion exceeded and not yet regained for good
            "told",  # the same, and whatever else turns the wheel as wrongly: what the truth calls a slip
            "leg",
            "step",
        )
    ]
)


class VehicleConstants(NamedTuple):
    """A vehicle, for the kernels."""

    max_traction_mps2: float
    power_w_per_kg: float
    service_brake_mps2: float
    jerk_mps3: float
    davis_a_mps2: float
    davis_b_per_s: float
    davis_c_per_m: float
    traction_load: float
    brake_load: float
    rotating_mass_share: float
    pitch_per_mps2: float
    roll_flexibility: float
    dry_mps2: float
    micro_slip: float


class Command(NamedTuple):
    """What is done to the train from outside, for one call of the kernels."""

    slip_mps: float
    """Forced slip of the wheel against the train; 0: none."""
    micro_share: float
    """Micro-slip added as a share of speed, in the direction of effort."""


NO_COMMAND: Final = Command(0.0, 0.0)


def vehicle_constants(settings: MotionSettings) -> VehicleConstants:
    """Constants of the settings' vehicle and rail."""
    v = settings.vehicle
    return VehicleConstants(
        v.max_traction_mps2,
        v.power_w_per_kg,
        v.service_brake_mps2,
        v.jerk_mps3,
        v.davis_a_mps2,
        v.davis_b_per_s,
        v.davis_c_per_m,
        v.traction_load,
        v.brake_load,
        v.rotating_mass_share,
        v.pitch_per_mps2,
        v.roll_flexibility,
        settings.adhesion.dry_mps2,
        settings.adhesion.micro_slip,
    )


def fresh_state() -> NDArray[np.void]:
    """A train at rest at the start of its table, shape (1,)."""
    state = np.zeros(1, STATE)
    state["hold"] = 1.0
    state["episode"] = -1
    state["creep_factor"] = 1.0
    return state
