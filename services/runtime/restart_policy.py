"""When a process that has ended is started again. Pure: times come in, decisions come out."""

from __future__ import annotations

import signal
from dataclasses import dataclass

FIRST_WAIT_S = 0.2
LONGEST_WAIT_S = 10.0
HEALTHY_S = 30.0
"""Having been ready for this long, a process has earned the shortest wait again."""


@dataclass(slots=True)
class RestartPolicy:
    """Doubling waits between the restarts of one process."""

    restart_when_done: bool = False
    """True for what must run for ever: an exit code of 0 is then no end either."""
    restarts: int = 0
    _wait_s: float = FIRST_WAIT_S

    def after_exit(self, code: int, ready_for_s: float | None) -> float | None:
        """Seconds to wait before starting again; None when the process has done its work.

        `ready_for_s` tells how long it had been ready, None when it never was.
        """
        if code == 0 and not self.restart_when_done:
            return None
        if ready_for_s is not None and ready_for_s >= HEALTHY_S:
            self._wait_s = FIRST_WAIT_S
        wait_s = self._wait_s
        self._wait_s = min(2 * wait_s, LONGEST_WAIT_S)
        self.restarts += 1
        return wait_s


def exit_words(code: int) -> str:
    """How a process ended, in words.

    >>> exit_words(-9)
    'killed by signal 9 (SIGKILL)'
    """
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by signal {-code} ({signal.Signals(-code).name})"
    except ValueError:
        return f"killed by signal {-code}"
