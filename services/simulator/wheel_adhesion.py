"""The measured wheel: micro-slip while it adheres, slides and spins when more effort is asked than the rail gives.

While it adheres the rim is faster (traction) or slower (braking) than the train by creep, a few per
mille of speed that grow as effort nears adhesion. Beyond it the wheelset, whose inertia is a share r of
the mass it carries, turns freely: r dw/dt = effort·hold + sign·kinetic adhesion. Slide or spin
protection takes the effort back (`hold`) when slip passes its threshold and gives it again, which makes
the well-known cycles; without it a sliding wheel locks. Modern control that settles at a slip is given
as a slip that ramps in and out; a wheel that breaks away out of growing micro-slip by `breakaway`.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import kernel
from services.simulator.breakaway import LEAST_PEAK_MPS, lasts_s, slip_of
from services.simulator.motion_state import STEP_S, VehicleConstants
from services.simulator.slip_episodes import AT_PLACE, AT_TIME, BREAKING_AWAY, CONTROLLED, CREEPING, CYCLING, MICRO

Floats = NDArray[np.float64]

CREEP: Final = 0.006
"""Micro-slip per share of adhesion in use."""
CREEP_NOISE: Final = 3e-4
LEAST_EFFORT_MPS2: Final = 0.25
"""Below this no random slip begins."""
LEAST_SPEED_MPS: Final = 3.0
AGAIN_S: Final = 20.0
"""An episode at a place does not come again sooner."""
STICK_S: Final = 0.15
"""Time constant with which creep settles."""
FORCED_S: Final = 0.4
REGAINED_S: Final = 1.5
"""A wheel that has adhered this long has regained its adhesion, whatever the rail."""
SLIPPING_SHARE: Final = 0.02
SLIPPING_MPS: Final = 0.3
"""A rim that differs from the train by more than both of these slips, whatever has brought it there. It goes on
slipping until it differs by less than half of either."""


@kernel
def begin_episode(state: Any, randoms: Floats, sets: Floats, started_s: Floats) -> None:  # noqa: ANN401 - a numpy record
    """Begin an episode that is due; `started_s` (k,) is when each one set by time or place last began."""
    s = state[0]
    effort = s.effort_mps2
    for k in range(len(sets)):
        due = sets[k, 0] == AT_TIME and 0.0 <= s.time_s - sets[k, 1] < 0.1 and started_s[k] < 0.0  # noqa: PLR2004 - looked at every 0.1 s
        if sets[k, 0] == AT_PLACE:
            passed = s.way_m - sets[k, 1]
            due = 0.0 <= passed < 20.0 and s.time_s - started_s[k] > AGAIN_S and s.speed_mps > 0.0  # noqa: PLR2004 - metres
        if due:
            started_s[k] = s.time_s
            s.episode, s.episode_s, s.asked_mps2 = len(randoms) + k, 0.0, max(abs(effort), 0.4)
            s.onset_mps = s.speed_mps
            return
    if len(randoms) == 0:
        return
    row = randoms[s.next_random % len(randoms)]
    waited = s.time_s - s.free_since_s - row[1]
    fits = abs(effort) > LEAST_EFFORT_MPS2 and effort * row[2] > 0.0 and s.speed_mps > LEAST_SPEED_MPS
    if waited > 0.0 and fits:
        s.episode, s.episode_s, s.asked_mps2 = s.next_random % len(randoms), 0.0, abs(effort)
        s.onset_mps = s.speed_mps
        s.next_random += 1


@kernel
def grip(state: Any, row: Floats, c: VehicleConstants) -> float:  # noqa: ANN401 - a numpy record
    """Adhesion at hand [m/s²] now, in an episode whose row is given."""
    s = state[0]
    load = c.traction_load if s.effort_mps2 > 0.0 else c.brake_load
    low = max(row[5] * s.asked_mps2 * load * (1.0 + 0.2 * s.grip_noise), 0.02)
    since, left = s.episode_s / row[7], (row[4] - s.episode_s) / row[8]
    if since < 1.0:
        return float(c.dry_mps2 + (low - c.dry_mps2) * since)
    if left < 0.0:
        return float(low + (c.dry_mps2 - low) * min(-left, 1.0))
    return float(low)


@kernel
def adhering(state: Any, demand: float, cap: float, micro_share: float, c: VehicleConstants) -> None:  # noqa: ANN401 - a numpy record
    """Let creep settle under `demand` with `cap` at hand."""
    s = state[0]
    used = min(abs(demand) / cap, 1.0)
    creep = CREEP * used / (1.0 - 0.6 * used) * max(1.0 + 0.35 * s.creep_factor, 0.0) * np.sign(demand)
    creep = c.micro_slip * (creep + CREEP_NOISE * s.creep_noise) + micro_share
    s.slip_mps += (creep * s.speed_mps - s.slip_mps) * STEP_S / STICK_S
    s.hold = min(s.hold + 1.2 * STEP_S, 1.0)


@kernel
def sliding(state: Any, demand: float, cap: float, row: Floats, c: VehicleConstants) -> None:  # noqa: ANN401 - a numpy record
    """Turn freely under `demand` and kinetic adhesion, with protection unless the kind is LOCKED."""
    s = state[0]
    slip = s.wheel_mps - s.speed_mps
    way = np.sign(slip) if slip != 0.0 else np.sign(demand)
    if row[3] == CYCLING:
        limit = row[11] * max(s.speed_mps, 2.0)
        if abs(slip) > limit:
            s.hold = max(s.hold - 4.0 * STEP_S, 0.0)
        elif abs(slip) < 0.5 * limit:
            s.hold = min(s.hold + 1.2 * STEP_S, 1.0)
    elif way > 0.0 and slip > 0.35 * s.speed_mps + 2.0:
        s.hold = max(s.hold - 4.0 * STEP_S, 0.0)
    torque = demand * s.hold
    rate = (torque - way * 0.85 * cap) / c.rotating_mass_share
    rate = min(max(rate, -row[10]), row[10])
    after = max(s.wheel_mps + rate * STEP_S, 0.0)
    if (after - s.speed_mps) * way <= 0.0 and abs(torque) <= cap:
        s.sliding = 0
        after = s.speed_mps
    s.free = 1
    s.wheel_mps = after
    s.slip_mps = after - s.speed_mps


@kernel
def settled_slip(state: Any, row: Floats, demand: float) -> float:  # noqa: ANN401 - a numpy record
    """Slip [share of speed, signed] that control settles at now; 0 once it has ramped out."""
    s = state[0]
    left = row[4] + row[8] - s.episode_s
    ramp = min(s.episode_s / row[7], left / row[8], 1.0)
    if row[3] == CREEPING:
        ramp = min(s.episode_s / row[4], left / row[8], 1.0)
    if left <= 0.0:
        return 0.0
    return float(np.sign(demand) * row[6] * ramp * max(1.0 + 0.15 * s.grip_noise, 0.0))


@kernel
def break_away(state: Any, row: Floats, demand: float, micro_share: float, c: VehicleConstants) -> float:  # noqa: ANN401 - a numpy record
    """One step of a wheel that breaks away, whatever becomes of the effort; share of the effort that the train gets.

    It slips from the first micro-slip to the last.
    """
    s = state[0]
    if s.slip == 0:
        s.slip = -1 if demand < 0.0 else 1
    s.sliding = 1
    s.slip_mps -= s.away_mps
    adhering(state, demand, c.dry_mps2, micro_share, c)
    s.away_mps = s.slip * slip_of(s.episode_s, s.onset_mps, row)
    s.slip_mps += s.away_mps
    if s.episode_s > lasts_s(row) or s.speed_mps <= 0.0:
        s.slip_mps -= s.away_mps
        s.episode, s.sliding, s.slip, s.free_since_s, s.away_mps = -1, 0, 0, s.time_s, 0.0
    return float(1.0 - row[9] * (1.0 - row[5]) * min(abs(s.away_mps) / LEAST_PEAK_MPS, 1.0))


@kernel
def episode_step(state: Any, row: Floats, demand: float, micro_share: float, c: VehicleConstants) -> float:  # noqa: ANN401 - a numpy record
    """One step of an episode; share of the effort that the train gets."""
    s = state[0]
    s.episode_s += STEP_S
    kind, share = row[3], 1.0
    if kind == BREAKING_AWAY:
        return break_away(state, row, demand, micro_share, c)
    if kind in (CONTROLLED, CREEPING):
        settled = settled_slip(state, row, demand)
        s.slip_mps += (settled * s.speed_mps - s.slip_mps) * STEP_S / STICK_S
        s.sliding = 1 if settled != 0.0 else 0
        share = 1.0 - row[9] * (1.0 - row[5]) * min(abs(settled) / row[6], 1.0)
        ended = s.episode_s > row[4] + row[8]
    elif kind == MICRO:
        adhering(state, demand, c.dry_mps2, micro_share + settled_slip(state, row, demand), c)
        ended = s.episode_s > row[4] + row[8]
    else:
        cap = grip(state, row, c)
        if s.sliding == 0 and abs(demand) * s.hold > cap:
            s.sliding = 1
        if s.sliding == 1:
            sliding(state, demand, cap, row, c)
            share = 1.0 - row[9] * (1.0 - min(cap / max(abs(demand), 1e-6), 1.0))
        else:
            adhering(state, demand * s.hold, cap, micro_share, c)
        ended = s.episode_s > row[4] and s.sliding == 0
    if s.sliding == 1 and s.slip == 0:
        s.slip = -1 if demand < 0.0 else 1
    s.stuck_s = s.stuck_s + STEP_S if s.slip != 0 and s.sliding == 0 else 0.0
    if ended or s.stuck_s > REGAINED_S:
        s.episode, s.sliding, s.slip, s.free_since_s, s.hold, s.stuck_s = -1, 0, 0, s.time_s, 1.0, 0.0
    return share


@kernel
def wheel_step(state: Any, randoms: Floats, sets: Floats, forced: tuple[float, float], c: VehicleConstants) -> float:  # noqa: ANN401 - a numpy record
    """One step of the wheel; the effort [m/s²] that the train gets is given back.

    `forced` is a slip [m/s] that a fault holds the wheel at, and micro-slip that it adds [share].
    """
    s = state[0]
    demand = s.effort_mps2 * (c.traction_load if s.effort_mps2 > 0.0 else c.brake_load)
    share = 1.0
    s.free = 0
    if forced[0] != 0.0:
        s.slip_mps += (max(forced[0], -s.speed_mps) - s.slip_mps) * STEP_S / FORCED_S
        s.slip = -1 if forced[0] < 0.0 else 1
        s.episode, s.sliding, s.free_since_s, s.away_mps = -1, 0, s.time_s, 0.0
    elif s.episode >= 0:
        row = sets[s.episode - len(randoms)] if s.episode >= len(randoms) else randoms[s.episode]
        share = episode_step(state, row, demand, forced[1] * np.sign(demand), c)
    else:
        s.slip = 0
        adhering(state, demand, c.dry_mps2, forced[1] * np.sign(demand), c)
    if s.speed_mps <= 0.0 and forced[0] <= 0.0:
        s.slip_mps, s.slip, s.sliding, s.free = 0.0, 0, 0, 0
    return float(s.effort_mps2 * share)


@kernel
def roll_on(state: Any, before_mps: float) -> None:  # noqa: ANN401 - a numpy record
    """Take the wheel along with the train, which has moved since, unless it turns freely; count its way."""
    s = state[0]
    if s.free == 0:
        s.wheel_mps = max(s.speed_mps + s.slip_mps, 0.0)
    s.wheel_way_m += (before_mps + s.wheel_mps) / 2.0 * STEP_S


@kernel
def tell_slip(state: Any) -> None:  # noqa: ANN401 - a numpy record
    """What the truth says: -1 slide, +1 spin, while adhesion is exceeded or the rim is off by as much."""
    s = state[0]
    off_mps = s.wheel_mps - s.speed_mps
    share = 1.0 if s.told == 0 else 0.5
    off = abs(off_mps) > share * max(SLIPPING_MPS, SLIPPING_SHARE * s.speed_mps)
    if s.slip != 0:
        s.told = s.slip
    elif not off:
        s.told = 0
    elif s.told == 0:
        s.told = 1 if off_mps > 0.0 else -1
