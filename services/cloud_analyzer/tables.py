"""The tables of the store, and how bridged records become their rows.

Every row keeps who said it (key, source, boot id, sequence), when it was measured (`t_ns`, as the sender's
clock had it) and `taken_ns`, the time that the store goes by: `t_ns` when that can be true, else the time at
which the bridge heard it, else the time at which it arrived here; `clock` says which.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import msgspec

from schemas.bridge import BridgedRecord
from schemas.codec import decoder_of, encode_json
from schemas.message import Message
from schemas.radio import RadioMeasurement
from schemas.topic import Address
from schemas.topics import topic_of

Kind = Literal["bigint", "double", "varchar"]
Value = str | int | float | None
DAY_NS: Final = 86_400 * 1_000_000_000
LATE_DAYS: Final = 60.0
"""A measurement this long before it was heard is not believed: spools do not reach back so far."""
AHEAD_NS: Final = 300 * 1_000_000_000
"""Nor one from so far ahead of it."""
HEARD_AHEAD_NS: Final = 300 * 1_000_000_000
"""A bridge's own clock may be so far ahead of ours; behind, by the age of its spool."""


@dataclass(frozen=True, slots=True)
class Table:
    """One table: its name and its columns."""

    name: str
    columns: tuple[tuple[str, Kind], ...]
    order: tuple[str, ...] = ("taken_ns", "key", "boot_id", "sequence")
    """Columns that tell its rows apart, in the order of its pages."""
    shard_by: str = "key"
    """Rows that agree in it go to the same shard."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in order."""
        return tuple(name for name, _ in self.columns)


_COMMON: Final[tuple[tuple[str, Kind], ...]] = (
    ("taken_ns", "bigint"),
    ("t_ns", "bigint"),
    ("clock", "varchar"),
    ("line", "varchar"),
    ("place", "varchar"),
    ("key", "varchar"),
    ("source", "varchar"),
    ("boot_id", "varchar"),
    ("sequence", "bigint"),
)
_MEASURED: Final[tuple[tuple[str, Kind], ...]] = (
    ("radio", "varchar"),
    ("channel", "varchar"),
    ("side", "varchar"),
    ("direction", "varchar"),
    ("branch", "varchar"),
    ("pass_id", "varchar"),
    ("train", "varchar"),
    ("cell", "varchar"),
    ("chainage_m", "double"),
    ("axis_m", "double"),
    ("place_bound_m", "double"),
    ("speed_mps", "double"),
    ("channel_power_dbm", "double"),
    ("decoded_power_dbm", "double"),
    ("received_ratio", "double"),
    ("corrected_bits", "double"),
    ("frequency_offset_hz", "double"),
    ("temperature_c", "double"),
    ("tx_power_dbm", "double"),
    ("snr_db", "double"),
    ("rsrq_db", "double"),
)
RADIO: Final = Table("radio", _COMMON + _MEASURED)
EVENTS: Final = Table(
    "events",
    (
        *_COMMON,
        ("topic", "varchar"),
        ("kind", "varchar"),
        ("radio", "varchar"),
        ("channel", "varchar"),
        ("chainage_m", "double"),
        ("message", "varchar"),
    ),
)
REFUSED: Final = Table(
    "refused",
    (("taken_ns", "bigint"), ("key", "varchar"), ("reason", "varchar"), ("payload_hex", "varchar")),
    order=("taken_ns", "key"),
)
TABLES: Final = (RADIO, EVENTS, REFUSED)
MOST_REFUSED_BYTES: Final = 65_536


class _Mark(msgspec.Struct, frozen=True, array_like=True, gc=False):
    source: str
    boot_id: str
    sequence: int


_MARKS = msgspec.msgpack.Decoder(_Mark)
_NO_MARK = _Mark("", "", -1)


@dataclass(slots=True)
class Rows:
    """Rows by table, in order."""

    radio: list[tuple[Value, ...]] = field(default_factory=list)
    events: list[tuple[Value, ...]] = field(default_factory=list)
    refused: list[tuple[Value, ...]] = field(default_factory=list)

    def of(self, table: Table) -> list[tuple[Value, ...]]:
        """Rows of a table."""
        return {"radio": self.radio, "events": self.events, "refused": self.refused}[table.name]

    def extend(self, other: Rows) -> None:
        """Append another's."""
        self.radio += other.radio
        self.events += other.events
        self.refused += other.refused

    def __len__(self) -> int:
        """Rows of all tables."""
        return len(self.radio) + len(self.events) + len(self.refused)


