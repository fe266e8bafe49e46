"""The error that the fused mode vouches for.

    bound = start + share · way + owed + excess + provisional, not above 5 m + 5 % of the way while the status is valid

`provisional`, while the account is not settled (slip, gap, doubt between accounts): FACTOR times what the variance of
the distance has gained since it last was, and how far the accounts that may still be true lie apart. What is left of
it when all is calm again goes into `excess` for good.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_layout import ADHERING, Branches, D, Record, V, W
from services.odometry_fusion.fused_turn import FORWARDS

FACTOR: Final = 4.0
LOOSE_FACTOR: Final = 8.0
"""Likewise, where the inertial speed was hardly known when a slip ended, of a sensor that looks forward."""
LEFT_M: Final = 0.5
"""What every episode leaves beside its variance: the start point is one of several."""
LIKELY_LOG: Final = -7.0
"""Accounts within so much of the best one may be true."""
CALM_TICKS: Final = 20
WILD_BEFORE_TICKS: Final = 10
TAME_S: Final = 8.0
TURNING_MPS: Final = 1.0
BROKEN_LATE_S: Final = 3.0
BROKEN_LATE_M: Final = 1.5
"""A slip that came to so much before the rim did what no train could: that it did does not prove the rest."""
CONTESTED_M: Final = 0.5
CONTESTED_FACTOR: Final = 1.05
"""What was lost before the slip was seen, and wear, beside what wheel and inertial sensor disagree on."""
FIRST_TICKS: Final = 100
FIRST_FACTOR: Final = 3.0
FIRST_WAIT_S: Final = 1.0
"""The accounts begin so late, and are brought over the latency."""
LONG_SLIP_S: Final = 15.0
"""From then on wheel and inertial solution are both vouched for."""
PLAIN_SHARE: Final = 0.02
PLAIN_M: Final = 0.01
"""While all is calm the way follows the wheel to within so much per tick."""
PLAIN_CHANGE_M: Final = 0.3
"""The believed account itself changes by less in a tick."""
ETCS_M: Final = 5.0
ETCS_SHARE: Final = 0.05
"""Accuracy of distance that ETCS asks for (SUBSET-041)."""
UNSEEN_SHARES: Final = (0.1, 0.05)
UNSEEN_M: Final = 20.0
"""Slips that no inertial sensor sees: share of the way, up to so much (Iwata et al., section 3.1.4: 22.8 m), and
beyond it."""


@kernel
def provisional(branches: Branches, now: Record) -> float:
    """What is not settled adds for now [m]."""
    best = branches.x[now.best]
    apart_m = 0.0
    for i in range(now.branches):
        if branches.about[i].log_weight > LIKELY_LOG:
            apart_m = max(apart_m, abs(branches.x[i, D] - best[D]))
    return float(FACTOR * np.sqrt(gained_variance(branches, now)) + apart_m + doubted(branches, now))


@kernel
def contested(branches: Branches, now: Record, dt_s: float) -> float:
    """What wheel and inertial sensor disagree on in a slip while either may be right [m].

    While the rim has done nothing that a train could not, has not for a while, or the slip is a long one.
    """
    own = branches.about[now.best]
    if own.mode == ADHERING:
        return doubted(branches, now)
    apart_m = float(CONTESTED_M + CONTESTED_FACTOR * max(abs(lost_way(branches, now)), own.apart_m))
    if own.facing == FORWARDS:
        return float(own.doubt_m + min(apart_m, _drifted(branches, now, dt_s)))
    tame_s = (now.tick - max(now.wild_tick, own.slip_since)) * dt_s
    known_s = (now.tick - own.since) * dt_s
    never_wild = now.wild_tick < own.slip_since - WILD_BEFORE_TICKS
    long = known_s > LONG_SLIP_S
    broken_late = never_wild and known_s > BROKEN_LATE_S and abs(lost_way(branches, now)) > BROKEN_LATE_M
    if broken_late or (tame_s > TAME_S and abs(now.rim_mps) > TURNING_MPS):
        own.tame = 1
    if long or never_wild or own.tame:
        return float(apart_m + own.doubt_m)
    return float(own.doubt_m)


@kernel
def _drifted(branches: Branches, now: Record, dt_s: float) -> float:
    """How far the inertial way may have drifted in a long slip [m]: the filter's own account is believed ever less."""
    known_s = (now.tick - branches.about[now.best].since) * dt_s
    if known_s < LONG_SLIP_S:
        return 0.0
    return float((known_s / LONG_SLIP_S) ** 2 * FACTOR * np.sqrt(gained_variance(branches, now)))


