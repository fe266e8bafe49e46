"""A driver and a train: powers, coasts, brakes to restrictions and stops, dwells; effort with limited jerk.

Sign: positive in the direction of running. Efforts and resistances are over mass [m/s²].
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import kernel
from services.simulator.motion_state import BRAKE, COAST, DWELL, POWER, STEP_S, VehicleConstants

Floats = NDArray[np.float64]

GRAVITY: Final = 9.80665
DECIDE_STEPS: Final = 40
"""A driver decides every 0.4 s."""
NOTCHES: Final = 7
FINE_MPS: Final = 4.0
NEAR_M: Final = 2.0
"""From here on a driver brakes to rest."""
CREEP_MPS: Final = 1.2
"""Speed at which a driver who has stopped short goes on."""


@kernel
def draw_leg(state: Any, ranges: Floats, uniform: Floats) -> None:  # noqa: ANN401 - a numpy record
    """Habits for the next leg: rows of `ranges` (5, 2) are margin, band, planned braking, power, dwell."""
    s = state[0]
    row = uniform[s.leg % len(uniform)]
    s.margin_mps = ranges[0, 0] + row[0] * (ranges[0, 1] - ranges[0, 0])
    s.band_mps = ranges[1, 0] + row[1] * (ranges[1, 1] - ranges[1, 0])
    s.planned_brake_mps2 = ranges[2, 0] + row[2] * (ranges[2, 1] - ranges[2, 0])
    s.power_share = ranges[3, 0] + row[3] * (ranges[3, 1] - ranges[3, 0])
    s.dwell_s = ranges[4, 0] + row[4] * (ranges[4, 1] - ranges[4, 0])
    s.leg += 1


@kernel
def stopping_brake(speed_mps: float, needed_mps2: float, service_mps2: float) -> float:
    """Brake effort towards a stop: in notches, and fine at low speed, for notches end in a wrong place."""
    if speed_mps <= CREEP_MPS:
        return min(max(needed_mps2, 0.35), service_mps2)
    if speed_mps < FINE_MPS:
        return min(needed_mps2, service_mps2)
    notch = np.ceil(needed_mps2 / service_mps2 * NOTCHES - 0.3)
    return float(service_mps2 * min(max(notch, 1.0), float(NOTCHES)) / NOTCHES)


@kernel
def decide(state: Any, allowed_mps: float, stop_m: float, slope: float, c: VehicleConstants) -> None:  # noqa: ANN401 - a numpy record
    """The driver's wish for the next moments, into `mode` and `wanted_mps2`.

    `allowed_mps` holds 2 s ahead; `stop_m` is the way left to the stopping place, infinite without one.
    What the `slope` under the train takes or gives is allowed for.
    """
    s = state[0]
    v = s.speed_mps
    target = max(allowed_mps - s.margin_mps, 0.6 * allowed_mps)
    to_stop = v * v / (2.0 * max(stop_m - 0.3 * v, 0.05))
    downhill = -GRAVITY * slope
    planned = min(s.planned_brake_mps2, 0.85 * c.service_brake_mps2 - downhill)
    stopping = to_stop >= planned or (s.mode == BRAKE and to_stop > 0.6 * planned)
    stopping = stopping or stop_m < NEAR_M
    if stopping:
        s.mode = BRAKE
        s.wanted_mps2 = -stopping_brake(v, max(to_stop + downhill, 0.05), c.service_brake_mps2)
    elif v > allowed_mps:
        s.mode = BRAKE
        s.wanted_mps2 = -min(max(0.35 + 0.6 * (v - allowed_mps) + downhill, 0.1), c.service_brake_mps2)
    elif s.mode == BRAKE and v > target - 0.4:
        s.wanted_mps2 = max(s.wanted_mps2, -0.5 - max(downhill, 0.0))
    elif s.mode in (BRAKE, DWELL):
        s.mode = POWER if s.mode == DWELL or v < target - s.band_mps else COAST
    elif s.mode == POWER and v >= target - 0.3:
        s.mode = COAST
    elif s.mode == COAST and v < target - s.band_mps:
        s.mode = POWER
    if s.mode == COAST:
        s.wanted_mps2 = 0.0
    if s.mode == POWER:
        reach = c.max_traction_mps2 * s.power_share
        if stop_m < 25.0 and v > CREEP_MPS:  # noqa: PLR2004 - short of the stopping place: inch forward
            reach = 0.0
        s.wanted_mps2 = min(reach, c.power_w_per_kg * s.power_share / max(v, 0.5))


@kernel
def drive(state: Any, allowed_mps: float, stop_m: float, slope: float, c: VehicleConstants) -> None:  # noqa: ANN401 - a numpy record
    """One step of the driver: dwell, or decide every 0.4 s; then the effort follows with limited jerk."""
    s = state[0]
    if s.mode == DWELL:
        s.wanted_mps2 = -0.5
        s.dwell_s -= STEP_S
        if s.dwell_s <= 0.0 and s.has_stop == 1:
            decide(state, allowed_mps, stop_m, slope, c)
    elif s.step % DECIDE_STEPS == 0:
        decide(state, allowed_mps, stop_m, slope, c)
    change = (s.wanted_mps2 - s.effort_mps2) * STEP_S / 0.35
    most = c.jerk_mps3 * STEP_S
    s.effort_mps2 += min(max(change, -most), most)


@kernel
def move(state: Any, effort_mps2: float, slope: float, curvature_per_m: float, c: VehicleConstants) -> bool:  # noqa: ANN401 - a numpy record
    """One step of the train under an effort; True when it has just come to rest.

    Davis resistance, gravity on the slope, curve resistance of 6 N/kN·(100 m / R) (as usual for 1067 mm
    gauge: 600/R kg/t). Brakes hold at rest, they never push.
    """
    s = state[0]
    v = s.speed_mps
    resistance = c.davis_a_mps2 + c.davis_b_per_s * v + c.davis_c_per_m * v * v
    resistance += GRAVITY * 0.6 * abs(curvature_per_m)
    pull = -GRAVITY * slope
    if v <= 0.0:
        net = max(effort_mps2, 0.0) + pull
        if net <= resistance or effort_mps2 <= 0.0:
            s.acceleration_mps2 = 0.0
            return False
    a = effort_mps2 + pull - resistance
    after = v + a * STEP_S
    if after <= 0.0:
        s.way_m += v * STEP_S / 2.0
        s.acceleration_mps2 = 0.0
        s.speed_mps = 0.0
        return bool(v > 0.0)
    s.way_m += (v + after) / 2.0 * STEP_S
    s.speed_mps = after
    s.acceleration_mps2 = a
    return False
