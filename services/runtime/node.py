"""The port through which services touch the bus: Node, Service, Arrival.

Services are written against these; `ZenohNode` puts them on a network, `MemoryNode` into a
test or an offline replay.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, overload

from msgspec import Struct

from schemas.message import Message
from schemas.topic import Place, Query, Topic, TopicError
from schemas.topics import HEALTH, SERVICE_EVENT
from services.runtime.clock import Clock
from services.runtime.health import HealthBoard
from services.runtime.host_config import BusConfig
from services.runtime.question import Question

M = TypeVar("M", bound=Message)
M_co = TypeVar("M_co", bound=Message, covariant=True)
C = TypeVar("C", bound=Struct)
T = TypeVar("T")
A = TypeVar("A", bound=Message)
B = TypeVar("B", bound=Message)
D = TypeVar("D", bound=Message)
E = TypeVar("E", bound=Message)
Q = TypeVar("Q", bound=Message)
R = TypeVar("R", bound=Message)


class UndeclaredTopicError(TopicError):
    """A service touched a topic that it does not declare."""


class Arrival(Struct, Generic[M_co], frozen=True, gc=False):
    """A decoded message and where it came from."""

    message: M_co
    key: str
    place: Place
    fields: dict[str, str]
    """Device, method, … as they stand in the key. Shared between arrivals: do not change it."""
    source: str
    """Sender's place and instance; empty when the sender marked nothing."""
    boot_id: str
    sequence: int
    """-1 when the sender marked nothing."""
    sent_ns: int
    received_ns: int


class Sample(Struct, frozen=True, gc=False):
    """An undecoded publication."""

    key: str
    payload: bytes
    attachment: bytes
    received_ns: int


class Node(Protocol):
    """One service's access to the bus, its clock and its health."""

    @property
    def place(self) -> Place:
        """Where the service works."""

    @property
    def instance(self) -> str:
        """Name of this instance, 'gnss_receiver' or 'gnss_receiver@rear'."""

    @property
    def clock(self) -> Clock:
        """Time, live or virtual."""

    @property
    def health(self) -> HealthBoard:
        """Where the service counts and gives reasons."""

    async def publish(self, topic: Topic[M], message: M, **fields: str) -> None:
        """Put a message on its key at the service's place.

        STREAM and STATE never wait. EVENT and KEPT wait while the link is congested. Raises
        UndeclaredTopicError, and TypeError for a message of another type.
        """

    @overload
    def arrivals(
        self, a: Topic[A], /, *, anywhere: bool = False, mirrored: bool = False
    ) -> AsyncIterator[Arrival[A]]: ...
    @overload
    def arrivals(
        self, a: Topic[A], b: Topic[B], /, *, anywhere: bool = False, mirrored: bool = False
    ) -> AsyncIterator[Arrival[A | B]]: ...
    @overload
    def arrivals(
        self, a: Topic[A], b: Topic[B], d: Topic[D], /, *, anywhere: bool = False, mirrored: bool = False
    ) -> AsyncIterator[Arrival[A | B | D]]: ...
    @overload
    def arrivals(
        self, a: Topic[A], b: Topic[B], d: Topic[D], e: Topic[E], /, *, anywhere: bool = False, mirrored: bool = False
    ) -> AsyncIterator[Arrival[A | B | D | E]]: ...
    def arrivals(
        self, *topics: Topic[Any], anywhere: bool = False, mirrored: bool = False
    ) -> AsyncIterator[Arrival[Any]]:
        """Messages with their senders, in order of arrival, until the service is stopped.

        Subscribes when called, not at the first step. From the service's own place (every
        device), or from every place of the line; `mirrored`: from every place beyond a bridge,
        as its far end says it again. What cannot be decoded is counted and left out;
        duplicates are left out.
        """

    @overload
    def messages(self, a: Topic[A], /) -> AsyncIterator[A]: ...
    @overload
    def messages(self, a: Topic[A], b: Topic[B], /) -> AsyncIterator[A | B]: ...
    @overload
    def messages(self, a: Topic[A], b: Topic[B], d: Topic[D], /) -> AsyncIterator[A | B | D]: ...
    @overload
    def messages(self, a: Topic[A], b: Topic[B], d: Topic[D], e: Topic[E], /) -> AsyncIterator[A | B | D | E]: ...
    def messages(self, *topics: Topic[Any]) -> AsyncIterator[Any]:
        """Messages alone, from the service's own place."""

    def samples(self, key_expression: str) -> AsyncIterator[Sample]:
        """Undecoded publications of every declared topic whose key matches, on one subscription."""

    async def publish_mirrored(self, sample: Sample) -> None:
        """Say a bridged publication again under its mirrored key, payload and sender's mark as they were.

        Raises UndeclaredTopicError unless the service declares that it mirrors, TopicError for a key
        that no topic has.
        """

    def questions(self, query: Query[Q, R], **fields: str) -> AsyncIterator[Question[Q, R]]:
        """Questions put to this service at its place, in order, until the service is stopped.

        Each is to be answered or refused. What cannot be decoded is refused and counted.
        """

    async def ask(self, query: Query[Q, R], place: Place, request: Q, *, timeout_s: float, **fields: str) -> R:
        """Answer of whoever answers `query` at `place`. Raises NoAnswerError, RefusedError."""

    async def services_alive(self, line: str = "*") -> set[str]:
        """Services that live now on this bus, as `source` stands in attachments."""

    def elsewhere(self, bus: BusConfig) -> AbstractAsyncContextManager[Node]:
        """Access of the same service to another router, as soon as one answers there; health stays the same."""

    def ready(self) -> None:
        """Say that the service has subscribed, has loaded what it needs, and answers from now on."""

    @property
    def stopping(self) -> bool:
        """True once the service has been asked to finish."""

    async def sleep(self, seconds: float) -> bool:
        """Wait; True to go on, False as soon as the service is to finish."""

    async def in_thread(self, work: Callable[[], T]) -> T:
        """Result of blocking work, done off the loop (inline where time is virtual)."""


