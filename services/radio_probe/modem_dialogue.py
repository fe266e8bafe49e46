"""The talk with a modem: what to ask next, what its lines mean, when a report is complete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from services.radio_probe.modem_answers import SignalReport, report_of
from services.radio_probe.report_rows import Lines

ANSWER_S: Final = 3.0
"""A modem that has not answered a command by then gets the next one."""
GIVEN_UP: Final = 3
"""Times that a command may fail before it is asked no more."""


class ModemDialogue:
    """Asks commands in turn, every `every_s`; one report comes of each turn."""

    def __init__(self, commands: Sequence[str], every_s: float) -> None:
        """Begin at once."""
        self._commands = list(commands)
        self._every_s = every_s
        self._failed: dict[str, int] = {}
        self._lines = Lines()
        self.begin(0.0)
        self._next_s = float("-inf")
        self.counts = {"answers": 0, "errors": 0, "unanswered": 0}

    def begin(self, now_s: float) -> None:
        """Begin anew after the connection was opened."""
        self._turn: list[str] = []
        self._asked: str | None = None
        self._asked_s = now_s
        self._next_s = now_s
        self._known = SignalReport("")
        self._told = False

    @property
    def given_up(self) -> tuple[str, ...]:
        """Commands that the modem does not know."""
        return tuple(name for name, times in self._failed.items() if times >= GIVEN_UP)

    def next_command(self, now_s: float) -> bytes | None:
        """What to send now, if anything."""
        if self._asked is not None:
            if now_s - self._asked_s < ANSWER_S:
                return None
            self.counts["unanswered"] += 1
            self._asked = None
        if not self._turn:
            if now_s < self._next_s:
                return None
            self._next_s = max(self._next_s + self._every_s, now_s)
            self._turn = [name for name in self._commands if self._failed.get(name, 0) < GIVEN_UP]
            if not self._turn:
                return None
        self._asked, self._asked_s = self._turn.pop(0), now_s
        return self._asked.encode("ascii", "ignore") + b"\r\n"

    def feed(self, chunk: bytes) -> list[SignalReport]:
        """Reports that the bytes complete: all that one turn's answers told together."""
        out = []
        for line in self._lines.feed(chunk.replace(b"\r", b"\n")):
            found = report_of(line)
            if found is not None:
                self.counts["answers"] += 1
                self._known = _together(self._known, found)
                self._told |= found.cell is None
            elif line in {"OK", "ERROR"} or line.startswith(("+CME ERROR", "+CMS ERROR")):
                self._ended(failed=line != "OK")
                if not self._turn and self._told:
                    out.append(self._known)
                    self._known, self._told = SignalReport("", cell=self._known.cell), False
        return out

    def _ended(self, *, failed: bool) -> None:
        if self._asked is None:
            return
        if failed:
            self.counts["errors"] += 1
            self._failed[self._asked] = self._failed.get(self._asked, 0) + 1
        else:
            self._failed.pop(self._asked, None)
        self._asked = None


def _together(before: SignalReport, found: SignalReport) -> SignalReport:
    """Both; where both tell a thing, what came later."""
    told = {
        name: value
        for name in ("rssi_dbm", "rsrp_dbm", "rsrq_db", "sinr_db", "cell")
        if (value := getattr(found, name)) is not None
    }
    return replace(before, **told, technology=found.technology or before.technology)
