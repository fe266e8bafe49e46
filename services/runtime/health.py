"""What a service knows of its own condition, and the verdict that follows from it."""

from __future__ import annotations

from dataclasses import dataclass, field

from schemas.health import Health, InputHealth, Level
from services.runtime.sequence import Mark, SequenceTracker

MAX_INPUTS = 256
TROUBLE_SHOWN_S = 10.0
"""A gap, a restart or a drop colours the level this long after it happened."""


@dataclass(slots=True)
class _Input:
    tracker: SequenceTracker = field(default_factory=SequenceTracker)
    newest_s: float = 0.0
    delay_s: float = 0.0


@dataclass(slots=True)
class HealthBoard:
    """Collects counts and reasons; `report` makes the message of them.

    Reasons set by the service stay until it clears them; what the runtime sees at its inputs
    (gaps, restarts, drops, refusals) colours the level for ten seconds. Times are monotonic.
    """

    service: str
    boot_id: str
    started_s: float
    published: int = 0
    received: int = 0
    dropped: int = 0
    refused: int = 0
    counts: dict[str, int] = field(default_factory=dict)
    overflow_inputs: int = 0
    _inputs: dict[tuple[str, str], _Input] = field(default_factory=dict)
    _reasons: dict[str, tuple[Level, str]] = field(default_factory=dict)
    _trouble: dict[str, tuple[float, str]] = field(default_factory=dict)
    _notices: list[tuple[str, str]] = field(default_factory=list)

    def count(self, name: str, amount: int = 1) -> None:
        """Add to one of the service's own counters."""
        self.counts[name] = self.counts.get(name, 0) + amount

    def set(self, name: str, reason: str, level: Level = "degraded") -> None:
        """Give a reason, in words, why the service is not well; `name` is for clearing it."""
        self._reasons[name] = (level, reason)

    def clear(self, name: str) -> None:
        """Take a reason back."""
        self._reasons.pop(name, None)

    def trouble(self, name: str, reason: str, now_s: float) -> None:
        """Note something that has happened and is over; it colours the level for a while."""
        self._trouble[name] = (now_s, reason)

    def note_arrival(self, key: str, source: str, boot_id: str, sequence: int, delay_s: float, now_s: float) -> Mark:
        """Follow one arrival's sequence number; gaps and restarts become trouble and notices."""
        entry = self._inputs.get((key, source))
        if entry is None:
            if len(self._inputs) >= MAX_INPUTS:
                self.overflow_inputs += 1
                return Mark.FIRST
            entry = self._inputs[key, source] = _Input()
        newest = entry.tracker.newest
        mark = entry.tracker.take(boot_id, sequence)
        entry.newest_s, entry.delay_s = now_s, delay_s
        if mark is Mark.NEXT or mark is Mark.FIRST or mark is Mark.DUPLICATE:
            return mark
        if mark is Mark.GAP:
            text = f"{sequence - newest - 1} missing on {key} from {source} (after number {newest})"
            self._notices.append(("input_gap", text))
        elif mark is Mark.RESTART:
            text = f"{source} restarted (now {boot_id}) on {key}"
            self._notices.append(("input_restart", text))
        else:
            text = f"two senders share the identity {source} on {key}"
        self.trouble(f"{mark.value}:{key}:{source}", text, now_s)
        return mark

    def take_notices(self) -> list[tuple[str, str]]:
        """Gaps and restarts seen since the last call, as (kind, text)."""
        notices, self._notices = self._notices, []
        return notices

    def level(self, now_s: float) -> tuple[Level, tuple[str, ...]]:
        """Level now, and the reasons for it in words."""
        for name, (since_s, _) in list(self._trouble.items()):
            if now_s - since_s > TROUBLE_SHOWN_S:
                del self._trouble[name]
        reasons = [text for _, text in self._reasons.values()] + [text for _, text in self._trouble.values()]
        if any(level == "failed" for level, _ in self._reasons.values()):
            return "failed", tuple(reasons)
        return ("degraded" if reasons else "ok"), tuple(reasons)

    def report(self, t_ns: int, now_s: float) -> Health:
        """Health message of this moment."""
        level, reasons = self.level(now_s)
        return Health(
            t_ns=t_ns,
            service=self.service,
            boot_id=self.boot_id,
            level=level,
            reasons=reasons,
            uptime_s=now_s - self.started_s,
            published=self.published,
            received=self.received,
            dropped=self.dropped,
            refused=self.refused,
            counts=dict(self.counts),
            inputs=tuple(
                InputHealth(
                    key=key,
                    source=source,
                    received=entry.tracker.received,
                    missing=entry.tracker.missing,
                    duplicated=entry.tracker.duplicated,
                    restarts=entry.tracker.restarts,
                    age_s=now_s - entry.newest_s,
                    delay_s=entry.delay_s,
                )
                for (key, source), entry in self._inputs.items()
            ),
        )
