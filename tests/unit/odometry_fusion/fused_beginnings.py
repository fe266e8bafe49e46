"""A tick and accounts of the wheels to begin with."""

from __future__ import annotations

import numpy as np

from services.odometry_fusion.fused_layout import BRANCH, NOW, ROOM, SIZE, Branches
from services.odometry_fusion.fused_origin import begin_branches, begin_now
from services.odometry_fusion.tick_layout import TICK, Records


def tick_of(**values: float) -> Records:
    tick = np.zeros(1, TICK)
    for name, value in values.items():
        tick[name] = value
    return tick


def fresh(speed_mps: float = 10.0) -> tuple[Branches, Records]:
    now = np.zeros(1, NOW)
    begin_now(now[0])
    branches = Branches(np.zeros((ROOM, SIZE)), np.zeros((ROOM, SIZE, SIZE)), np.zeros(ROOM, BRANCH))
    begin_branches(branches, now[0], 0.0, 0.0, speed_mps)
    return branches, now
