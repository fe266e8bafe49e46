"""Accounts of what the wheels do, side by side: begun, ended, weighed, and the unlikely ones dropped.

A jump Markov system: every account is a filter of its own with the likelihood of all that it has been shown. From
the best adhering one a slip is tried anew every TRY_TICKS, so that start points of every age are at hand when a slip
shows (the anchors 2, 4, 7 s … back, and the several start points that Iwata et al., section 4.3.1, propose); going
over to one of them is the roll-back. Every slipping account keeps trying to end: its slip speed must then be about
nought (re-adhesion), or, at a price that falls with the time since the inertial speed was last held by a wheel, the
wheel's speed is taken over against the inertial one. The adhering account is never dropped either. A wrong slip
therefore ends by the weight of evidence, whatever the inertial solution has drifted to meanwhile.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_branch import correct
from services.odometry_fusion.fused_layout import (
    ADHERING,
    BRANCHES,
    GRAVITY_MPS2,
    SIZE,
    SLIPPING,
    TH,
    Branches,
    Covariance,
    D,
    Record,
    U,
    V,
    W,
)
from services.odometry_fusion.motion_log import Counts

TRY_TICKS: Final = 3
BEGIN_LOG: Final = -8.5
"""A slip begins in any 0.3 s: once in about 25 minutes, in logarithm. Rarer than slips are: one must be seen."""
END_LOG: Final = -2.0
SHORTEST_SLIP_TICKS: Final = 12
FREE_LOG: Final = -72.0
"""Price of taking the wheel's speed over against the inertial one, less 1 per second of slip, at least LEAST_FREE."""
LEAST_FREE: Final = -22.0
FREE_SIGMA: Final = (0.3, 0.08)
"""Inertial speed's error beside its own account of it: m/s, and m/s per second of slip."""
FREE_TILT_RAD: Final = 0.01
CREPT_LOG: Final = -4.0
"""Price of an end whose slip began out of micro-slip that had been taken for adhesion."""
CREPT_MPS: Final = 0.12
CREPT_TILT_RAD: Final = 0.002
"""By how much speed and attitude are off then (one sigma): a wheel that creeps away ever faster looks like a train
on a gradient."""
FIRST_WALK: Final = 0.15**2
FIRST_SLIP_MPS: Final = 0.05
END_SLIP_MPS: Final = 0.08
"""Slip speed at the very beginning and end of a slip."""
LOOSE_VAR: Final = 0.4**2
"""An inertial speed that is known less well says nothing of whether a slip has ended."""
LEAST_MPS: Final = 0.8
"""Slower, neither train nor wheel, no slip begins."""
KNOWN_SPEED_VAR: Final = 0.2**2
"""An account that knows its speed less well than this, at the very beginning, begins no slips."""
EFFORT_MPS2: Final = 0.3
"""So much effort has a direction, whatever gradient of the mounting or bias is in it; half of it none."""
AGAINST_LOG: Final = -10.0
"""Brakes make wheels slide, and traction makes them spin. What an account loses that began the other way round:
enough where a slip that was not seen has just ended, far less than a slip of 1 m/s shows in a second."""
WORST_LOG: Final = -40.0
ALIKE: Final = (0.1, 0.004, 0.5)
"""Adhering accounts that have come so close in speed, attitude and distance are one and the same."""
ALIKE_TICKS: Final = 30
AGES: Final = (10, 20, 35, 60, 100)
"""Of every mode the best account of each age (in ticks) is kept."""
GROUPS: Final = 2 * (len(AGES) + 1)


@kernel
def copy_branch(branches: Branches, source: int, target: int) -> None:
    """Let one account be another's equal."""
    branches.x[target] = branches.x[source]
    branches.p[target] = branches.p[source]
    branches.about[target] = branches.about[source]


@kernel
def begin_slip(branches: Branches, source: int, target: int, tick: int, effort_mps2: float) -> None:
    """The account that wheels which adhered so far slip from now on, under an effort (0: not known)."""
    copy_branch(branches, source, target)
    own, x = branches.about[target], branches.x[target]
    own.mode, own.since, own.slip_since = SLIPPING, tick, tick
    own.log_weight += BEGIN_LOG
    if own.free:
        own.doubt_m += abs((x[D] - own.slip_d_m) - (x[W] - own.slip_w_m))
    own.walk, own.top_mps, own.free, own.first, own.tame = FIRST_WALK, 0.0, 0, 0, 0
    own.shown = 0
    own.slip_d_m, own.slip_w_m = x[D], x[W]
    own.effort_mps2, own.loose_var = effort_mps2, 0.0
    branches.p[target, U, U] += FIRST_SLIP_MPS**2


