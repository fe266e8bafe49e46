"""The supervised exit from slips in which wheel and inertial sensor have contradicted each other for long."""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_layout import SLIPPING, Branches, D, Record, U, W
from services.odometry_fusion.fused_origin import begin_again, begin_branches
from services.odometry_fusion.motion_log import PERIOD_S

LONGEST_TAME_S: Final = 25.0
TURNING_MPS: Final = 1.0
APART_SIGMA: Final = 3.0
APART_MPS: Final = 0.5
DISTRUST_S: Final = 30.0
"""After a slip in which the rim ran as smoothly as a train for so long, and so far from the inertial speed, the
inertial sensor is left out for so long. A small slip speed within its sigma contradicts nothing: slow slips
fade so."""


@kernel
def supervise(now: Record, branches: Branches) -> None:
    """End a slip in which the rim has long run as a train does: wheel and inertial sensor contradict each other."""
    own, x = branches.about[now.best], branches.x[now.best]
    if now.distrust_s > 0.0 and (now.distrust_s > PERIOD_S or not now.broken):
        now.distrust_s -= PERIOD_S
        if now.distrust_s <= 0.0:
            now.distrust_s = 0.0
            begin_branches(branches, now, x[D], x[W], now.rim_mps)
            return
    tame_ticks = now.tick - max(own.slip_since, now.wild_tick)
    apart = abs(x[U]) > min(APART_MPS, APART_SIGMA * np.sqrt(branches.p[now.best, U, U]))
    if own.mode == SLIPPING and apart and tame_ticks * PERIOD_S > LONGEST_TAME_S and abs(now.rim_mps) > TURNING_MPS:
        now.distrust_s = DISTRUST_S
        begin_again(now, branches, own.slip_d_m, own.slip_w_m)
