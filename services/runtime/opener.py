"""From a sample to a decoded arrival: topic, sender's mark, sequence, message."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from schemas.codec import MAX_MESSAGE_BYTES, DecodeError, decode, decoder_of
from schemas.message import Message
from schemas.topic import Address, Delivery, TopicTable
from services.runtime.attachment import UNMARKED, Attachment, decode_attachment
from services.runtime.health import HealthBoard, Input
from services.runtime.node import Arrival, Sample
from services.runtime.sequence import Mark

MAX_ROUTES = 65_536
_UNDECODABLE = (msgspec.MsgspecError, ValueError, TypeError, OverflowError, RecursionError)


@dataclass(slots=True)
class _Route:
    """What is known of a key after its first sample."""

    address: Address
    decode: Callable[[bytes], Message]
    source: str = ""
    """Who spoke last on this key, …"""
    entry: Input | None = None
    """… and how that sender is followed."""


def arrival_of(message: Message, sample: Sample, sent: Attachment, address: Address) -> Arrival[Message]:
    """Message with everything that is known of how it came."""
    return Arrival(
        message,
        sample.key,
        address.place,
        address.fields,
        sent.source,
        sent.boot_id,
        sent.sequence,
        sent.sent_ns,
        sample.received_ns,
    )


class Opener:
    """Opens the samples of one reader, in order."""

    def __init__(self, table: TopicTable, health: HealthBoard) -> None:
        """Know the topics of `table`; count in `health`."""
        self._table = table
        self._health = health
        self._watch = health.open_reader()
        self._routes: dict[str, _Route] = {}

    def close(self) -> None:
        """Note that nothing more will come."""
        self._watch.closed = True

    def open(self, sample: Sample, now_s: float) -> tuple[Message, Attachment, Address] | None:
        """Message, sender's mark and address; None for what is refused or a repetition, which is counted.

        `now_s` is monotonic.
        """
        key = sample.key
        route = self._routes.get(key) or self._find(key)
        if route is None:
            self._health.refuse(f"no topic has the key {key}", now_s)
            return None
        sent = decode_attachment(sample.attachment) if sample.attachment else None
        if sent is None:
            sent = UNMARKED
        elif not self._is_new(route, sample, sent, now_s):
            return None
        payload = sample.payload
        if len(payload) > MAX_MESSAGE_BYTES:
            self._refuse(route, sample, sent, now_s)
            return None
        try:
            message = route.decode(payload)
        except _UNDECODABLE:
            self._refuse(route, sample, sent, now_s)
            return None
        self._health.received += 1
        return message, sent, route.address

    def _is_new(self, route: _Route, sample: Sample, sent: Attachment, now_s: float) -> bool:
        """Follow the sender's numbers; False for a repetition."""
        key = sample.key
        if sent.source != route.source or route.entry is None:
            route.source, route.entry = sent.source, self._watch.follow(key, sent.source)
        entry = route.entry
        if entry is None:
            self._watch.count_unfollowed()
            return True
        entry.newest_s = now_s
        entry.delay_ns = sample.received_ns - sent.sent_ns
        tracker = entry.tracker
        if sent.sequence == tracker.newest + 1 and sent.boot_id == tracker.boot_id:
            # What `take` would do, without the call: nearly every arrival is simply the next.
            tracker.newest += 1
            tracker.received += 1
            return True
        missing = tracker.missing
        mark = tracker.take(sent.boot_id, sent.sequence)
        if mark is Mark.NEXT or (mark is Mark.GAP and route.address.topic.delivery is Delivery.STATE):
            return True  # a state that was skipped had been replaced: no loss, though it is counted
        return self._watch.judge(mark, key, sent, tracker.missing - missing, now_s)

    def _find(self, key: str) -> _Route | None:
        address = self._table.find(key)
        if address is None:
            return None
        if len(self._routes) >= MAX_ROUTES:
            self._routes.clear()
        route = self._routes[key] = _Route(address, decoder_of(address.topic.message).decode)
        return route

    def _refuse(self, route: _Route, sample: Sample, sent: Attachment, now_s: float) -> None:
        """Count a sample that its topic's decoder does not take, with the codec's own words."""
        try:
            decode(route.address.topic.message, sample.payload)
        except DecodeError as error:
            self._health.refuse(f"{sample.key} from {sent.source or 'an unknown sender'}: {error}", now_s)
