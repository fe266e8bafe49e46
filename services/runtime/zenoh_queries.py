"""Questions over Zenoh: queryables on the answering side, `get` on the asking one."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import zenoh
from zenoh import CongestionControl, handlers

from schemas.codec import DecodeError, decode
from schemas.message import Message
from schemas.topic import Query
from services.runtime.attachment import UNMARKED, decode_attachment
from services.runtime.health import HealthBoard
from services.runtime.question import Question

CAPACITY = 64
"""Questions that may wait for an answer; further ones are refused at once."""
LATE_S = 2.0
"""Zenoh ends a question at its time; a link that is stuck may hold it up, and is not waited for longer."""


class Queryable:
    """Questions of one key on their way to a service."""

    def __init__(self, session: zenoh.Session, query: Query[Any, Any], key: str, health: HealthBoard) -> None:
        """Declare at once. Needs a running loop; blocks for a moment: call it in a thread via `declare`."""
        self._query = query
        self._key = key
        self._health = health
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[zenoh.Query] = deque()
        self._some = asyncio.Event()
        self._closed = False
        self._lock = threading.Lock()
        callback: handlers.Callback[zenoh.Query] = handlers.Callback(self._take, indirect=False)
        self._queryable = session.declare_queryable(key, callback, complete=True)

    def _take(self, asked: zenoh.Query) -> None:
        """Queue one question; on a thread of Zenoh."""
        with self._lock:
            full = len(self._waiting) >= CAPACITY or self._closed
            if not full:
                self._waiting.append(asked)
        if full:
            _reply(asked, self._key, b"too many questions wait: ask again later", refused=True)
            return
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._some.set)

    async def questions(self) -> AsyncIterator[Question[Any, Any]]:
        """Questions in the order in which they came, until closed."""
        while True:
            while self._waiting:
                question = await self._open(self._waiting.popleft())
                if question is not None:
                    yield question
            if self._closed:
                return
            self._some.clear()
            if not self._waiting:
                await self._some.wait()

    async def _open(self, asked: zenoh.Query) -> Question[Any, Any] | None:
        payload = asked.payload.to_bytes() if asked.payload is not None else b""
        mark = asked.attachment

        async def send(octets: bytes, refused: bool) -> None:  # noqa: FBT001 - the port's form
            await asyncio.to_thread(_reply, asked, self._key, octets, refused=refused)

        try:
            request: Message = decode(self._query.request, payload)
        except DecodeError as error:
            self._health.refuse(f"{self._key}: {error}", self._loop.time())
            await send(f"the question cannot be read: {error}".encode(), True)  # noqa: FBT003 - the port's form
            return None
        source = (decode_attachment(mark.to_bytes()) or UNMARKED).source if mark is not None else ""
        return Question(request, self._key, source, self._query.reply, send)

    def stop(self) -> None:
        """Let the reader end after what is queued."""
        self._closed = True
        self._some.set()

    def close(self) -> None:
        """Undeclare, and refuse what still waits. Blocks: not on the loop."""
        with self._lock:
            self._closed = True
            left = list(self._waiting)
            self._waiting.clear()
        for asked in left:
            _reply(asked, self._key, b"the service is stopping", refused=True)
        with suppress(zenoh.ZError):  # the session is closed
            self._queryable.undeclare()  # type: ignore[no-untyped-call]  # Zenoh's own carries no types


def _reply(asked: zenoh.Query, key: str, payload: bytes, *, refused: bool) -> None:
    """Answer and let go of the question. May block while the link is congested."""
    with suppress(zenoh.ZError):  # the asker, or our session, is gone
        if refused:
            asked.reply_err(payload)
        else:
            asked.reply(key, payload)
        asked.drop()  # type: ignore[no-untyped-call]  # Zenoh's own carries no types


class Asker:
    """Asks questions of one session, on threads of its own: a stuck link may hold each up for seconds."""

    def __init__(self, session: zenoh.Session, name: str) -> None:
        """Ask nothing yet."""
        self._session = session
        self._threads = ThreadPoolExecutor(2, thread_name_prefix=f"{name}-ask")

    async def ask(self, key: str, payload: bytes, attachment: bytes, timeout_s: float) -> tuple[bytes, bool] | None:
        """First reply and whether it is a refusal; None when there is none in time, or nobody asks any more."""
        answer = _Answer()
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(timeout_s + LATE_S):
                await loop.run_in_executor(self._threads, self._send, answer, key, payload, attachment, timeout_s)
                return await answer.first
        except (TimeoutError, RuntimeError):  # RuntimeError: the threads take nothing more, the node is closed
            return None

    def _send(self, answer: _Answer, key: str, payload: bytes, attachment: bytes, timeout_s: float) -> None:
        callback: handlers.Callback[zenoh.Reply] = handlers.Callback(answer.take, answer.end, indirect=False)
        try:
            self._session.get(
                key,
                callback,
                target=zenoh.QueryTarget.BEST_MATCHING,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=timeout_s,
                congestion_control=CongestionControl.BLOCK,
                payload=payload,
                attachment=attachment,
            )
        except zenoh.ZError:
            answer.end()

    def close(self) -> None:
        """Ask nothing more."""
        self._threads.shutdown(wait=False, cancel_futures=True)


class _Answer:
    """The first answer to one question, from Zenoh's threads, for the loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self.first: asyncio.Future[tuple[bytes, bool] | None] = self._loop.create_future()

    def take(self, reply: zenoh.Reply) -> None:
        said = reply.ok
        if said is not None:
            self._set((said.payload.to_bytes(), False))
        elif reply.err is not None:
            text = reply.err.payload.to_bytes()
            # Zenoh itself says this when the time is over.
            self._set(None if text == b"Timeout" else (text, True))

    def end(self) -> None:
        self._set(None)

    def _set(self, answer: tuple[bytes, bool] | None) -> None:
        def settle() -> None:
            if not self.first.done():
                self.first.set_result(answer)

        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(settle)
