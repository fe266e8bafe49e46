"""What the bridge between a train and the cloud exchanges with its far end, and what a store is asked.

Records pass through undecoded: key, payload and attachment as they were on the sender's bus.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from schemas.message import Message, Part

Name = Annotated[str, Meta(min_length=1, max_length=128)]


class BridgedRecord(Part, frozen=True, kw_only=True, array_like=True):
    """One publication as it was heard at its origin."""

    key: str
    payload: bytes
    attachment: bytes
    heard_ns: int
    """When the bridge heard it, by its own clock."""


class BridgeBatch(Message, frozen=True, kw_only=True):
    """Records of one bridge for its far end, in order per source and topic; acknowledged as one."""

    bridge: Name
    """Place and instance of the sender."""
    lane: Literal["events", "bulk"]
    spool_id: Name
    """Made with the spool; a new spool counts its batches anew."""
    first: Annotated[int, Meta(ge=0)]
    """Number of the first record in the spool's lane."""
    count: Annotated[int, Meta(ge=1)]
    compressed: bytes
    """zstd of the msgpack array of `BridgedRecord`."""
    dropped: Annotated[int, Meta(ge=0)] = 0
    """Records of this lane that were dropped for want of room since the spool was made."""


class BridgeAcknowledgement(Message, frozen=True, kw_only=True):
    """Everything up to and with record `through` of the lane is durable at the far end."""

    bridge: Name
    lane: Literal["events", "bulk"]
    spool_id: Name
    through: int
    repeated: Annotated[int, Meta(ge=0)] = 0
    """Records that the far end already had."""
    refused: Annotated[int, Meta(ge=0)] = 0
    """Records that it could not take, quarantined there with the reason."""


class BridgeStatus(Message, frozen=True, kw_only=True):
    """How far behind a bridge is."""

    linked: bool
    """The far end acknowledged within the last seconds, or nothing waits."""
    backlog_records: Annotated[int, Meta(ge=0)]
    backlog_bytes: Annotated[int, Meta(ge=0)]
    cap_bytes: Annotated[int, Meta(ge=0)]
    oldest_ns: int | None = None
    """When the oldest record that waits was heard."""
    delay_events_s: float | None = None
    """From heard to acknowledged, of the newest acknowledged."""
    delay_bulk_s: float | None = None
    acknowledged: Annotated[int, Meta(ge=0)]
    dropped_bulk: Annotated[int, Meta(ge=0)]
    dropped_events: Annotated[int, Meta(ge=0)]
    """Refused while events alone fill the spool."""
    quarantined: Annotated[int, Meta(ge=0)]
    full_in_s: float | None = None
    """At the rate of the last hour; None while it does not fill."""


class StoreQuestion(Message, frozen=True, kw_only=True):
    """A question to a cloud's store."""

    about: Literal["radio", "radio_events", "radio_sums", "events", "runs", "models", "model_parts", "reanalysed"]
    """`radio_sums`: what was learned, as sums by day, radio, channel, direction and section; `models`: the radio
    models learned here, `model_parts` what they are, packed; `reanalysed`: what models found in the history."""
    from_ns: int | None = None
    until_ns: int | None = None
    from_chainage_m: float | None = None
    until_chainage_m: float | None = None
    radio: str = ""
    channel: str = ""
    train: str = ""
    kind: str = ""
    topic: str = ""
    """Of events: one topic alone, by its short name."""
    model: str = ""
    """Of models and what they found: one version alone."""
    limit: Annotated[int, Meta(ge=1, le=50_000)] = 1000
    page: str = ""
    """From the page before; empty for the first."""


class StoreAnswer(Message, frozen=True, kw_only=True):
    """A page of rows. Newest last."""

    about: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float | int | bool | None, ...], ...]
    next_page: str = ""
    """To ask on with; empty at the end."""
    partial: str = ""
    """What is missing and why, when a shard did not answer."""


class HistoryTask(Message, frozen=True, kw_only=True):
    """Work for a cloud to do over its history of the radio."""

    task: Literal["learn", "analyse", "update"]
    """`learn`: a model, anew; `analyse`: the history, by a model; `update`: whole days that the newest model has not
    seen, analysed by it and learned."""
    from_ns: int | None = None
    until_ns: int | None = None
    model: str = ""
    """Version to analyse by; empty: the newest."""


class HistoryTaskDone(Message, frozen=True, kw_only=True):
    """What came of it; both are in the store by now."""

    model: str
    """Version that was written, or analysed by; empty when there was nothing to learn from."""
    analysis: str = ""
    """Name under which what was found stands; the same for the same history and model."""
    passes: Annotated[int, Meta(ge=0)] = 0
    events: Annotated[int, Meta(ge=0)] = 0
    false_alarm_rate: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None
    """Of the model, held out."""
    left_out: dict[str, int] = msgspec.field(default_factory=dict)
    """Measurements that could not be used, by reason."""
    partial: str = ""
    """What is missing and why, when a shard did not answer."""


class Document(Message, frozen=True, kw_only=True):
    """A file that the cloud hands to trains and wayside sites: a line, landmarks, thresholds, a radio model."""

    kind: Literal["line", "landmarks", "gnss_thresholds", "radio_model"]
    name: Name
    version: str
    content: bytes
    """As the file stands on disk."""
    sha256: Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$")]
    """Of the content, in hexadecimal."""
