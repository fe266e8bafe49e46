"""Samples out of an MCAP file, whole or broken.

Every record is read in full before it is believed, and every chunk must match its checksum:
from a damaged file come the messages that are certain, or none. The stock library's readers
are less strict (a record cut short at the end of a file can come out shortened), which is
why records are framed here.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from services.recorder.mcap_file import PROFILE, Laid, Lane, lane_of, lift
from services.runtime.key_expression import intersects
from services.runtime.node import Sample

MAX_CHUNK_BYTES = 1 << 30
"""A chunk that claims more when unpacked is taken for damaged."""
FOOTER_BYTES = 9 + 20 + len(MCAP0_MAGIC)
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQII")
_LENGTH64 = struct.Struct("<Q")
_OUR_PROFILE = struct.pack("<I", len(PROFILE)) + PROFILE.encode()
_INDEX_HEAD_BYTES = 6
_INDEX_ENTRY_BYTES = 16


class RecordingError(ValueError):
    """A file that is no recording, or is damaged; the text names file and place."""


class Fault(NamedTuple):
    """Something in a file that could not be read."""

    offset: int
    what: str
    is_end: bool = False
    """Only the end of the file is missing, as after a crash; whatever stood before is whole."""


class Scanner:
    """Reads an MCAP stream from its beginning and tells every fault to `on_fault`.

    A damaged chunk is passed over; at a record that does not end within the file reading ends.
    """

    def __init__(
        self, stream: BinaryIO, on_fault: Callable[[Fault], None], lanes: dict[int, Lane] | None = None
    ) -> None:
        """Measure the stream. `lanes` gives channels that are known already, by number."""
        self.size = stream.seek(0, io.SEEK_END)
        stream.seek(0)
        self._stream = stream
        self._on_fault = on_fault
        self._lanes = dict(lanes or {})
        self._ours = False  # ours hold every message in a chunk; one outside is a damaged record of another kind
        self._chunk_lost = False
        self.messages = 0
        self.lost_messages = 0
        """Messages known to be lost, from the indexes behind damaged chunks."""
        self.whole_bytes = 0
        """Where the last whole record ends."""
        self.finished = False
        """The footer and the closing magic were seen."""

    def samples(self) -> Iterator[Sample]:
        """Samples in the order of the file."""
        start = self._stream.read(len(MCAP0_MAGIC))
        if start != MCAP0_MAGIC:
            cut = MCAP0_MAGIC.startswith(start)
            what = f"ends after {len(start)} bytes" if cut else "not an MCAP recording: its first bytes are others"
            self._on_fault(Fault(0, what, is_end=cut))
            return
        self.whole_bytes = len(MCAP0_MAGIC)
        for opcode, body in self._records():
            if opcode == Opcode.CHUNK:
                yield from self._chunk(body)
            elif opcode in (Opcode.CHANNEL, Opcode.MESSAGE) and not self._ours:
                yield from self._inner(opcode, body)
            elif opcode == Opcode.HEADER:
                self._ours = body.startswith(_OUR_PROFILE)
            elif opcode == Opcode.MESSAGE_INDEX and self._chunk_lost:
                self.lost_messages += max(0, len(body) - _INDEX_HEAD_BYTES) // _INDEX_ENTRY_BYTES

    def _records(self) -> Iterator[tuple[int, bytes]]:
        while True:
            head = self._stream.read(_RECORD.size)
            if len(head) < _RECORD.size:
                break
            opcode, length = _RECORD.unpack(head)
            if length > self.size - self.whole_bytes - _RECORD.size:
                break
            body = self._stream.read(length)
            if len(body) < length:
                break
            yield opcode, body
            self.whole_bytes += _RECORD.size + length
            if opcode == Opcode.FOOTER:
                if self._stream.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC:
                    self.whole_bytes += len(MCAP0_MAGIC)
                    self.finished = True
                break
        left = self.size - self.whole_bytes
        if not self.finished:
            what = f"ends in the middle of a record, {left} bytes cannot be used" if left else "ends without its index"
            self._on_fault(Fault(self.whole_bytes, what, is_end=True))
        elif left:
            self._on_fault(Fault(self.whole_bytes, f"{left} bytes behind the end of the recording"))

    def _chunk(self, body: bytes) -> Iterator[Sample]:
        self._chunk_lost = False
        try:
            records = _unpacked(body)
        except (ValueError, MemoryError, struct.error, RuntimeError, ZstdError) as error:
            self._chunk_lost = True
            self._on_fault(Fault(self.whole_bytes, f"damaged chunk: {error}"))
            return
        position = 0
        while len(records) - position >= _RECORD.size:
            opcode, length = _RECORD.unpack_from(records, position)
            position += _RECORD.size + length
            if position <= len(records):
                yield from self._inner(opcode, records[position - length : position])
        if position != len(records):
            self._on_fault(Fault(self.whole_bytes, "records do not fill their chunk"))

    def _inner(self, opcode: int, body: bytes) -> Iterator[Sample]:
        try:
            if opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(io.BytesIO(body)))
                self._lanes[channel.id] = lane_of(channel.topic, channel.metadata)
            elif opcode == Opcode.MESSAGE:
                yield self._message(body)
        except (ValueError, struct.error, McapError) as error:
            self._on_fault(Fault(self.whole_bytes, f"damaged record: {error}"))
            self.lost_messages += opcode == Opcode.MESSAGE

    def _message(self, body: bytes) -> Sample:
        channel, sequence, received_ns, sent_ns = _MESSAGE.unpack_from(body)
        lane = self._lanes.get(channel)
        if lane is None:
            msg = f"message of channel {channel}, which is not described"
            raise ValueError(msg)
        sample = lift(Laid(lane, sequence, sent_ns, body[_MESSAGE.size :]), received_ns)
        self.messages += 1
        return sample


def _unpacked(body: bytes) -> bytes:
    """Records of a chunk. Raises ValueError, or the decompressor's own error, when it is damaged."""
    start_ns, end_ns, size, checksum, name_length = _CHUNK.unpack_from(body)
    start = _CHUNK.size + name_length
    name = body[_CHUNK.size : start].decode("ascii")
    (length,) = _LENGTH64.unpack_from(body, start)
    packed = body[start + _LENGTH64.size :]
    if len(packed) != length or size > MAX_CHUNK_BYTES:
        msg = f"{len(packed)} bytes where {length} are announced for {size} unpacked"
        raise ValueError(msg)
    chunk = Chunk(
        compression=name,
        data=packed,
        message_start_time=start_ns,
        message_end_time=end_ns,
        uncompressed_crc=checksum,
        uncompressed_size=size,
    )
    stream, found = get_chunk_data_stream(chunk, validate_crc=True)
    if found != size:
        msg = f"{found} bytes unpacked where {size} are announced"
        raise ValueError(msg)
    return stream.read(found)


