"""How recordings are named, and which of them go when they take too much room."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import UTC, datetime

SUFFIX = ".mcap"
PART_SUFFIX = ".mcap.part"
"""Worn while a recording is written; taken off when it is complete."""
DAMAGED_SUFFIX = ".damaged"
"""Given to what was found broken and is kept for a person to look at."""
_OWN = re.compile(r"kirotei-\d{8}T\d{6}\.\d{3}Z-\d{4,}\.mcap")


def recording_stem(first_ns: int, counter: int) -> str:
    """File name without suffix, from the time of the first message (UTC, Unix nanoseconds).

    Names sort by time, then by counter.

    >>> recording_stem(1_772_359_200_123_456_789, 7)
    'kirotei-20260301T100000.123Z-0007'
    """
    first = datetime.fromtimestamp(first_ns // 1_000_000_000, UTC)
    return f"kirotei-{first:%Y%m%dT%H%M%S}.{first_ns // 1_000_000 % 1000:03d}Z-{counter:04d}"


def is_own(name: str) -> bool:
    """True for the name of a complete recording as `recording_stem` makes it.

    >>> is_own("kirotei-20260301T100000.123Z-0007.mcap"), is_own("holiday.mcap")
    (True, False)
    """
    return _OWN.fullmatch(name) is not None


def is_own_part(name: str) -> bool:
    """True for the name of an unfinished recording of ours."""
    return name.endswith(PART_SUFFIX) and is_own(name.removesuffix(".part"))


def beyond_cap(sizes: Mapping[str, int], other_bytes: int, cap_bytes: int) -> list[str]:
    """Own recordings to delete, oldest first, so that the rest and `other_bytes` fit the cap.

    `sizes` holds bytes by file name; names that are not ours are never named.

    >>> beyond_cap({"kirotei-20260301T100000.000Z-0001.mcap": 60, "mine.mcap": 90}, 50, 100)
    ['kirotei-20260301T100000.000Z-0001.mcap']
    """
    own = sorted(name for name in sizes if is_own(name))
    total = other_bytes + sum(sizes[name] for name in own)
    chosen = []
    for name in own:
        if total <= cap_bytes:
            break
        chosen.append(name)
        total -= sizes[name]
    return chosen
