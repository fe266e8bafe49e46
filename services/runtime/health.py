"""What a service knows of its own condition, and the verdict that follows from it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from schemas.health import Health, InputHealth, Level
from services.runtime.attachment import Attachment
from services.runtime.sequence import Mark, SequenceTracker

MAX_INPUTS = 65_536
"""Sources and keys that one reader follows; beyond them nothing is checked, and that is counted."""
MAX_SHOWN = 256
"""Inputs that a report lists: those with gaps, restarts or repetitions first."""
MAX_CLOSED = 16
"""Readers that have ended and are still reported."""
MAX_NOTICES = 256
TROUBLE_SHOWN_S = 10.0
"""A gap, a restart or a drop colours the level this long after it happened."""


@dataclass(slots=True)
class Input:
    """One source on one key, as one reader sees it."""

    tracker: SequenceTracker = field(default_factory=SequenceTracker)
    newest_s: float = 0.0
    delay_ns: int = 0
    """Receive time minus send time of the newest arrival; below zero when the clocks disagree."""

    @property
    def troubles(self) -> int:
        """Anything that was not one message after the other."""
        return self.tracker.missing + self.tracker.duplicated + self.tracker.restarts


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
    """Arrivals from more sources and keys than are followed."""
    _readers: list[InputWatch] = field(default_factory=list)
    _reasons: dict[str, tuple[Level, str]] = field(default_factory=dict)
    _trouble: dict[str, tuple[float, str]] = field(default_factory=dict)
    _notices: deque[tuple[str, str]] = field(default_factory=lambda: deque(maxlen=MAX_NOTICES))

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

    def refuse(self, reason: str, now_s: float) -> None:
        """Count an arrival that cannot be used, and say why."""
        self.refused += 1
        self.trouble("refused", f"refused: {reason[:300]}", now_s)

    def open_reader(self) -> InputWatch:
        """Follow the inputs of one more reader; each reader sees every message once."""
        closed = [reader for reader in self._readers if reader.closed]
        for reader in closed[:-MAX_CLOSED]:
            self._readers.remove(reader)
        watch = InputWatch(self)
        self._readers.append(watch)
        return watch

    def note(self, mark: Mark, key: str, sent: Attachment, missing: int, now_s: float) -> None:
        """Make trouble and a notice of a gap, a restart or a false twin."""
        if mark is Mark.GAP:
            text = f"{missing} missing on {key} from {sent.source} (before number {sent.sequence})"
            self._notices.append(("input_gap", text))
        elif mark is Mark.RESTART:
            text = f"{sent.source} restarted (now {sent.boot_id}) on {key}"
            self._notices.append(("input_restart", text))
        else:
            text = f"two senders share the identity {sent.source} on {key}"
        self.trouble(f"{mark.value}:{key}:{sent.source}", text, now_s)

    def take_notices(self) -> list[tuple[str, str]]:
        """Gaps and restarts seen since the last call (the newest 256), as (kind, text)."""
        notices = list(self._notices)
        self._notices.clear()
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
            counts=self.counts | ({"inputs_not_followed": self.overflow_inputs} if self.overflow_inputs else {}),
            inputs=tuple(
                InputHealth(
                    key=key,
                    source=source,
                    received=entry.tracker.received,
                    missing=entry.tracker.missing,
                    duplicated=entry.tracker.duplicated,
                    restarts=entry.tracker.restarts,
                    age_s=now_s - entry.newest_s,
                    delay_s=entry.delay_ns / 1e9,
                )
                for (key, source), entry in self._shown().items()
            ),
        )

    def _shown(self) -> dict[tuple[str, str], Input]:
        """Inputs to report; of an input with several readers, the one that saw the most trouble."""
        worst: dict[tuple[str, str], Input] = {}
        for reader in self._readers:
            for name, entry in reader.inputs.items():
                if name not in worst or entry.troubles > worst[name].troubles:
                    worst[name] = entry
        if len(worst) <= MAX_SHOWN:
            return worst
        ranked = sorted(worst.items(), key=lambda item: item[1].troubles, reverse=True)
        return dict(ranked[:MAX_SHOWN])


@dataclass(slots=True, eq=False)
class InputWatch:
    """The inputs of one reader."""

    _board: HealthBoard
    inputs: dict[tuple[str, str], Input] = field(default_factory=dict)
    closed: bool = False
    """Nothing more will come; what was seen is still reported for a while."""

    def follow(self, key: str, source: str) -> Input | None:
        """One source on one key; None when that would be more than are followed."""
        entry = self.inputs.get((key, source))
        if entry is None and len(self.inputs) < MAX_INPUTS:
            entry = self.inputs[key, source] = Input()
        return entry

    def count_unfollowed(self) -> None:
        """Count an arrival that nothing is known about."""
        self._board.overflow_inputs += 1

    def judge(self, mark: Mark, key: str, sent: Attachment, missing: int, now_s: float) -> bool:
        """Report what was not simply the next; False for a repetition, which is not to be handed on."""
        if mark is Mark.DUPLICATE:
            return False
        if mark is not Mark.FIRST:
            self._board.note(mark, key, sent, missing, now_s)
        return True
