"""What a topic is: key template, message type, delivery, nominal rate; and how a key finds its topic.

A key is `kirotei/v1/<line>/<place kind>/<place>/<subject…>`. Services never format keys:
`topic.at(place)` gives the key to publish on, `topic.within(place)` and
`topic.anywhere()` what to subscribe to, `topic_of(key)` finds the topic of a key.
What a bridge says again at its far end stands under `kirotei/v1/<line>/mirror/<place kind>/…`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import Generic, Literal, TypeVar, get_args

from schemas.message import Message

ROOT = "kirotei/v1"
PlaceKind = Literal["train", "wayside", "cloud"]
PLACE_KINDS: tuple[PlaceKind, ...] = get_args(PlaceKind)

MIRROR = "mirror"
"""Stands before the place kind in keys of what a bridge says again at its far end."""

M_co = TypeVar("M_co", bound=Message, covariant=True)
Q_co = TypeVar("Q_co", bound=Message, covariant=True)
R_co = TypeVar("R_co", bound=Message, covariant=True)
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}")
_FIELD = re.compile(r"\{([a-z_]+)\}")


class TopicError(ValueError):
    """A key, a place or a field that the topic table does not allow."""


class Delivery(Enum):
    """What a topic promises its readers."""

    STREAM = "stream"
    """The newest matters; loss is tolerated."""
    STATE = "state"
    """Late joiners get the last value; short gaps are recovered."""
    EVENT = "event"
    """Every one must arrive while both ends live."""
    KEPT = "kept"
    """Must reach the cloud, whatever the link does."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a service works: a train, a wayside site or a cloud of one line."""

    line: str
    kind: PlaceKind
    name: str

    def __post_init__(self) -> None:
        """Refuse names that cannot stand in a key."""
        if self.kind not in PLACE_KINDS:
            msg = f"place kind {self.kind!r} is not one of {', '.join(PLACE_KINDS)}"
            raise TopicError(msg)
        _require_name("line", self.line)
        _require_name(self.kind, self.name)

    def __str__(self) -> str:
        """Line, kind and name as they stand in a key."""
        return f"{self.line}/{self.kind}/{self.name}"


def _require_name(what: str, name: str) -> None:
    if not _NAME.fullmatch(name):
        msg = f"{what} {name!r} cannot stand in a key: use letters, digits and _ . @ + - (at most 64)"
        raise TopicError(msg)


@dataclass(frozen=True, slots=True, eq=False)
class Topic(Generic[M_co]):
    """One subject of the bus.

    `template` starts with the place kind (`train/{train}/…`) or with `{kind}/{place}/…`
    where every kind of place speaks of it; further fields in braces name devices, methods
    and the like.
    """

    template: str
    message: type[M_co]
    delivery: Delivery
    rate_hz: float | None
    """Nominal rate of one key; None for what comes when it comes."""
    about: str
    from_outside: bool = False
    """Written by people or foreign equipment, not by a service."""
    fields: tuple[str, ...] = field(init=False)
    """Names in braces after the place."""

    def __post_init__(self) -> None:
        """Work out the fields once."""
        chunks = self.template.split("/")
        object.__setattr__(self, "fields", tuple(_FIELD.findall("/".join(chunks[2:]))))

    @property
    def name(self) -> str:
        """Short name that people type: the template without place and fields ('gnss/fix')."""
        return "/".join(chunk for chunk in self.template.split("/")[2:] if not chunk.startswith("{"))

    @property
    def schema_name(self) -> str:
        """Name of the message, with its file ('gnss.Fix')."""
        return f"{self.message.__module__.removeprefix('schemas.')}.{self.message.__qualname__}"

    def at(self, place: Place, **fields: str) -> str:
        """Key of this topic at a place. TopicError when the kind or the fields do not fit."""
        kind = self.template.split("/", 1)[0]
        if kind not in ("{kind}", place.kind):
            msg = f"topic {self.template} belongs to a {kind}, not to {place}"
            raise TopicError(msg)
        if set(fields) != set(self.fields):
            msg = f"topic {self.template} wants the fields {self.fields}, not {tuple(fields)}"
            raise TopicError(msg)
        for what, name in fields.items():
            _require_name(what, name)
        subject = "/".join(
            fields[chunk[1:-1]] if chunk.startswith("{") else chunk for chunk in self.template.split("/")[2:]
        )
        return f"{ROOT}/{place}/{subject}"

    def within(self, place: Place) -> str:
        """Key expression of this topic at a place, with any device, method or other field."""
        return self.at(place, **dict.fromkeys(self.fields, "x")) if not self.fields else self._wild(str(place))

    def anywhere(self, line: str = "*", *, mirrored: bool = False) -> str:
        """Key expression of this topic at every place (of a line, or of all lines), or of its mirrored keys."""
        kind = self.template.split("/", 1)[0]
        mirror = f"{MIRROR}/" if mirrored else ""
        return self._wild(f"{line}/{mirror}{'*' if kind.startswith('{') else kind}/*")

    def _wild(self, place: str) -> str:
        subject = "/".join("*" if chunk.startswith("{") else chunk for chunk in self.template.split("/")[2:])
        return f"{ROOT}/{place}/{subject}"


