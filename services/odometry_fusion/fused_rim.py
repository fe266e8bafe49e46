"""What the wheel's rim tells by itself: how hard it speeds up or slows down, and what that gives away."""

from __future__ import annotations

from typing import Final

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_layout import Record

FAST_S: Final = 0.3
WILD_MPS2: Final = 2.0
"""No train speeds up or brakes so hard in service: a rim that does slips."""
HARDEST_MPS2: Final = 1.4
"""Nor harder than this for longer (the wheel mode's limit)."""


@kernel
def watch_rim(now: Record, dt_s: float) -> None:
    """Take in the rim's speed of a tick: when it was last wild, and by how much it is ahead of what a train can do."""
    wild = abs(now.rim_mps - now.fast_rim_mps) > WILD_MPS2 * FAST_S
    now.fast_rim_mps += dt_s / FAST_S * (now.rim_mps - now.fast_rim_mps)
    if wild:
        now.wild_tick = now.tick
    most_mps = HARDEST_MPS2 * dt_s
    now.train_mps += min(most_mps, max(-most_mps, now.rim_mps - now.train_mps))


@kernel
def begin_rim(now: Record) -> None:
    """Begin with the rim's speed as it is."""
    now.fast_rim_mps = now.train_mps = now.rim_mps