def lanes_in_summary(stream: BinaryIO) -> dict[int, Lane]:
    """Channels by number as the summary at a file's end has them; none when there is no summary."""
    summary = _summary(stream)
    if summary is None:
        return {}
    return {number: lane_of(channel.topic, channel.metadata) for number, channel in summary.channels.items()}


def message_count(path: Path) -> int:
    """Messages in a file as its summary has it; 0 when it has none. Raises OSError."""
    with path.open("rb") as stream:
        summary = _summary(stream)
    return summary.statistics.message_count if summary is not None and summary.statistics is not None else 0


def _summary(stream: BinaryIO) -> Summary | None:
    """Summary at the end of a file; None when there is none that can be read."""
    try:
        return SeekingReader(stream).get_summary()
    except (McapError, ValueError, struct.error, OSError, StopIteration, MemoryError):
        return None


def read_recording(path: Path, key_expression: str | None = None) -> Iterator[Sample]:
    """Samples of a complete recording, in the order in which they were recorded.

    Raises RecordingError, naming file and byte, at the first thing that is wrong; OSError
    when the file cannot be opened.
    """

    def refuse(fault: Fault) -> None:
        hint = f"; `kirotei recording repair {path}` saves what can be saved" if fault.offset else ""
        msg = f"{path}: byte {fault.offset}: {fault.what}{hint}"
        raise RecordingError(msg)

    with path.open("rb") as stream:
        for sample in Scanner(stream, refuse).samples():
            if key_expression is None or intersects(key_expression, sample.key):
                yield sample


def require_complete(path: Path) -> None:
    """Raise RecordingError unless the file begins and ends as a recording does (its middle is not read)."""
    with path.open("rb") as stream:
        size = stream.seek(0, io.SEEK_END)
        stream.seek(0)
        if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            msg = f"{path}: not an MCAP recording (its first bytes are others)"
            raise RecordingError(msg)
        stream.seek(max(0, size - FOOTER_BYTES))
        end = stream.read()
        if len(end) < FOOTER_BYTES or end[0] != Opcode.FOOTER or not end.endswith(MCAP0_MAGIC):
            msg = f"{path}: unfinished recording; `kirotei recording repair {path}` completes it"
            raise RecordingError(msg)