@dataclass(frozen=True, slots=True)
class Service(Generic[C]):
    """What a service is: its name, its configuration, its topics, and how it runs."""

    name: str
    config: type[C]
    reads: tuple[Topic[Message], ...]
    writes: tuple[Topic[Message], ...]
    run: Callable[[Node, C], Awaitable[None]]
    """Returns when the node is stopping or the work is done; an exception ends the process."""
    about: str
    answers: tuple[Query[Message, Message], ...] = ()
    asks: tuple[Query[Message, Message], ...] = ()
    mirrors: bool = False
    """It says again, under mirrored keys, what came over a bridge."""

    def require_read(self, topic: Topic[Message]) -> None:
        """Raise UndeclaredTopicError unless the service declares that it reads `topic`."""
        if topic not in self.reads:
            msg = f"{self.name} does not declare that it reads {topic.template}: add it to `reads` of its Service"
            raise UndeclaredTopicError(msg)

    def require_write(self, topic: Topic[Message]) -> None:
        """Raise UndeclaredTopicError unless the service (or the runtime for it) writes `topic`."""
        if topic not in self.writes and topic not in (HEALTH, SERVICE_EVENT):
            msg = f"{self.name} does not declare that it writes {topic.template}: add it to `writes` of its Service"
            raise UndeclaredTopicError(msg)

    def require_answer(self, query: Query[Message, Message]) -> None:
        """Raise UndeclaredTopicError unless the service declares that it answers `query`."""
        if query not in self.answers:
            msg = f"{self.name} does not declare that it answers {query.template}: add it to `answers` of its Service"
            raise UndeclaredTopicError(msg)

    def require_ask(self, query: Query[Message, Message]) -> None:
        """Raise UndeclaredTopicError unless the service declares that it asks `query`."""
        if query not in self.asks:
            msg = f"{self.name} does not declare that it asks {query.template}: add it to `asks` of its Service"
            raise UndeclaredTopicError(msg)

    def require_mirror(self) -> None:
        """Raise UndeclaredTopicError unless the service declares that it mirrors."""
        if not self.mirrors:
            msg = f"{self.name} does not declare that it says bridged publications again: set `mirrors` of its Service"
            raise UndeclaredTopicError(msg)
