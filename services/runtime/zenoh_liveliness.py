"""Liveliness tokens: a service's identity on the bus, and who else is there."""

from __future__ import annotations

import asyncio
import zlib
from collections.abc import AsyncIterator

import zenoh

from services.runtime.alive import (
    LOST_AFTER_S,
    AliveChange,
    AliveTable,
    Token,
    token_of,
    tokens_anywhere,
    tokens_of,
)
from services.runtime.clock import Clock
from services.runtime.host_config import BusConfig
from services.runtime.zenoh_session import close_session, open_session

QUERY_S = 2.0
LOOK_S = 0.2


class IdentityTakenError(RuntimeError):
    """Another service with the same place and instance lives on this bus."""


async def services_alive(bus: BusConfig, line: str = "*") -> list[Token]:
    """Services of a line, or of all lines, whose token stands now; in order of their names.

    Asks on a session of its own: a session that has just begun to watch tokens answers itself,
    and with what it knows so far. Waits until a router answers; nobody, when it goes away meanwhile.
    """
    session = await open_session(bus)
    try:
        return await asyncio.to_thread(tokens_alive, session, tokens_anywhere(line))
    except zenoh.ZError:
        return []
    finally:
        await asyncio.to_thread(close_session, session)


def tokens_alive(session: zenoh.Session, expression: str) -> list[Token]:
    """Tokens that stand now, by key. Blocks for a round trip, at most two seconds."""
    keys = {
        str(reply.ok.key_expr)
        for reply in session.liveliness().get(expression, timeout=QUERY_S)
        if reply.ok is not None
    }
    return [token for token in map(token_of, sorted(keys)) if token is not None]


async def claim(session: zenoh.Session, own: Token, clock: Clock) -> zenoh.LivelinessToken:
    """Own token, declared, once no other start of the same service holds one.

    Waits up to five seconds for the token of a predecessor that crashed. Of two that start at
    the same moment at least one sees the other, for each declares before it looks; whoever
    sees another takes its own token back and tries again, each after a time of its own.
    Raises IdentityTakenError.
    """
    deadline_s = clock.monotonic_s() + LOST_AFTER_S
    while True:
        others = await _others(session, own)
        if not others:
            token = await asyncio.to_thread(session.liveliness().declare_token, own.key)
            others = await _others(session, own)
            if not others:
                return token
            await asyncio.to_thread(token.undeclare)
        if clock.monotonic_s() >= deadline_s:
            msg = (
                f"another {own.instance} runs at {own.place} (start {others[0].boot_id}): stop it, or start this one "
                f"as an instance of its own, '{own.instance.split('@')[0]}@name'"
            )
            raise IdentityTakenError(msg)
        await asyncio.sleep(_pause_s(own))


def _pause_s(own: Token) -> float:
    """Between two looks: a fifth of a second, and up to two fifths more by the start's own number."""
    return LOOK_S * (1.0 + 2.0 * (zlib.crc32(own.boot_id.encode()) % 1000) / 1000)


async def _others(session: zenoh.Session, own: Token) -> list[Token]:
    standing = await asyncio.to_thread(tokens_alive, session, tokens_of(own.place, own.instance))
    return [token for token in standing if token.boot_id != own.boot_id]


class AliveWatch:
    """Services that appear and are lost. Made on the loop's thread; watches from then on."""

    def __init__(self, session: zenoh.Session, expression: str, clock: Clock) -> None:
        """Start with the services that live now."""
        self._loop = asyncio.get_running_loop()
        self._clock = clock
        self._table = AliveTable()
        self._stirred = asyncio.Event()
        self._closed = False
        handler: zenoh.handlers.Callback[zenoh.Sample] = zenoh.handlers.Callback(self._on_token, indirect=False)
        self._subscriber = session.liveliness().declare_subscriber(expression, handler, history=True)

    def close(self) -> None:
        """End the iteration. From the loop's thread; the session's end takes the subscription away."""
        self._closed = True
        self._stirred.set()

    async def changes(self) -> AsyncIterator[AliveChange]:
        """Services as they appear, come back as another start, or are lost, until closed."""
        while not self._closed:
            now_s = self._clock.monotonic_s()
            for change in self._table.changes(now_s):
                yield change
            due_s = self._table.next_due_s()
            try:
                async with asyncio.timeout(None if due_s is None else max(0.0, due_s - self._clock.monotonic_s())):
                    await self._stirred.wait()
            except TimeoutError:
                continue
            self._stirred.clear()

    def _on_token(self, sample: zenoh.Sample) -> None:
        token = token_of(str(sample.key_expr))
        if token is None or self._closed:
            return
        try:
            self._loop.call_soon_threadsafe(self._take, token, sample.kind == zenoh.SampleKind.PUT)
        except RuntimeError:  # the loop has ended; nobody watches any more
            self._closed = True

    def _take(self, token: Token, came: bool) -> None:  # noqa: FBT001 - call_soon_threadsafe passes no names
        if came:
            self._table.came(token)
        else:
            self._table.went(token, self._clock.monotonic_s())
        self._stirred.set()
