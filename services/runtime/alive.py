"""Which services live, from the tokens that come and go on the bus.

A token stands while its service's session does. A restarting router takes every token away
for some seconds, so a service counts as lost only after five seconds without any token.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import get_args

from schemas.topic import ROOT, Place, PlaceKind, TopicError

LOST_AFTER_S = 5.0
_CHUNKS = len(f"{ROOT}/line/kind/place/alive/instance/boot".split("/"))


@dataclass(frozen=True, slots=True)
class Token:
    """One start of one service."""

    place: Place
    instance: str
    boot_id: str

    @property
    def key(self) -> str:
        """Key of the liveliness token."""
        return f"{ROOT}/{self.place}/alive/{self.instance}/{self.boot_id}"

    @property
    def service(self) -> str:
        """Place and instance, as `source` stands in attachments."""
        return f"{self.place}/{self.instance}"


def tokens_of(place: Place, instance: str) -> str:
    """Key expression of every start of one service."""
    return f"{ROOT}/{place}/alive/{instance}/*"


def tokens_anywhere(line: str = "*") -> str:
    """Key expression of every service of a line, or of all lines."""
    return f"{ROOT}/{line}/*/*/alive/*/*"


def token_of(key: str) -> Token | None:
    """Token with this key; None when it is none of ours."""
    chunks = key.split("/")
    if len(chunks) != _CHUNKS or not key.startswith(f"{ROOT}/") or chunks[5] != "alive":
        return None
    kind = next((kind for kind in get_args(PlaceKind) if kind == chunks[3]), None)
    if kind is None:
        return None
    try:
        return Token(Place(chunks[2], kind, chunks[4]), chunks[6], chunks[7])
    except TopicError:
        return None


@dataclass(frozen=True, slots=True)
class AliveChange:
    """A service appeared, came back as another start, or was lost."""

    token: Token
    """The newest start that was seen."""
    alive: bool


@dataclass(slots=True)
class _Seen:
    newest: Token
    reported: Token | None = None
    boots: set[str] = field(default_factory=set)
    gone_s: float = 0.0


@dataclass(slots=True)
class AliveTable:
    """Turns tokens that come and go into services that live or are lost. Times are monotonic [s]."""

    lost_after_s: float = LOST_AFTER_S
    _seen: dict[str, _Seen] = field(default_factory=dict)

    def came(self, token: Token) -> None:
        """Take a token that appeared."""
        seen = self._seen.setdefault(token.service, _Seen(token))
        seen.newest = token
        seen.boots.add(token.boot_id)

    def went(self, token: Token, now_s: float) -> None:
        """Take a token that vanished; its service may come back within its time."""
        seen = self._seen.get(token.service)
        if seen is not None and token.boot_id in seen.boots:
            seen.boots.discard(token.boot_id)
            seen.gone_s = now_s

    def changes(self, now_s: float) -> list[AliveChange]:
        """What became different since the last call, in order of the services' first appearance."""
        changes = []
        for service, seen in list(self._seen.items()):
            if seen.boots and seen.newest != seen.reported:
                seen.reported = seen.newest
                changes.append(AliveChange(seen.newest, alive=True))
            elif not seen.boots and now_s - seen.gone_s >= self.lost_after_s:
                del self._seen[service]
                if seen.reported is not None:
                    changes.append(AliveChange(seen.reported, alive=False))
        return changes

    def next_due_s(self) -> float | None:
        """When a service will be lost if its token stays away; None while every service has one."""
        return min((seen.gone_s + self.lost_after_s for seen in self._seen.values() if not seen.boots), default=None)
