"""Opening a session: patiently while no router is up, and cancellable."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import Protocol

import zenoh

from services.runtime.host_config import BusConfig
from services.runtime.zenoh_config import cause_of, client_config

FIRST_PAUSE_S = 0.2
LONGEST_PAUSE_S = 1.0


class Closable(Protocol):
    """A session, whose own `close` carries no types."""

    def close(self) -> None:
        """End it."""


def close_session(session: Closable) -> None:
    """End a session: every link, publisher, subscription and token of it. Blocks: not on the loop."""
    session.close()


async def open_session(bus: BusConfig, on_waiting: Callable[[str], None] | None = None) -> zenoh.Session:
    """Session with the first router of `bus.connect` that answers, however long that takes.

    `on_waiting` is called with the reason after each attempt that failed. Raises
    BusConfigError at once when Zenoh refuses the configuration.
    """
    client_config(bus)  # a wrong setting is reported at once, not waited for
    pause_s = FIRST_PAUSE_S
    while True:
        try:
            return await _attempt(bus)
        except zenoh.ZError as error:
            if on_waiting is not None:
                on_waiting(f"no router at {', '.join(bus.connect)}: {cause_of(error)}")
        await asyncio.sleep(pause_s)
        pause_s = min(2 * pause_s, LONGEST_PAUSE_S)


async def _attempt(bus: BusConfig) -> zenoh.Session:
    """One attempt, in a thread. A session that opens after we were cancelled is closed again."""
    cancelled = threading.Event()

    def attempt() -> zenoh.Session:
        session = zenoh.open(client_config(bus))
        if cancelled.is_set():
            close_session(session)
        return session

    try:
        return await asyncio.to_thread(attempt)
    except asyncio.CancelledError:
        cancelled.set()
        raise
