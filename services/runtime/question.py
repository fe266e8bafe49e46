"""Questions between services: one request, one reply or a refusal in words.

Unlike a publication a question waits for its answer. An exception in whoever answers would look to the
asker as if nobody were there; hence `refuse`, and hence no question is left without a word.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from schemas.codec import MAX_MESSAGE_BYTES, DecodeError, decode, encode
from schemas.message import Message
from schemas.topic import Query

Q = TypeVar("Q", bound=Message)
R = TypeVar("R", bound=Message)


class NoAnswerError(RuntimeError):
    """Nobody answered in time."""


class RefusedError(RuntimeError):
    """Whoever was asked will not or cannot answer; the text says why."""


Reply = Callable[[bytes, bool], Awaitable[None]]
"""Sends an encoded reply, or (True) a refusal as text."""


@dataclass(slots=True)
class Question(Generic[Q, R]):
    """A question that waits for its answer."""

    request: Q
    key: str
    source: str
    """Who asks: place and instance; empty for a foreign asker."""
    reply: type[R]
    _send: Reply
    _done: bool = field(default=False)

    async def answer(self, message: R) -> None:
        """Send the reply. The first word counts; a second is dropped. TypeError for a message of another type."""
        if type(message) is not self.reply:
            msg = f"{self.key} is answered by {self.reply.__name__}, not {type(message).__name__}"
            raise TypeError(msg)
        payload = encode(message)
        if len(payload) > MAX_MESSAGE_BYTES:
            await self.refuse(f"the answer has {len(payload)} bytes, more than {MAX_MESSAGE_BYTES}: ask for less")
            return
        await self._say(payload, refused=False)

    async def refuse(self, text: str) -> None:
        """Say why there is no answer."""
        await self._say(text.encode(), refused=True)

    async def _say(self, payload: bytes, *, refused: bool) -> None:
        if not self._done:
            self._done = True
            await self._send(payload, refused)


def answer_of(query: Query[Q, R], key: str, payload: bytes | None, *, refused: bool) -> R:
    """Reply in what came back. Raises RefusedError, and NoAnswerError when nothing did."""
    if payload is None:
        msg = f"nobody answered at {key}"
        raise NoAnswerError(msg)
    if refused:
        raise RefusedError(payload.decode("utf-8", "replace"))
    try:
        return decode(query.reply, payload)
    except DecodeError as error:
        msg = f"the answer at {key} cannot be read: {error}"
        raise RefusedError(msg) from error
