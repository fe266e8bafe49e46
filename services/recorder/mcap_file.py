"""Samples into an MCAP file: one channel per key, sender and start of the sender.

The attachment comes back byte for byte: its source and boot id stand in the channel's
metadata, its sequence number and send time in the message (`sequence`, `publish_time`);
`log_time` is the time of reception. What a foreign sender attached, or numbers that MCAP
has no room for, are kept in front of the payload on a channel that says so.

The same samples and the same flushes give the same bytes: nothing is read from a clock.
"""

from __future__ import annotations

import json
import struct
from functools import cache
from typing import Literal, NamedTuple, Protocol

from mcap.writer import CompressionType, Writer

from schemas.codec import json_schema
from schemas.message import Message
from schemas.topic import Topic
from schemas.topics import topic_of
from services.runtime.attachment import Attachment, decode_attachment, encode_attachment
from services.runtime.node import Sample

Compression = Literal["zstd", "none"]
PROFILE = "kirotei"
LIBRARY = "kirotei recorder 1"
"""Goes into the header; a number of our own, so that an update of a library changes no recording."""
CHUNK_BYTES = 1024 * 1024
MAX_CHANNELS = 60_000
"""MCAP numbers channels with 16 bits; the rest is kept free for whoever adds channels later."""
FOREIGN_ENCODING = "kirotei-foreign"
"""Message encoding of length-prefixed attachment (4 bytes, little-endian), then payload."""
_UINT32 = 1 << 32
_UINT64 = 1 << 64
_LENGTH = struct.Struct("<I")
_COMPRESSIONS = {"zstd": CompressionType.ZSTD, "none": CompressionType.NONE}


class UnrecordableError(ValueError):
    """A sample that no MCAP file can hold."""


class ChannelsExhaustedError(UnrecordableError):
    """This file has no room for a further channel; another file has."""


class Lane(NamedTuple):
    """What all samples of one channel have in common."""

    key: str
    mark: Literal["kirotei", "none", "foreign"]
    """What was attached: our own mark, nothing, or something else."""
    source: str = ""
    boot_id: str = ""


class Laid(NamedTuple):
    """One sample as it stands in a file."""

    lane: Lane
    sequence: int
    sent_ns: int
    octets: bytes


class Sink(Protocol):
    """Where a recording's bytes go."""

    def write(self, octets: bytes, /) -> int:
        """Take bytes."""

    def tell(self) -> int:
        """Bytes taken so far."""

    def flush(self) -> None:
        """Make what was taken safe."""


def is_recordable(sample: Sample) -> bool:
    """True unless the time of reception is one that MCAP cannot hold (before 1970, after 2554)."""
    return 0 <= sample.received_ns < _UINT64


def lay(sample: Sample) -> Laid:
    """Place of a sample in a file; `lift` undoes it exactly."""
    attached = sample.attachment
    if not attached:
        return Laid(Lane(sample.key, "none"), 0, sample.received_ns, sample.payload)
    mark = decode_attachment(attached)
    if (
        mark is not None
        and 0 <= mark.sequence < _UINT32
        and 0 <= mark.sent_ns < _UINT64
        and encode_attachment(mark) == attached
    ):
        return Laid(Lane(sample.key, "kirotei", mark.source, mark.boot_id), mark.sequence, mark.sent_ns, sample.payload)
    octets = _LENGTH.pack(len(attached)) + attached + sample.payload
    return Laid(Lane(sample.key, "foreign"), 0, sample.received_ns, octets)


def lift(laid: Laid, received_ns: int) -> Sample:
    """Sample that was laid. Raises ValueError when a foreign attachment is cut short."""
    lane = laid.lane
    if lane.mark == "kirotei":
        attached = encode_attachment(Attachment(lane.source, lane.boot_id, laid.sequence, laid.sent_ns))
        return Sample(lane.key, laid.octets, attached, received_ns)
    if lane.mark == "none":
        return Sample(lane.key, laid.octets, b"", received_ns)
    end = _LENGTH.size + int.from_bytes(laid.octets[: _LENGTH.size], "little")
    if len(laid.octets) < end:
        msg = f"attachment on {lane.key} is cut short"
        raise ValueError(msg)
    return Sample(lane.key, laid.octets[end:], laid.octets[_LENGTH.size : end], received_ns)


