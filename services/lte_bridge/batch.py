"""Bridged records to compressed batches and back, whole or cut.

A batch is one zstd frame (RFC 8878) with checksum and content size, of a msgpack array of
`BridgedRecord`. Records are cut and joined without being decoded.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import msgspec
import zstandard

from schemas.bridge import BridgedRecord

LEVEL = 1
"""Of zstd: shrinks measurements to about a third at several hundred megabytes a second."""
MOST_PLAIN_BYTES = 8 * 1024 * 1024
"""Larger batches are neither made nor unpacked."""
CHUNK_RECORDS = 4096
CHUNK_BYTES = 512 * 1024

_ENCODER = msgspec.msgpack.Encoder()
_RECORDS = msgspec.msgpack.Decoder(list[BridgedRecord])
_PIECES = msgspec.msgpack.Decoder(list[msgspec.Raw])


class BatchError(ValueError):
    """Bytes that are no batch, or not of the records they say."""


def packed(records: Sequence[BridgedRecord | msgspec.Raw]) -> bytes:
    """Batch of records, or of pieces as `pieces` gives them."""
    return zstandard.ZstdCompressor(level=LEVEL, write_checksum=True).compress(_ENCODER.encode(records))


def unpacked(compressed: bytes, count: int) -> list[BridgedRecord]:
    """The `count` records of a batch. Raises BatchError."""
    plain = _plain(compressed)
    try:
        records = _RECORDS.decode(plain)
    except (msgspec.MsgspecError, ValueError, OverflowError, RecursionError) as error:
        msg = f"no array of records: {error}"
        raise BatchError(msg) from error
    _require_count(len(records), count)
    return records


def pieces(compressed: bytes, count: int) -> list[msgspec.Raw]:
    """The `count` records of a batch, still encoded, to be cut and joined. Raises BatchError."""
    plain = _plain(compressed)
    try:
        found = _PIECES.decode(plain)
    except (msgspec.MsgspecError, ValueError, OverflowError, RecursionError) as error:
        msg = f"no array: {error}"
        raise BatchError(msg) from error
    _require_count(len(found), count)
    return found


def heard_ns(piece: msgspec.Raw) -> int:
    """When a record still encoded was heard."""
    return msgspec.msgpack.decode(piece, type=BridgedRecord).heard_ns


def chunks(records: Iterable[BridgedRecord]) -> Iterator[list[BridgedRecord]]:
    """Records in groups that make batches of good size."""
    chunk: list[BridgedRecord] = []
    size = 0
    for record in records:
        chunk.append(record)
        size += len(record.payload)
        if len(chunk) >= CHUNK_RECORDS or size >= CHUNK_BYTES:
            yield chunk
            chunk, size = [], 0
    if chunk:
        yield chunk


def _plain(compressed: bytes) -> bytes:
    try:
        size = zstandard.frame_content_size(compressed)
        if not 0 <= size <= MOST_PLAIN_BYTES:
            msg = f"a batch of {size} bytes unpacked; 0 to {MOST_PLAIN_BYTES} are accepted"
            raise BatchError(msg)
        return zstandard.ZstdDecompressor().decompress(compressed, max_output_size=MOST_PLAIN_BYTES)
    except zstandard.ZstdError as error:
        msg = f"no zstd frame: {error}"
        raise BatchError(msg) from error


def _require_count(found: int, count: int) -> None:
    if found != count:
        msg = f"{found} records in a batch that says {count}"
        raise BatchError(msg)
