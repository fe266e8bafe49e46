"""How publications come in: one Zenoh subscription, one thread, one inbox.

Zenoh's own callbacks take the interpreter's lock once per sample and stall the whole session
when one of them is slow. Instead samples wait in Zenoh's channel, outside Python, and a thread
of ours takes them in batches; it never runs a service's code.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress

import zenoh
from zenoh import ext, handlers

from schemas.codec import MAX_MESSAGE_BYTES
from services.runtime.inbox import Inbox
from services.runtime.node import Sample

CHANNEL_CAPACITY = 1024
"""Samples that wait outside Python before Zenoh stalls the session."""
BATCH = 64
PATIENCE_S = 0.05
"""How long a crowded inbox's reader gets to take its turn before the oldest samples are pushed out."""
TURN_S = 0.001


class Subscription:
    """Samples of one key expression on their way into an inbox."""

    def __init__(
        self,
        session: zenoh.Session,
        expression: str,
        inbox: Inbox,
        now_ns: Callable[[], int],
        *,
        recovers: bool,
        on_miss: Callable[[int], None] | None = None,
    ) -> None:
        """Subscribe at once.

        `recovers`: fetch what advanced publishers keep, now and after a cut. `on_miss` is called,
        on a thread of Zenoh, with the number of publications that are lost for good.
        """
        self._inbox = inbox
        self._now_ns = now_ns
        self._patient = True
        channel: handlers.FifoChannel[zenoh.Sample] = handlers.FifoChannel(CHANNEL_CAPACITY)
        self._undeclare: Callable[[], None]  # the plain or the advanced one's; Zenoh's own carries no types
        if recovers:
            advanced = ext.declare_advanced_subscriber(
                session,
                expression,
                channel,
                history=ext.HistoryConfig(detect_late_publishers=True),
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            )
            if on_miss is not None:
                listener: handlers.Callback[ext.Miss] = handlers.Callback(lambda miss: on_miss(miss.nb), indirect=False)
                self._misses = advanced.sample_miss_listener(listener)
            self._undeclare, self._handler = advanced.undeclare, advanced.handler
        else:
            plain = session.declare_subscriber(expression, channel)
            self._undeclare, self._handler = plain.undeclare, plain.handler
        self._thread = threading.Thread(target=self._pump, name=f"inbox {expression}", daemon=True)
        self._thread.start()

    def close(self, timeout_s: float) -> None:
        """End the subscription and its thread. Blocks: not on the loop."""
        self._end()
        self._thread.join(timeout_s)

    def _end(self) -> None:
        with suppress(zenoh.ZError):  # undeclared already, or the session is closed
            self._undeclare()

    def _pump(self) -> None:
        handler = self._handler
        while not self._inbox.closed:
            batch: list[Sample] = []
            try:
                sample: zenoh.Sample | None = handler.recv()
                while sample is not None:
                    self._unpack(sample, batch)
                    sample = handler.try_recv() if len(batch) < BATCH else None
            except zenoh.ZError:  # undeclared: what was taken before still counts
                self._inbox.put(batch)
                return
            self._inbox.put(batch)
            if self._inbox.crowded:
                self._give_turn()
            else:
                self._patient = True
        self._end()  # nobody reads any more

    def _unpack(self, sample: zenoh.Sample, batch: list[Sample]) -> None:
        payload = sample.payload.to_bytes()
        attachment = sample.attachment
        key = str(sample.key_expr)
        if len(payload) > MAX_MESSAGE_BYTES:
            self._inbox.refuse(f"{key}: {len(payload)} bytes, more than the {MAX_MESSAGE_BYTES} accepted")
            return
        batch.append(Sample(key, payload, b"" if attachment is None else attachment.to_bytes(), self._now_ns()))

    def _give_turn(self) -> None:
        """Let the reader catch up; one that does not within its time is not waited for until it has."""
        left_s = PATIENCE_S if self._patient else 0.0
        while left_s > 0.0 and self._inbox.crowded and not self._inbox.closed:
            time.sleep(TURN_S)
            left_s -= TURN_S
        self._patient = left_s > 0.0
