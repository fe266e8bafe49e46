"""Which of the two ways to the far end a publication takes: events go before bulk."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

from schemas.message import Message
from schemas.topic import Delivery, Topic
from schemas.topics import ALL, topic_of

Lane = Literal["events", "bulk"]
LANES: tuple[Lane, ...] = ("events", "bulk")
KEPT: tuple[Topic[Message], ...] = tuple(topic for topic in ALL if topic.delivery is Delivery.KEPT)


def lane_of_topic(topic: Topic[Message]) -> Lane:
    """What comes when it comes is an event; what comes at a rate is bulk."""
    return "events" if topic.rate_hz is None else "bulk"


@lru_cache(maxsize=65_536)
def lane_of(key: str) -> Lane | None:
    """Lane of a key; None for one that is not bridged: no KEPT topic has it, or another bridge said it.

    >>> lane_of("kirotei/v1/demo/train/T1/slip"), lane_of("kirotei/v1/demo/mirror/train/T1/slip")
    ('events', None)
    """
    address = topic_of(key)
    if address is None or address.mirrored or address.topic.delivery is not Delivery.KEPT:
        return None
    return lane_of_topic(address.topic)
