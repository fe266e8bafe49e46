"""Where the accounts of the fused mode begin: at the first count, and anew where all before was wrong."""

from __future__ import annotations

from typing import Final

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_branch import FIRST_SIGMAS, begin_state
from services.odometry_fusion.fused_hypotheses import begin_slip
from services.odometry_fusion.fused_layout import ADHERING, Branches, D, Record, U, V, W
from services.odometry_fusion.fused_rim import begin_rim

FIRST_CREEP: Final = 0.04
"""Micro-slip's standard deviation [m/s]."""
FIRST_QUIET: Final = 0.02
FIRST_SLIP_LOG: Final = -3.0
FIRST_SLIP_S: Final = 4.0
FIRST_SLIP_MPS: Final = 1.5
FIRST_SLIP_SHARE: Final = 0.25
"""The wheels slip when all begins: how likely, for how long in the mean, and by how much (one sigma)."""
NEVER_TICKS: Final = 1_000_000
STILL_MPS: Final = 0.5
"""A wheel that turns faster may slip already."""


@kernel
def begin_now(now: Record) -> None:
    """What is known at the first count."""
    now.scale = 1.0
    now.force_var, now.rate_var = 0.1**2, 1e-3**2
    now.creep_var = FIRST_CREEP**2
    now.agreement, now.quiet = 1.0, FIRST_QUIET
    now.jitter_mps2 = 1.0
    now.best = 0
    now.wild_tick = -NEVER_TICKS


@kernel
def begin_branches(branches: Branches, now: Record, way_m: float, rim_m: float, speed_mps: float) -> None:
    """One account, adhering, of which nothing is known but where the wheel is and how fast it turns.

    And another, if it turns: that it slips already, the train being faster or slower.
    """
    begin_state(branches.x[0], branches.p[0])
    branches.x[0, D], branches.x[0, W] = way_m, rim_m
    branches.x[0, V] = speed_mps
    own = branches.about[0]
    own.mode, own.since, own.slip_since = ADHERING, now.tick, now.tick
    own.log_weight, own.walk, own.top_mps, own.free, own.first = 0.0, 0.0, 0.0, 0, 0
    own.tame, own.shown, own.loose_var = 0, 0, 0.0
    own.doubt_m = 0.0
    now.followed_m = way_m
    own.slip_d_m, own.slip_w_m = way_m, rim_m
    now.branches, now.best, now.settled_var = 1, 0, FIRST_SIGMAS[D] ** 2
    now.calm_d_m, now.calm_w_m = way_m, rim_m
    begin_rim(now)
    if abs(speed_mps) > STILL_MPS:
        begin_slip(branches, 0, 1, now.tick, 0.0)
        branches.about[1].log_weight, branches.about[1].first = FIRST_SLIP_LOG, 1
        variance = max(FIRST_SLIP_MPS, FIRST_SLIP_SHARE * abs(speed_mps)) ** 2
        p = branches.p[1]
        p[V, V] += variance
        p[U, U] += variance
        p[V, U] -= variance
        p[U, V] -= variance
        now.branches = 2


@kernel
def begin_again(now: Record, branches: Branches, way_m: float, rim_m: float) -> None:
    """The inertial sensor was not what it seemed: by the wheel since it was at `rim_m`, and the train at `way_m`.

    What that changes is owned.
    """
    now.proven = 0
    x = branches.x[now.best]
    d_m, w_m = way_m + x[W] - rim_m, x[W]
    now.excess_m += abs(x[D] - d_m)
    now.contested_m += abs(x[D] - d_m)
    begin_branches(branches, now, d_m, w_m, now.rim_mps)
    now.branches = 1
