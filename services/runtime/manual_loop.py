"""An event loop whose time moves by hand: tests and offline replay without waiting.

`asyncio.sleep` and `asyncio.timeout` need no change, for they ask the loop for the time. The
selector notices when no callback is ready: then `run_until_settled` returns, or time jumps to
the next timer. A task that waits for something that can never come is named.
"""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

T = TypeVar("T")


class DeadlockError(RuntimeError):
    """Everything waits and no timer is due, ever."""


class _IdleSelector(selectors.DefaultSelector):
    """Never blocks; tells the loop that nothing can run."""

    def __init__(self, loop: ManualLoop) -> None:
        super().__init__()
        self._owner = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        events: list[tuple[selectors.SelectorKey, int]] = super().select(0)
        if not events and (timeout is None or timeout > 0):
            self._owner.idle(timeout)
        return events


class ManualLoop(asyncio.SelectorEventLoop):
    """Selector event loop with virtual time [s], starting at 0."""

    def __init__(self) -> None:
        """Stand at time 0."""
        self._now_s = 0.0
        self._limit_s: float | None = None
        super().__init__(_IdleSelector(self))

    def time(self) -> float:
        """Virtual seconds."""
        return self._now_s

    def idle(self, timeout_s: float | None) -> None:
        """Jump to the next timer, or stop when it lies beyond the limit. Called by the selector."""
        if timeout_s is None:
            if self._limit_s is None:
                waiting = ", ".join(sorted(_describe(task) for task in asyncio.all_tasks(self)))
                msg = f"deadlock: nothing can run and no timer is set; waiting: {waiting or 'nothing'}"
                raise DeadlockError(msg)
            self._now_s = max(self._now_s, self._limit_s)
            self.stop()
            return
        due_s = self._now_s + timeout_s
        if self._limit_s is not None and due_s > self._limit_s + 1e-9:
            self._now_s = max(self._now_s, self._limit_s)
            self.stop()
            return
        self._now_s = max(self._now_s, due_s)

    def advance(self, seconds: float) -> None:
        """Run everything that is due within the next `seconds`, moving time as it goes."""
        self._limit_s = self._now_s + seconds
        try:
            self.run_forever()
        finally:
            self._limit_s = None

    def settle(self) -> None:
        """Run until nothing can run without time moving."""
        self.advance(0.0)


def _describe(task: asyncio.Task[Any]) -> str:
    stack = task.get_stack(limit=1)
    where = f" at {stack[-1].f_code.co_qualname}:{stack[-1].f_lineno}" if stack else ""
    return f"{task.get_name()}{where}"


@contextmanager
def manual_loop() -> Iterator[ManualLoop]:
    """Make a manual loop, set it as current, and close it with everything cancelled."""
    loop = ManualLoop()
    asyncio.set_event_loop(loop)
    try:
        yield loop
    finally:
        tasks = asyncio.all_tasks(loop)
        for task in tasks:
            task.cancel()
        if tasks:
            loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        loop.run_until_complete(loop.shutdown_asyncgens())
        asyncio.set_event_loop(None)
        loop.close()


def run_manual(main: Coroutine[Any, Any, T]) -> T:
    """Result of a coroutine on a manual loop, time jumping from timer to timer."""
    with manual_loop() as loop:
        return loop.run_until_complete(main)
