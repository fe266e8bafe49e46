"""Whether a Zenoh key expression matches a concrete key."""

from __future__ import annotations

from functools import lru_cache


@lru_cache(maxsize=16_384)
def intersects(expression: str, key: str) -> bool:
    """True when a key expression (`*` one chunk, `**` any number) matches a concrete key.

    >>> intersects("kirotei/v1/**", "kirotei/v1/demo/train/T1/gnss/front/fix")
    True
    >>> intersects("kirotei/v1/*/train/*/gnss/*/fix", "kirotei/v1/demo/train/T1/gnss/front/epoch")
    False
    """
    return _match(tuple(expression.split("/")), tuple(key.split("/")))


def _match(pattern: tuple[str, ...], chunks: tuple[str, ...]) -> bool:
    if not pattern:
        return not chunks
    if pattern[0] == "**":
        return any(_match(pattern[1:], chunks[start:]) for start in range(len(chunks) + 1))
    return bool(chunks) and pattern[0] in ("*", chunks[0]) and _match(pattern[1:], chunks[1:])
