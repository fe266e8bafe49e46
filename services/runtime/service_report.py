"""What the runtime tells the bus about a service: health once a second, events as they happen."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from schemas.health import Level, ServiceEvent
from schemas.topics import HEALTH, SERVICE_EVENT
from services.runtime.node import Node

LOOK_S = 0.1
"""How often level and notices are looked at; a change is published within this."""
HEALTH_PERIOD_S = 1.0
EVENT_BURST = 10
EVENT_RATE_HZ = 1.0
TEXT_CHARACTERS = 1000
Kind = Literal["started", "stopping", "failed", "input_gap", "input_restart", "level"]


@dataclass(slots=True)
class EventLimiter:
    """Token bucket: ten events at once, one per second after that; the rest are counted."""

    tokens: float = EVENT_BURST
    suppressed: int = 0
    _last_s: float | None = None

    def admit(self, now_s: float) -> int | None:
        """Number of events suppressed before this one, or None when this one is suppressed too."""
        elapsed_s = 0.0 if self._last_s is None else now_s - self._last_s
        self._last_s = now_s
        self.tokens = min(EVENT_BURST, self.tokens + elapsed_s * EVENT_RATE_HZ)
        if self.tokens < 1.0:
            self.suppressed += 1
            return None
        self.tokens -= 1.0
        before, self.suppressed = self.suppressed, 0
        return before


@dataclass(slots=True)
class ServiceReport:
    """Reports on one node until cancelled."""

    node: Node
    note: Callable[[Kind, str], object] | None = None
    """Told every event that is published by itself, for the log."""
    started: bool = False
    """Changes of level are events only after the start."""
    _limiter: EventLimiter = field(default_factory=EventLimiter)
    _level: Level = "ok"
    _health_s: float = float("-inf")

    async def run(self) -> None:
        """Publish health every second and at every change of level, and notices as events."""
        while True:
            await self.look()
            await asyncio.sleep(LOOK_S)

    async def look(self) -> None:
        """Publish what is due now."""
        board = self.node.health
        now_s = self.node.clock.monotonic_s()
        level, reasons = board.level(now_s)
        changed = level != self._level
        previous, self._level = self._level, level
        if changed or now_s - self._health_s >= HEALTH_PERIOD_S - LOOK_S / 2:
            self._health_s = now_s
            await self.node.publish(HEALTH, board.report(self.node.clock.now_ns(), now_s), service=self.node.instance)
        for kind, text in board.take_notices():
            await self._limited("input_restart" if kind == "input_restart" else "input_gap", text)
        if changed and self.started:
            await self._limited("level", f"{previous} -> {level}: {'; '.join(reasons) or 'all is well'}")

    async def event(self, kind: Kind, text: str) -> None:
        """Publish an event, however many there were."""
        event = ServiceEvent(
            t_ns=self.node.clock.now_ns(),
            service=self.node.instance,
            boot_id=self.node.health.boot_id,
            kind=kind,
            text=text if len(text) <= TEXT_CHARACTERS else f"{text[:TEXT_CHARACTERS]}…",
        )
        await self.node.publish(SERVICE_EVENT, event, service=self.node.instance)

    async def _limited(self, kind: Kind, text: str) -> None:
        suppressed = self._limiter.admit(self.node.clock.monotonic_s())
        if suppressed is None:
            return
        told = f"{text} ({suppressed} events before this one left out)" if suppressed else text
        if self.note is not None:
            self.note(kind, told)
        await self.event(kind, told)
