"""What the odometry is told of the wheel's scale."""

from __future__ import annotations

from typing import Final

from schemas.message import Message
from schemas.motion import WheelScale
from services.train_position.held import Held

LEAST_UNKNOWN: Final = 0.01
"""Standard deviation of wheels of which nothing is known, at least: with it the odometry vouches for wear again."""


def learned_scale(held: Held, t_ns: int, reason: str) -> list[Message]:
    """The scale as references have told it so far; nothing while they have not."""
    known = held.scale.told()
    if known is None:
        return []
    scale, sigma = known
    return [WheelScale(t_ns=t_ns, scale=scale, sigma=sigma, references=held.scale.stretches, reason=reason)]


def unknown_scale(held: Held, t_ns: int, reason: str) -> list[Message]:
    """Wheels of which nothing is known any more."""
    sigma = max(held.config.turned_share / 3.0, LEAST_UNKNOWN)
    return [WheelScale(t_ns=t_ns, scale=1.0, sigma=sigma, references=0, reason=reason)]
