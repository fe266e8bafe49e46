"""A guest on the bus: topics as a service has them, and nothing that runs by itself.

Whoever opens its node does its work: a command whose arguments no configuration carries, a benchmark, a test.
"""

from __future__ import annotations

from typing import TypeAlias

from msgspec import Struct

from schemas.message import Message
from schemas.topic import Query, Topic
from services.runtime.node import Node, Service

Guest: TypeAlias = Service[Struct]


async def _driven_from_outside(node: Node, config: Struct) -> None:
    del node, config


def guest(
    name: str,
    about: str,
    *,
    reads: tuple[Topic[Message], ...] = (),
    writes: tuple[Topic[Message], ...] = (),
    answers: tuple[Query[Message, Message], ...] = (),
    asks: tuple[Query[Message, Message], ...] = (),
    mirrors: bool = False,
) -> Guest:
    """A service that whoever opens its node drives; it has nothing to set."""
    return Service(name, Struct, reads, writes, _driven_from_outside, about, answers, asks, mirrors)
