"""Whether a line file may be used on a day."""

from __future__ import annotations

from datetime import date
from typing import NamedTuple

from schemas.line import Line


class Validity(NamedTuple):
    """Answer with its reason."""

    usable: bool
    reason: str


def line_validity(line: Line, day: date) -> Validity:
    """Whether a line file may be used on a day; both of its days are included, and one that is absent sets no limit.

    Raises ValueError for days that no calendar has.

    >>> line_validity(Line(id="x", name="x", axis=((0, 0, 0), (0, 1, 0)), valid_from="2026-04-01"), date(2026, 3, 31))
    Validity(usable=False, reason='line x version unstated is valid from 2026-04-01 on')
    """
    known_as = f"line {line.id} version {line.version or 'unstated'}"
    if line.valid_from is not None and day < date.fromisoformat(line.valid_from):
        return Validity(usable=False, reason=f"{known_as} is valid from {line.valid_from} on")
    if line.valid_until is not None and day > date.fromisoformat(line.valid_until):
        return Validity(usable=False, reason=f"{known_as} was valid until {line.valid_until}")
    return Validity(usable=True, reason=f"{known_as} is valid on {day.isoformat()}")
