"""From a sample to a decoded arrival: topic, sender's mark, sequence, message."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from schemas.codec import MAX_MESSAGE_BYTES, DecodeError, decode, decoder_of
from schemas.message import Message
from schemas.topics import Address, TopicTable
from services.runtime.attachment import Attachment, decode_attachment
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


class Opener:
    """Opens the samples of one reader, in order."""

    def __init__(self, table: TopicTable, health: HealthBoard) -> None:
        """Know the topics of `table`; count in `health`."""
        self._table = table
        self._health = health
        self._watch = health.open_reader()
        self._routes: dict[str, _Route] = {}

    def open(self, sample: Sample, now_s: float) -> Arrival[Message] | None:
        """Arrival; None when it is refused or a repetition, which is counted. `now_s` is monotonic."""
        key = sample.key
        route = self._routes.get(key) or self._find(key)
        if route is None:
            self._health.refuse(f"no topic has the key {key}", now_s)
            return None
        sent = decode_attachment(sample.attachment)
        if sent is not None and not self._is_new(route, sample, sent, now_s):
            return None
        message = self._decode(route, sample, now_s)
        if message is None:
            return None
        self._health.received += 1
        address = route.address
        if sent is None:
            return Arrival(message, key, address.place, address.fields, "", "", -1, 0, sample.received_ns)
        return Arrival(
            message,
            key,
            address.place,
            address.fields,
            sent.source,
            sent.boot_id,
            sent.sequence,
            sent.sent_ns,
            sample.received_ns,
        )

    def _is_new(self, route: _Route, sample: Sample, sent: Attachment, now_s: float) -> bool:
        """Follow the sender's numbers; False for a repetition."""
        key = sample.key
        if sent.source != route.source:
            route.source, route.entry = sent.source, self._watch.follow(key, sent.source)
        entry = route.entry
        if entry is None:
            self._watch.count_unfollowed()
            return True
        entry.newest_s = now_s
        entry.delay_ns = sample.received_ns - sent.sent_ns
        tracker = entry.tracker
        missing = tracker.missing
        mark = tracker.take(sent.boot_id, sent.sequence)
        return mark is Mark.NEXT or self._watch.judge(mark, key, sent, tracker.missing - missing, now_s)

    def _find(self, key: str) -> _Route | None:
        address = self._table.find(key)
        if address is None:
            return None
        if len(self._routes) >= MAX_ROUTES:
            self._routes.clear()
        route = _Route(address, decoder_of(address.topic.message).decode)
        self._routes[key] = route
        return route

    def _decode(self, route: _Route, sample: Sample, now_s: float) -> Message | None:
        payload = sample.payload
        try:
            if len(payload) <= MAX_MESSAGE_BYTES:
                return route.decode(payload)
        except _UNDECODABLE:
            pass
        try:
            return decode(route.address.topic.message, payload)
        except DecodeError as error:
            sent = decode_attachment(sample.attachment)
            sender = sent.source if sent is not None else "an unknown sender"
            self._health.refuse(f"{sample.key} from {sender}: {error}", now_s)
            return None