@kernel
def against_effort(slip_mps: float, effort_mps2: float) -> float:
    """What an account loses whose slip began against the effort at the wheels, in logarithm."""
    if slip_mps * effort_mps2 >= 0.0:
        return 0.0
    return float(AGAINST_LOG * min(1.0, max(0.0, 2.0 * abs(effort_mps2) / EFFORT_MPS2 - 1.0)))


@kernel
def turned_over(slip_mps: float, first_mps2: float, effort_mps2: float) -> float:
    """What an account loses whose slip has come back beyond nought, in logarithm.

    A wheel that slid spins only if the effort has turned over, too: from `first_mps2` to `effort_mps2`.
    """
    if slip_mps * effort_mps2 > 0.0 and abs(effort_mps2) > 0.5 * EFFORT_MPS2:
        return 0.0
    return min(against_effort(slip_mps, first_mps2), against_effort(slip_mps, effort_mps2))


@kernel
def end_slip(branches: Branches, source: int, target: int, tick: int, creep_var: float) -> None:
    """The account that the wheels adhere again: the slip speed has come down to nought.

    The chance to end at slip speed U goes with exp(-U²/2w²): its mean over the account's own distribution of U is
    the price.
    """
    if source != target:
        copy_branch(branches, source, target)
    own = branches.about[target]
    if own.loose_var > LOOSE_VAR:
        own.free = 1
    variance = END_SLIP_MPS**2 + creep_var
    spread = branches.p[target, U, U] + variance
    slip_mps = branches.x[target, U]
    own.log_weight += END_LOG + 0.5 * np.log(variance / spread) - 0.5 * slip_mps * slip_mps / spread
    correct(branches.x[target], branches.p[target], U, -slip_mps, variance)
    own.mode, own.since, own.first = ADHERING, tick, 0


@kernel
def take_over(branches: Branches, source: int, target: int, tick: int, dt_s: float, creep_var: float) -> None:
    """The account that the wheels adhere and the inertial solution has been wrong: the supervised exit."""
    copy_branch(branches, source, target)
    own, p = branches.about[target], branches.p[target]
    slip_s = (tick - own.since) * dt_s
    loose = (FREE_SIGMA[0] + FREE_SIGMA[1] * slip_s) ** 2
    # Speed and slip speed err against each other: their sum is the wheel's.
    p[V, V] += loose
    p[U, U] += loose
    p[V, U] -= loose
    p[U, V] -= loose
    p[TH, TH] += FREE_TILT_RAD**2
    own.log_weight += min(LEAST_FREE, FREE_LOG + slip_s)
    own.free = 1
    end_slip(branches, target, target, tick, creep_var)


@kernel
def end_crept(branches: Branches, source: int, target: int, now: Record, dt_s: float) -> None:
    """The account that the wheels adhere again, after a slip that began within micro-slip.

    The start point was none (Iwata et al., section 4.3.1): the wheel was off by then already, and the attitude by what
    its creeping away made of the gradient. From the start on both have added to speed and distance; the rim's way
    stays, for the slip speed took what they added. It confirms the inertial speed less than an end that needs no such
    excuse: only where the rim has done what no train could it is sure that there was a slip at all.
    """
    copy_branch(branches, source, target)
    own = branches.about[target]
    slip_s = (now.tick - own.since) * dt_s
    if now.wild_tick < own.slip_since or own.tame:
        own.free = 1
    for sigma, speed, way_m, tilt in (
        (np.sqrt(CREPT_MPS**2 + now.creep_var), 1.0, slip_s, 0.0),
        (CREPT_TILT_RAD, -GRAVITY_MPS2 * slip_s, -0.5 * GRAVITY_MPS2 * slip_s * slip_s, 1.0),
    ):
        _loosen(branches.p[target], sigma * speed, sigma * way_m, sigma * tilt)
    own.log_weight += CREPT_LOG
    end_slip(branches, target, target, now.tick, now.creep_var)


@kernel
def _loosen(p: Covariance, speed: float, way_m: float, tilt: float) -> None:
    """Add what one unknown error of these sizes in V (and -U), D and TH adds."""
    apart = np.zeros(SIZE)
    apart[V], apart[U], apart[D], apart[TH] = speed, -speed, way_m, tilt
    for i in range(SIZE):
        for j in range(SIZE):
            p[i, j] += apart[i] * apart[j]


