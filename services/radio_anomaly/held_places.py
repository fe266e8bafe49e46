"""Places that a receiver repeats until the train has gone on, put between one fix and the next by time.

A receiver that tells a new place only every hundred metres leaves each reading up to a hundred metres behind the train,
by another amount on every pass. Where power changes by 10 dB within a section that alone looks like a fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import msgspec

from services.radio_anomaly.reading import Reading

LEAST_MPS: Final = 5.0
"""A train that was slower from one place to the next may have stood anywhere between: its readings stay."""
FASTEST_MPS: Final = 100.0
"""Nor is a place that was reached faster than this the next one of the same train."""


def placed_by_time(readings: Sequence[Reading]) -> list[Reading]:
    """Readings of one pass in order of time; what repeats a place lies evenly in time between that and the next.

    Places that are never repeated, and the last place of a pass, stay as they are.
    """
    found = list(readings)
    rows = [k for k, one in enumerate(readings) if one.chainage_m is not None]
    first = [row for k, row in enumerate(rows) if not k or readings[rows[k - 1]].chainage_m != readings[row].chainage_m]
    for begin, end in pairwise(first):
        here, there = readings[begin], readings[end]
        span_ns = there.t_ns - here.t_ns
        if here.chainage_m is None or there.chainage_m is None or span_ns <= 0:
            continue
        gap_m = there.chainage_m - here.chainage_m
        if not LEAST_MPS <= abs(gap_m) * 1e9 / span_ns <= FASTEST_MPS:
            continue
        for row in range(begin + 1, end):
            one = readings[row]
            if one.chainage_m is not None:
                place_m = here.chainage_m + gap_m * (one.t_ns - here.t_ns) / span_ns
                found[row] = msgspec.structs.replace(one, chainage_m=place_m)
    return found
