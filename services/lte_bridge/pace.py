"""How much to send at once, how long to wait for the answer, and when to try again."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

from services.lte_bridge.lane import LANES, Lane
from services.lte_bridge.settings import Settings

FIRST_BATCH_BYTES = 8 * 1024
LEAST_BATCH_BYTES = 2 * 1024
MOST_BATCH_BYTES = 512 * 1024
GROWTH = 2.0
"""A batch is at most this many times the one before, so that one lucky answer does not fill a slow link."""
MOST_TIMEOUT_S = 20.0
"""After an outage an attempt that was swallowed by it may hold its lane up for so long."""


@dataclass(slots=True)
class Pace:
    """Size of batches, time-outs and back-off of one lane.

    A batch is sized from how long the last ones took from being sent to being acknowledged, so
    that each takes about `aim_s`, whatever the link gives. An answer that does not come in
    time shrinks the batch to a quarter and doubles the patience, up to twenty seconds: a link of a
    few kbit/s or of many seconds' delay gets through in the end. Between vain attempts passes `first_wait_s`,
    doubled each time up to `most_wait_s`, and of that a random half to whole (so that a fleet
    that lost its cloud together does not come back together).
    """

    aim_s: float
    timeout_s: float
    first_wait_s: float
    most_wait_s: float
    rng: random.Random
    batch_bytes: int = FIRST_BATCH_BYTES
    failures: int = 0
    """In a row."""
    patience_s: float = field(init=False)
    """How long the next answer is waited for."""

    def __post_init__(self) -> None:
        """Begin with the configured patience."""
        self.patience_s = self.timeout_s

    def acknowledged(self, sent_bytes: int, took_s: float) -> None:
        """Learn from a batch that was answered in `took_s`."""
        self.failures = 0
        self.patience_s = max(self.timeout_s, min(self.patience_s, 4.0 * took_s))
        wanted = sent_bytes * self.aim_s / max(took_s, 1e-3)
        if wanted > self.batch_bytes and sent_bytes < self.batch_bytes / GROWTH:
            return  # a small batch tells nothing about large ones
        bounded = min(max(wanted, self.batch_bytes / GROWTH), self.batch_bytes * GROWTH)
        self.batch_bytes = round(min(max(bounded, LEAST_BATCH_BYTES), MOST_BATCH_BYTES))

    def unanswered(self, took_s: float) -> float:
        """How long to wait before the next attempt [s], after one that ended without answer in `took_s`."""
        if took_s >= self.patience_s:  # sooner: nobody was there, which says nothing about size and patience
            self.batch_bytes = max(LEAST_BATCH_BYTES, self.batch_bytes // 4)
            self.patience_s = max(self.timeout_s, min(MOST_TIMEOUT_S, 2.0 * self.patience_s))
        return self.refused()

    def refused(self) -> float:
        """How long to wait before the next attempt [s], after a refusal: size and patience were right."""
        whole_s = min(self.most_wait_s, self.first_wait_s * 2.0 ** min(self.failures, 30))
        self.failures += 1
        return whole_s * (0.5 + 0.5 * self.rng.random())


@dataclass(slots=True)
class Meter:
    """Keeps what is sent below a rate. A batch may go when all before are paid for."""

    bits_per_s: float | None
    _free_at_s: float = 0.0

    def wait_s(self, now_s: float) -> float:
        """How long the next batch has to wait [s]."""
        return max(0.0, self._free_at_s - now_s)

    def sent(self, size: int, now_s: float) -> None:
        """Count a batch of `size` bytes that goes now."""
        if self.bits_per_s is not None:
            self._free_at_s = max(self._free_at_s, now_s) + 8.0 * size / self.bits_per_s

    def most_bytes(self, aim_s: float) -> int:
        """Bytes that take `aim_s` at this rate: more would hold up events."""
        return MOST_BATCH_BYTES if self.bits_per_s is None else max(1, round(self.bits_per_s * aim_s / 8.0))


def paces(settings: Settings, seed: str) -> dict[Lane, Pace]:
    """A pace for each lane; the same `seed` gives the same pauses."""
    return {
        lane: Pace(
            settings.batch_s,
            settings.answer_timeout_s,
            settings.retry_first_s,
            settings.retry_most_s,
            random.Random(f"{seed} {lane}"),  # noqa: S311 - spreads attempts, keeps no secret
        )
        for lane in LANES
    }