@kernel
def branch_out(branches: Branches, now: Record, begins: bool, dt_s: float) -> None:  # noqa: FBT001 - a kernel takes its arguments by place
    """Try slips that begin (if `begins`) and slips that end, from the accounts at hand."""
    count, tick = now.branches, now.tick
    adhering, slipping = -1, -1
    for i in range(count):
        own = branches.about[i]
        if own.mode == ADHERING:
            if adhering < 0 or own.log_weight > branches.about[adhering].log_weight:
                adhering = i
        elif tick - own.since >= SHORTEST_SLIP_TICKS and (
            slipping < 0 or own.log_weight > branches.about[slipping].log_weight
        ):
            slipping = i
    target = count
    known = adhering >= 0 and branches.p[adhering, V, V] < KNOWN_SPEED_VAR
    if known and begins and max(abs(now.rim_mps), abs(branches.x[adhering, V])) > LEAST_MPS:
        begin_slip(branches, adhering, target, tick, now.effort_mps2 if now.proven else 0.0)
        target += 1
    for i in range(count):
        own = branches.about[i]
        if own.mode == SLIPPING and tick - own.since >= SHORTEST_SLIP_TICKS:
            end_slip(branches, i, target, tick, now.creep_var)
            target += 1
    if slipping >= 0:
        end_crept(branches, slipping, target, now, dt_s)
        target += 1
        take_over(branches, slipping, target, tick, dt_s, now.creep_var)
        target += 1
    now.branches = target


@kernel
def _alike(branches: Branches, one: int, other: int, tick: int) -> bool:
    a, b = branches.about[one], branches.about[other]
    if a.mode != ADHERING or b.mode != ADHERING or tick - max(a.since, b.since) <= ALIKE_TICKS:
        return False
    apart = np.abs(branches.x[one] - branches.x[other])
    return bool(apart[V] < ALIKE[0] and apart[TH] < ALIKE[1] and apart[D] < ALIKE[2])


@kernel
def _drop(branches: Branches, gone: int, count: int) -> int:
    if gone != count - 1:
        copy_branch(branches, count - 1, gone)
    return count - 1


@kernel
def _bests(branches: Branches, count: int, tick: int) -> Counts:
    """The best account of every mode and age, -1 where there is none."""
    bests = np.full(GROUPS, -1, np.int64)
    for i in range(count):
        own = branches.about[i]
        group = 0
        while group < len(AGES) and tick - own.since >= AGES[group]:
            group += 1
        if own.mode == ADHERING:
            group += len(AGES) + 1
        if bests[group] < 0 or own.log_weight > branches.about[bests[group]].log_weight:
            bests[group] = i
    return bests


@kernel
def _unite(branches: Branches, count: int, tick: int) -> int:
    """Drop the less likely of accounts that are alike."""
    i = 0
    while i < count:
        j = i + 1
        while j < count:
            if not _alike(branches, i, j, tick):
                j += 1
                continue
            if branches.about[j].log_weight > branches.about[i].log_weight:
                copy_branch(branches, j, i)
            count = _drop(branches, j, count)
        i += 1
    return count


@kernel
def prune(branches: Branches, now: Record) -> None:
    """Weigh against the best; unite the alike, drop the hopeless, and the worst while there are too many."""
    count, about, tick = now.branches, branches.about, now.tick
    best = -np.inf
    for i in range(count):
        best = max(best, about[i].log_weight)
    for i in range(count):
        about[i].log_weight -= best
    count = _unite(branches, count, tick)
    for i in range(count - 1, -1, -1):
        if about[i].log_weight < WORST_LOG:
            count = _drop(branches, i, count)
    while count > BRANCHES:
        bests = _bests(branches, count, tick)
        worst = -1
        for i in range(count):
            if (bests != i).all() and (worst < 0 or about[i].log_weight < about[worst].log_weight):
                worst = i
        count = _drop(branches, max(worst, 0), count)
    now.branches = count


@kernel
def slip_share(branches: Branches, now: Record) -> float:
    """Probability that the wheels slip; the believed account into `now.best`."""
    best = 0
    for i in range(now.branches):
        if branches.about[i].log_weight > branches.about[best].log_weight:
            best = i
    now.best = best
    adhering = slipping = 0.0
    for i in range(now.branches):
        weight = np.exp(branches.about[i].log_weight - branches.about[best].log_weight)
        if branches.about[i].mode == ADHERING:
            adhering += weight
        else:
            slipping += weight
    return slipping / (adhering + slipping)
