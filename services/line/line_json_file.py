"""Writes line files: JSON, each list's entries on lines of their own, so that people can read and compare them."""

from __future__ import annotations

from pathlib import Path

import msgspec

from schemas.line import Line


def line_text(line: Line) -> bytes:
    """A line file's bytes; fields that have their default are left out where that changes nothing."""
    fields = []
    for name in line.__struct_fields__:
        given = getattr(line, name)
        if given in ((), None, ""):
            continue
        if isinstance(given, tuple):
            entries = b",\n".join(b"    " + msgspec.json.encode(one) for one in given)
            fields.append(b'  "%s": [\n%s\n  ]' % (name.encode(), entries))
        else:
            fields.append(b'  "%s": %s' % (name.encode(), msgspec.json.encode(given)))
    return b"{\n" + b",\n".join(fields) + b"\n}\n"


def write_line(path: Path, line: Line) -> None:
    """Write a line file beside its place, then move it there: no half of one is ever left. Raises OSError."""
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_bytes(line_text(line))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
