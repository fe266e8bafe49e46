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
BATCH = 256
PATIENCE_S = 0.05
"""How long a crowded inbox's reader gets to take its turn before the oldest samples are pushed out."""
TURN_S = 0.001
RUSH_S = 0.0005
"""Samples that come closer together than this are gathered …"""
GATHER_S = 0.0002
"""… for this long, so that the loop is woken once for some of them instead of once for each."""
FEW = 8


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
        self._ending = threading.Lock()
        self._ended = False
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

    @property
    def ended(self) -> bool:
        """True once the subscription is gone."""
        return self._ended

    def close(self, timeout_s: float) -> None:
        """End the subscription and its thread. Blocks: not on the loop."""
        self._end()
        self._thread.join(timeout_s)

    def _end(self) -> None:
        with self._ending:  # our own thread may be at it as well, and Zenoh's objects cannot stand that
            if not self._ended:
                self._ended = True
                with suppress(zenoh.ZError):  # the session is closed
                    self._undeclare()

    def _pump(self) -> None:
        handler = self._handler
        last_s = 0.0
        while not self._inbox.closed:
            samples: list[zenoh.Sample] = []
            try:
                sample: zenoh.Sample | None = handler.recv()
                while sample is not None:
                    samples.append(sample)
                    sample = handler.try_recv() if len(samples) < BATCH else None
            except zenoh.ZError:  # undeclared: what was taken before still counts
                self._inbox.put(self._unpack(samples))
                return
            self._inbox.put(self._unpack(samples))
            now_s = time.monotonic()
            if self._inbox.crowded:
                self._give_turn()
            else:
                self._patient = True
                if len(samples) < FEW and now_s - last_s < RUSH_S:
                    time.sleep(GATHER_S)
            last_s = now_s
        self._end()  # nobody reads any more

    def _unpack(self, samples: list[zenoh.Sample]) -> list[Sample]:
        received_ns = self._now_ns()
        return [
            Sample(
                str(sample.key_expr),
                payload.to_bytes(),
                b"" if (attachment := sample.attachment) is None else attachment.to_bytes(),
                received_ns,
            )
            for sample in samples
            if len(payload := sample.payload) <= MAX_MESSAGE_BYTES or self._refuse(sample)
        ]

    def _refuse(self, sample: zenoh.Sample) -> bool:
        size = len(sample.payload)
        self._inbox.refuse(f"{sample.key_expr}: {size} bytes, more than the {MAX_MESSAGE_BYTES} accepted")
        return False

    def _give_turn(self) -> None:
        """Let the reader catch up; one that does not within its time is not waited for until it has."""
        left_s = PATIENCE_S if self._patient else 0.0
        while left_s > 0.0 and self._inbox.crowded and not self._inbox.closed:
            time.sleep(TURN_S)
            left_s -= TURN_S
        self._patient = left_s > 0.0