def rows_of(
    records: Sequence[BridgedRecord],
    now_ns: int,
    allowed: frozenset[str] | None,
    late_days: float = LATE_DAYS,
    ahead_ns: int = 0,
) -> Rows:
    """Rows of bridged records.

    `allowed`: places ('demo/train/T1') whose keys may be told; None for any. Times more than `late_days` before
    they were heard are not believed. `ahead_ns`: of the bridge's clock against ours, where it is known to be off;
    its times are set right by it. What cannot be taken becomes a row of `refused`, with the reason and what was
    said, so that nothing that was acknowledged is lost.
    """
    rows = Rows()
    hearing = _Hearing(now_ns, round(late_days * DAY_NS), ahead_ns)
    keys: dict[str, _Said] = {}
    for record in records:
        said = keys.get(record.key)
        if said is None:
            said = keys[record.key] = _said(record.key, allowed)
        reason = said.fault
        message: Message | None = None
        if said.decode is not None:
            try:
                message = said.decode(record.payload)
            except (msgspec.MsgspecError, ValueError, TypeError, OverflowError, RecursionError) as error:
                reason = f"{said.message}: {error}"
        if message is None:
            shown = record.payload[:MOST_REFUSED_BYTES].hex()
            rows.refused.append((hearing.believed_ns(record.heard_ns), record.key, reason, shown))
        elif type(message) is RadioMeasurement:
            rows.radio.append(_common(message.t_ns, record, said, hearing) + _measured(message))
        else:
            rows.events.append(_common(message.t_ns, record, said, hearing) + _event(message, said.topic))
    return rows


@dataclass(frozen=True, slots=True)
class _Said:
    """What is the same for everything under one key."""

    fault: str
    """Why it is not taken; empty when it may be."""
    decode: Callable[[bytes], Message] | None = None
    message: str = ""
    topic: str = ""
    line: str = ""
    where: str = ""


def _said(key: str, allowed: frozenset[str] | None) -> _Said:
    address = topic_of(key)
    fault = _fault(address, allowed)
    if fault or address is None:
        return _Said(fault)
    topic, place = address.topic, address.place
    where = f"{place.kind}/{place.name}"
    return _Said("", decoder_of(topic.message).decode, topic.message.__name__, topic.name, place.line, where)


def _fault(address: Address | None, allowed: frozenset[str] | None) -> str:
    if address is None:
        return "no topic of this version has the key"
    if address.mirrored:
        return "a mirrored key is not bridged again"
    if allowed is not None and str(address.place) not in allowed:
        return f"the bridge may not speak for {address.place}"
    return ""


@dataclass(frozen=True, slots=True)
class _Hearing:
    """By which clock a batch's times are judged."""

    now_ns: int
    late_ns: int
    ahead_ns: int
    """Of the bridge's clock."""

    def believed_ns(self, heard_ns: int) -> int:
        """When a record was heard, as far as its bridge can be believed; else now."""
        right_ns = heard_ns - self.ahead_ns
        return right_ns if self.now_ns - self.late_ns <= right_ns <= self.now_ns + HEARD_AHEAD_NS else self.now_ns

    def measured_ns(self, t_ns: int, heard_ns: int) -> int:
        """A sender's time, set right where it went by the bridge's clock: where it is nearer to what that said."""
        if abs(t_ns - heard_ns) < abs(t_ns - self.believed_ns(heard_ns)):
            return t_ns - self.ahead_ns
        return t_ns


def _common(t_ns: int, record: BridgedRecord, said: _Said, hearing: _Hearing) -> tuple[Value, ...]:
    try:
        mark = _MARKS.decode(record.attachment)
    except (msgspec.MsgspecError, ValueError, OverflowError, RecursionError):
        mark = _NO_MARK
    believed_ns = hearing.believed_ns(record.heard_ns)
    clock = "" if believed_ns == record.heard_ns else "bridge"
    taken_ns = hearing.measured_ns(t_ns, record.heard_ns)
    if not believed_ns - hearing.late_ns <= taken_ns <= believed_ns + AHEAD_NS:
        taken_ns = believed_ns
        clock = "device and bridge" if clock else "device"
    t_ns = max(-(2**63), min(2**63 - 1, t_ns))
    return (
        taken_ns,
        t_ns,
        clock,
        said.line,
        said.where,
        record.key,
        mark.source,
        mark.boot_id,
        mark.sequence,
    )


def _measured(message: RadioMeasurement) -> tuple[Value, ...]:
    return (
        message.radio,
        message.channel,
        message.side,
        message.direction or "",
        message.branch,
        message.pass_id,
        message.train,
        message.cell,
        message.chainage_m,
        message.axis_m,
        message.place_bound_m,
        message.speed_mps,
        message.channel_power_dbm,
        message.decoded_power_dbm,
        message.received_ratio,
        message.corrected_bits,
        message.frequency_offset_hz,
        message.temperature_c,
        message.tx_power_dbm,
        message.snr_db,
        message.rsrq_db,
    )


def _event(message: Message, topic: str) -> tuple[Value, ...]:
    place_m = getattr(message, "chainage_m", None)
    if place_m is None:
        place_m = getattr(message, "section_start_m", None)
    return (
        topic,
        str(getattr(message, "kind", "")),
        str(getattr(message, "radio", "")),
        str(getattr(message, "channel", "")),
        place_m,
        encode_json(message).decode(),
    )
