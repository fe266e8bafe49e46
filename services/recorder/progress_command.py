"""How far a command has come: one line that changes on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable

PLAIN_EVERY_S = 10.0
TERMINAL_EVERY_S = 0.2


class ProgressLine:
    """Says on standard error how far work has come. `clock_s` is any clock that never steps."""

    def __init__(self, clock_s: Callable[[], float]) -> None:
        """Say nothing yet."""
        self._clock_s = clock_s
        self._terminal = sys.stderr.isatty()
        self._said_s = clock_s()

    def update(self, text: Callable[[], str]) -> None:
        """Say `text()` if it is time to."""
        now_s = self._clock_s()
        if now_s - self._said_s < (TERMINAL_EVERY_S if self._terminal else PLAIN_EVERY_S):
            return
        self._said_s = now_s
        sys.stderr.write(f"\r\x1b[K{text()}" if self._terminal else f"{text()}\n")
        sys.stderr.flush()

    def done(self) -> None:
        """Clear the line that changes."""
        if self._terminal:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
