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
SLIDING_MPS2: Final = 0.2
"""A train whose wheels slip may change its speed as little as this."""
TAME_TICKS: Final = 50
TURNING_MPS: Final = 1.0
"""A rim that was wild is believed again once it has turned calmly for so long; a locked wheel is calm, too."""


@kernel
def watch_rim(now: Record, dt_s: float) -> None:
    """Take in the rim's speed of a tick: when it was last wild, and by how much it is ahead of what a train can do."""
    wild = abs(now.rim_mps - now.fast_rim_mps) > WILD_MPS2 * FAST_S
    now.fast_rim_mps += dt_s / FAST_S * (now.rim_mps - now.fast_rim_mps)
    if wild:
        now.wild_tick, now.broken = now.tick, 1
    elif now.broken and now.tick - now.wild_tick > TAME_TICKS and abs(now.rim_mps) > TURNING_MPS:
        now.broken, now.train_mps = 0, now.rim_mps
    most_mps = (SLIDING_MPS2 if now.broken else HARDEST_MPS2) * dt_s
    now.train_mps += min(most_mps, max(-most_mps, now.rim_mps - now.train_mps))


@kernel
def begin_rim(now: Record) -> None:
    """Begin with the rim's speed as it is."""
    now.fast_rim_mps = now.train_mps = now.rim_mps