@kernel
def doubted(branches: Branches, now: Record) -> float:
    """What wheel and inertial sensor disagreed on in slips that ended without either being confirmed [m]."""
    own = branches.about[now.best]
    if not own.free:
        return float(own.doubt_m)
    apart_m = max(abs(lost_way(branches, now)), own.apart_m)
    if own.facing == FORWARDS:
        apart_m = min(apart_m, LOOSE_FACTOR * np.sqrt(gained_variance(branches, now)))
    return float(own.doubt_m + apart_m)


@kernel
def gained_variance(branches: Branches, now: Record) -> float:
    """What the variance of the distance has gained since all was settled [m²]."""
    return float(max(0.0, branches.p[now.best, D, D] - now.settled_var))


@kernel
def unconfirmed(branches: Branches, now: Record) -> float:
    """How far off the way may be because the wheels slipped when all began, as long as they may have [m]."""
    found_m = 0.0
    for i in range(now.branches):
        own = branches.about[i]
        if own.first and (own.log_weight > LIKELY_LOG or now.tick - own.since < FIRST_TICKS):
            apart_m = abs(branches.x[i, D] - branches.x[now.best, D])
            sigma_m = np.sqrt(branches.p[i, D, D]) + np.sqrt(branches.p[i, V, V]) * FIRST_WAIT_S
            found_m = max(found_m, apart_m + FIRST_FACTOR * sigma_m)
    return found_m


@kernel
def lost_way(branches: Branches, now: Record) -> float:
    """Way by the inertial sensor minus way by the wheel, over the believed account's latest slip [m]."""
    best, own = branches.x[now.best], branches.about[now.best]
    return float((best[D] - own.slip_d_m) - (best[W] - own.slip_w_m))


@kernel
def unseen(now: Record, speed_mps: float, dt_s: float) -> float:
    """What slips may have cost in a step in which no inertial sensor could see them [m].

    The rim's own acceleration gives some of them away.
    """
    share = UNSEEN_SHARES[0] if now.gap_m < UNSEEN_M else UNSEEN_SHARES[1]
    more_m = (share * abs(speed_mps) + abs(now.rim_mps - now.train_mps)) * dt_s
    now.gap_m += more_m
    return float(more_m)


@kernel
def settle(branches: Branches, now: Record) -> None:
    """Once all has been calm for a while, take what an episode left into the excess, and the variance as known."""
    if now.calm < CALM_TICKS:
        return
    variance = branches.p[now.best, D, D]
    x = branches.x[now.best]
    rolled_m = x[W] - now.calm_w_m
    if not now.unsettled:
        against_m = abs(x[D] - now.calm_d_m - rolled_m)
        now.excess_m += max(0.0, against_m - PLAIN_SHARE * abs(rolled_m) - PLAIN_M)
    if now.unsettled:
        doubt_m = doubted(branches, now)
        now.excess_m += LEFT_M + FACTOR * np.sqrt(max(0.0, variance - now.settled_var)) + doubt_m
        now.contested_m += doubt_m
        for i in range(now.branches):
            branches.about[i].doubt_m, branches.about[i].free = 0.0, 0
        now.unsettled = 0
    now.settled_var = variance
    now.calm_d_m, now.calm_w_m = branches.x[now.best, D], branches.x[now.best, W]


@kernel
def own_up(branches: Branches, now: Record, dt_s: float) -> None:
    """Own what going over to another account changes of the way beyond what was vouched for."""
    x = branches.x[now.best]
    changed_m = now.scale * abs(x[D] - now.followed_m)
    now.excess_m += max(0.0, changed_m - max(now.vouched_m, PLAIN_CHANGE_M))
    now.followed_m = x[D] + x[V] * dt_s


@kernel
def allowed(way_m: float, distance_m: float) -> float:
    """5 m + 5 % of the way [m], where the way is no more than the distance unless the train turns back."""
    reach_m = abs(distance_m)
    return ETCS_M + ETCS_SHARE * (reach_m if way_m - reach_m < 2.0 * ETCS_M + 0.1 * way_m else way_m)
