"""Which keys are meant: key expressions as people type them."""

from __future__ import annotations

_SPECIAL = frozenset("*$?#")


def fault_of(expression: str) -> str | None:
    """What is wrong with a key expression, in words; None for a good one.

    Chunks between slashes are words, `*` (any one chunk) or `**` (any number of chunks). Zenoh's
    `$*` within a chunk is not taken, for recordings are searched without Zenoh.

    >>> fault_of("kirotei/v1/*/train/T1/**")
    >>> fault_of("kirotei//fix")
    'has an empty chunk'
    """
    chunks = expression.split("/")
    for chunk, following in zip(chunks, [*chunks[1:], ""], strict=True):
        if not chunk:
            return "has an empty chunk"
        if chunk not in ("*", "**") and _SPECIAL & set(chunk):
            return f"has {chunk!r}: a wildcard is a whole chunk, * or **"
        if chunk == "**" and following in ("*", "**"):
            return f"has {chunk}/{following}: write " + ("*/**" if following == "*" else "** once")
    return None