@cache
def _schema_of(message: type[Message]) -> bytes:
    return json.dumps(json_schema(message), sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()


class RecordingWriter:
    """Writes one MCAP file. `flush` makes what was written readable, `finish` completes the file."""

    def __init__(self, sink: Sink, compression: Compression = "zstd", chunk_bytes: int = CHUNK_BYTES) -> None:
        """Write the header."""
        self.messages = 0
        self._writer = Writer(sink, chunk_size=chunk_bytes, compression=_COMPRESSIONS[compression])  # type: ignore[arg-type]  # it wants all of IO and uses write, tell and flush
        self._writer.start(profile=PROFILE, library=LIBRARY)
        self._schemas: dict[str, int] = {}
        self._channels: dict[Lane, int] = {}

    def write(self, sample: Sample) -> None:
        """Append a sample.

        Raises UnrecordableError for a time of reception that MCAP cannot hold and
        ChannelsExhaustedError when the file has no channel left; nothing is written then.
        """
        if not is_recordable(sample):
            msg = f"{sample.key}: time of reception {sample.received_ns} ns cannot be recorded"
            raise UnrecordableError(msg)
        laid = lay(sample)
        channel = self._channels.get(laid.lane)
        if channel is None:
            channel = self._open_channel(laid.lane)
        self._writer.add_message(channel, sample.received_ns, laid.octets, laid.sent_ns, laid.sequence)
        self.messages += 1

    def flush(self) -> None:
        """End the chunk in progress and flush the sink."""
        self._writer.flush()  # type: ignore[no-untyped-call]  # the library leaves return types out

    def finish(self) -> None:
        """Write indexes and footer, and flush the sink. Nothing may be written afterwards."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # as above
        self._writer.flush()  # type: ignore[no-untyped-call]  # as above

    def _open_channel(self, lane: Lane) -> int:
        if len(self._channels) >= MAX_CHANNELS:
            msg = f"{lane.key}: the recording already has {MAX_CHANNELS} channels"
            raise ChannelsExhaustedError(msg)
        address = topic_of(lane.key)
        topic = address.topic if address is not None else None
        encoding = "" if topic is None else "msgpack"
        number = self._writer.register_channel(
            lane.key,
            FOREIGN_ENCODING if lane.mark == "foreign" else encoding,
            0 if topic is None or lane.mark == "foreign" else self._schema(topic),
            _metadata(lane, topic),
        )
        self._channels[lane] = number
        return number

    def _schema(self, topic: Topic[Message]) -> int:
        number = self._schemas.get(topic.schema_name)
        if number is None:
            number = self._writer.register_schema(topic.schema_name, "jsonschema", _schema_of(topic.message))
            self._schemas[topic.schema_name] = number
        return number


def _metadata(lane: Lane, topic: Topic[Message] | None) -> dict[str, str]:
    found: dict[str, str] = {"attachment": lane.mark}
    if lane.mark == "kirotei":
        found |= {"source": lane.source, "boot_id": lane.boot_id}
    if topic is not None:
        found |= {"topic": topic.template, "delivery": topic.delivery.value}
    return found


def lane_of(key: str, metadata: dict[str, str]) -> Lane:
    """Lane that a channel's topic and metadata stand for; a foreign file's channels carry no attachment."""
    mark = metadata.get("attachment")
    if mark == "kirotei":
        return Lane(key, "kirotei", metadata.get("source", ""), metadata.get("boot_id", ""))
    return Lane(key, "foreign" if mark == "foreign" else "none")
