"""What can be set about a bridge."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from schemas.message import Message
from schemas.topic import Place, PlaceKind, Topic
from schemas.topics import topic_of
from services.lte_bridge.lane import KEPT

KeyName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")]


class Far(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where records go."""

    kind: PlaceKind = "cloud"
    """What `name` is."""
    name: KeyName
    """Cloud, train or wayside site, of this line."""
    shard: KeyName = "all"
    """Of several stores of one cloud, the one that takes this line's records."""


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings that concern no router."""

    far: Far | None = None
    """Where records go; left out, nothing is sent."""
    receives: bool = False
    """Takes in what is sent to this place, and says it again here."""
    shard: KeyName = "all"
    """Under which it receives."""
    takes: Literal["own", "all"] = "own"
    """Records of this place alone, or of every place that speaks on this router."""
    topics: tuple[str, ...] = ()
    """Short names of the topics taken ('radio/event'); every topic that must be kept when left out."""
    folder: str | None = None
    """Of spool, journal and documents; by default `bridge/<instance>` in the host's state folder."""
    cap_mb: Annotated[float, Meta(ge=1.0, le=1_000_000.0)] = 2000.0
    """The spool's size; the oldest bulk is dropped to stay within it, events never are."""
    commit_s: Annotated[float, Meta(ge=0.01, le=0.1)] = 0.05
    """A process that is killed has lost at most what came within this time and that of one commit."""
    buffer_mb: Annotated[float, Meta(ge=1.0, le=10_000.0)] = 64.0
    """Records wait in memory for a disk that takes nothing up to this."""
    journal_mb: Annotated[float, Meta(ge=1.0, le=100_000.0)] = 64.0
    """Batches received wait up to this to be said again; then no more are taken."""
    rate_limit_kbps: Annotated[float, Meta(ge=1.0)] | None = None
    """What is sent is kept below this [kbit/s]."""
    batch_s: Annotated[float, Meta(ge=0.05, le=10.0)] = 0.4
    """Batches are sized to take the link so long: an event waits no longer for bulk that is on its way."""
    answer_timeout_s: Annotated[float, Meta(ge=0.5, le=60.0)] = 5.0
    """An acknowledgement is waited for this long at first."""
    retry_first_s: Annotated[float, Meta(ge=0.05, le=60.0)] = 0.25
    """Pause after the first attempt without answer; doubled after each further one …"""
    retry_most_s: Annotated[float, Meta(ge=0.1, le=600.0)] = 5.0
    """… up to this."""

    def __post_init__(self) -> None:
        """Refuse topics that are not kept, and a bridge that does nothing."""
        known = {topic.name for topic in KEPT}
        strange = [name for name in self.topics if name not in known]
        if strange:
            msg = f"topics: {', '.join(strange)} is not kept; there are: {', '.join(sorted(known))}"
            raise ValueError(msg)
        if self.far is None and not self.receives:
            msg = "a bridge without `far` sends nothing; let it receive, at least (receives = true)"
            raise ValueError(msg)

    def takes_key(self, place: Place, key: str) -> bool:
        """Whether a key is taken on the router of `place`."""
        address = topic_of(key)
        return (
            address is not None
            and not address.mirrored
            and address.topic in self._chosen
            and (self.takes == "all" or address.place == place)
        )

    @property
    def _chosen(self) -> list[Topic[Message]]:
        return [topic for topic in KEPT if not self.topics or topic.name in self.topics]

    def expressions(self, place: Place) -> list[str]:
        """Key expressions of what is taken on the router of `place`."""
        chosen = self._chosen
        if self.takes == "all":
            return [topic.anywhere(place.line) for topic in chosen]
        kinds = ("{kind}", place.kind)
        return [topic.within(place) for topic in chosen if topic.template.split("/", 1)[0] in kinds]
