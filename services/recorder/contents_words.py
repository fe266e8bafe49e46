"""Contents of a recording in words and as JSON."""

from __future__ import annotations

from datetime import UTC, datetime

from services.recorder.contents_file import Contents, KeyContents


def utc(time_ns: int) -> str:
    """Calendar time of Unix nanoseconds, to the millisecond.

    >>> utc(1_772_359_200_123_456_789)
    '2026-03-01 10:00:00.123'
    """
    return f"{datetime.fromtimestamp(time_ns // 10**9, UTC):%Y-%m-%d %H:%M:%S}.{time_ns // 10**6 % 1000:03d}"


def megabytes(octets: float) -> str:
    """Size in words.

    >>> megabytes(12_345_678), megabytes(2_500)
    ('12.3 MB', '2.5 kB')
    """
    return f"{octets / 1e6:.1f} MB" if octets >= 1e6 else f"{octets / 1e3:.1f} kB"  # noqa: PLR2004 - a megabyte


def contents_json(contents: Contents) -> dict[str, object]:
    """Everything, for a program."""
    return {
        "file": str(contents.path),
        "bytes": contents.file_bytes,
        "complete": contents.complete,
        "messages": contents.messages,
        "lost_messages": contents.lost_messages,
        "first_ns": contents.first_ns,
        "last_ns": contents.last_ns,
        "faults": [f"byte {fault.offset}: {fault.what}" for fault in contents.faults],
        "keys": [_key_json(entry) for _, entry in sorted(contents.keys.items())],
    }


def _key_json(entry: KeyContents) -> dict[str, object]:
    return {
        "key": entry.key,
        "topic": entry.topic,
        "messages": entry.messages,
        "bytes": entry.octets,
        "rate_hz": entry.rate_hz,
        "first_ns": entry.first_ns,
        "last_ns": entry.last_ns,
        "longest_silence_s": entry.longest_silence_s,
        "missing": entry.missing,
        "restarts": entry.restarts,
        "sources": sorted(entry.senders),
    }


def contents_text(contents: Contents) -> str:
    """A table for a person."""
    first_ns, last_ns = contents.first_ns, contents.last_ns
    state = "complete" if contents.complete else "unfinished"
    head = f"{contents.path}: {state}, {megabytes(contents.file_bytes)}, {contents.messages} messages"
    lines = [head]
    if first_ns is not None and last_ns is not None:
        lines.append(f"{utc(first_ns)} to {utc(last_ns)} UTC, {(last_ns - first_ns) / 1e9:.1f} s")
    rows: list[tuple[str, ...]] = [("messages", "rate", "missing", "restarts", "silence", "key")]
    rows += [_row(entry) for _, entry in sorted(contents.keys.items())]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    if contents.keys:
        lines.append("")
        lines += [
            "  ".join([*(cell.rjust(width) for cell, width in zip(row, widths, strict=False)), row[-1]]) for row in rows
        ]
    sources = sorted({source for entry in contents.keys.values() for source in entry.senders})
    if sources:
        lines += ["", f"senders: {', '.join(sources)}"]
    if contents.lost_messages:
        lines.append(f"lost in damaged parts of the file: {contents.lost_messages} messages")
    return "\n".join(lines)


def _row(entry: KeyContents) -> tuple[str, ...]:
    rate = "" if entry.rate_hz is None else f"{entry.rate_hz:.2f} Hz"
    missing, restarts = str(entry.missing or ""), str(entry.restarts or "")
    return str(entry.messages), rate, missing, restarts, f"{entry.longest_silence_s:.1f} s", entry.key