@dataclass(frozen=True, slots=True, eq=False)
class Query(Generic[Q_co, R_co]):
    """A question that a service answers: one request, one reply or a refusal in words.

    `template` as that of a topic; a query is no topic: nothing is published on its key.
    """

    template: str
    request: type[Q_co]
    reply: type[R_co]
    about: str

    def at(self, place: Place, **fields: str) -> str:
        """Key of this query at a place. TopicError when the kind or the fields do not fit."""
        return Topic(self.template, self.request, Delivery.EVENT, None, self.about).at(place, **fields)


@dataclass(frozen=True, slots=True)
class Address:
    """A concrete key taken apart."""

    topic: Topic[Message]
    place: Place
    """Where it was said first, also when the key is a mirrored one."""
    fields: dict[str, str]
    mirrored: bool = False
    """Said again at the far end of a bridge."""


class _Branch:
    """One level of the trie that finds a topic from a key."""

    __slots__ = ("children", "topic")

    def __init__(self) -> None:
        self.children: dict[str, _Branch] = {}
        self.topic: Topic[Message] | None = None


class TopicTable:
    """Finds the topic of a key. Key templates may not intersect (TopicError)."""

    def __init__(self, topics: tuple[Topic[Message], ...]) -> None:
        """Build the trie of `topics`."""
        self._root = _Branch()
        for topic in topics:
            kind, *_ = topic.template.split("/")
            for concrete in PLACE_KINDS if kind == "{kind}" else (kind,):
                self._insert([concrete, "{}", *topic.template.split("/")[2:]], topic)
        self.find = lru_cache(maxsize=65_536)(self._find)

    def _insert(self, chunks: list[str], topic: Topic[Message]) -> None:
        branches = [self._root]
        for chunk in chunks:
            label = "{}" if chunk.startswith("{") else chunk
            for branch in branches:
                if branch.children and (label == "{}") != ("{}" in branch.children):
                    msg = f"topic {topic.template} intersects another at {chunk!r}"
                    raise TopicError(msg)
            branches = [branch.children.setdefault(label, _Branch()) for branch in branches]
        if branches[0].topic is not None:
            msg = f"topic {topic.template} stands twice in the table"
            raise TopicError(msg)
        branches[0].topic = topic

    def _find(self, key: str) -> Address | None:
        chunks = key.split("/")
        if len(chunks) < 6 or chunks[0] != "kirotei" or chunks[1] != "v1":  # noqa: PLR2004 - root, line, kind, place, subject
            return None
        mirrored = chunks[3] == MIRROR
        if mirrored:
            del chunks[3]
        branch: _Branch | None = self._root
        for chunk in chunks[3:]:
            branch = branch and (branch.children.get(chunk) or branch.children.get("{}"))
        if branch is None or branch.topic is None:
            return None
        try:
            place = Place(chunks[2], chunks[3], chunks[4])  # type: ignore[arg-type]  # checked by Place itself
        except TopicError:
            return None
        template = branch.topic.template.split("/")
        fields = {t[1:-1]: c for t, c in zip(template[2:], chunks[5:], strict=True) if t.startswith("{")}
        return Address(branch.topic, place, fields, mirrored)


def mirrored_key(key: str) -> str:
    """Key on which the far end of a bridge says again what was said on `key`. TopicError for other keys."""
    chunks = key.split("/")
    if len(chunks) < 6 or "/".join(chunks[:2]) != ROOT or chunks[3] not in PLACE_KINDS:  # noqa: PLR2004 - root, line, kind, place, subject
        msg = f"{key!r} is no key that could be mirrored"
        raise TopicError(msg)
    return "/".join((*chunks[:3], MIRROR, *chunks[3:]))
