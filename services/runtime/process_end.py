"""How a process of Kirotei is asked to end, and how it ends for certain.

An open Zenoh session can hold the interpreter at exit, and a blocked thread holds asyncio's
own shutdown: so a process ends through `os._exit`, and timers see to it.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from types import FrameType
from typing import NoReturn, TextIO

DRAIN_S = 1.5
"""A service may take this long to finish what it has begun."""
HARD_EXIT_S = 1.8
HARD_EXIT_CODE = 70
"""EX_SOFTWARE of sysexits.h: the process had to be torn down."""
LAST_RESORT_S = 0.4
"""After the hard exit was due: the C library's timer, which needs no interpreter."""
SUPERVISOR_VARIABLE = "KIROTEI_SUPERVISOR_PID"
_PR_SET_PDEATHSIG = 1


def arm_hard_exit(after_s: float = HARD_EXIT_S) -> None:
    """End this process after `after_s` with code 70 whatever hangs, a little later should even threads be stuck."""
    timer = threading.Timer(after_s, os._exit, (HARD_EXIT_CODE,))
    timer.daemon = True
    timer.start()
    with suppress(OSError, ValueError, RuntimeError):  # without a standard error there is nowhere to dump to
        faulthandler.dump_traceback_later(after_s + LAST_RESORT_S, exit=True)


def end_process(code: int, *streams: TextIO) -> NoReturn:
    """Flush and end at once, past every thread and exit handler that could hang."""
    for stream in (*streams, sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # a closed pipe is no reason to stay
            stream.flush()
    os._exit(code)


class StopSignals:
    """SIGTERM and SIGINT: the first asks to stop and arms the hard exit, the second ends at once.

    Plain signal handlers, because they also run while the event loop is stuck in Python code.
    """

    def __init__(self, on_stop: Callable[[], object], hard_exit_s: float = HARD_EXIT_S) -> None:
        """Handle both signals from now on. `on_stop` is called in the main thread, between bytecodes."""
        self._on_stop = on_stop
        self._hard_exit_s = hard_exit_s
        self.asked = False
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._handle)

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        if self.asked:
            os._exit(128 + number)
        self.asked = True
        arm_hard_exit(self._hard_exit_s)
        self._on_stop()


def end_with_supervisor(environment: Mapping[str, str]) -> None:
    """Ask the kernel for SIGTERM when the supervisor that started this process dies, however it dies.

    Does nothing for a process that no supervisor started; ends at once when it is dead already.
    """
    supervisor = environment.get(SUPERVISOR_VARIABLE, "")
    if not supervisor:
        return
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM), 0, 0, 0)
    if str(os.getppid()) != supervisor:
        os._exit(HARD_EXIT_CODE)
