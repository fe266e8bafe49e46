"""What can be wrong with a line file, and how it is said."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning"]


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong, or looks so."""

    severity: Severity
    """`error`: something would be computed wrongly. `warning`: unusual, or less than the file could say."""
    field: str
    """Path in the file, as `$.curves[3].radius_m`."""
    text: str
    """What is wrong."""
    advice: str
    """What to do about it."""


def error(field: str, text: str, advice: str) -> Problem:
    """Something that would be computed wrongly."""
    return Problem("error", field, text, advice)


def warning(field: str, text: str, advice: str) -> Problem:
    """Something unusual."""
    return Problem("warning", field, text, advice)
