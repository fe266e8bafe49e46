"""Lines and fixed-width fields of a text held as bytes, many at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Characters = NDArray[np.uint8]
"""Shape (lines, width)."""

BLANK, NEWLINE, RETURN, ZERO = 0x20, 0x0A, 0x0D, 0x30


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of a buffer: where each starts and ends (line break excluded), and its number in the file."""

    buffer: NDArray[np.uint8]
    """Shape (bytes,); never empty."""
    starts: Ints
    ends: Ints
    numbers: Ints
    """Counted from 1."""

    def __len__(self) -> int:
        """Give the number of lines."""
        return len(self.starts)

    def select(self, which: Bools | slice) -> Lines:
        """Only some of the lines, of the same buffer."""
        return Lines(self.buffer, self.starts[which], self.ends[which], self.numbers[which])

    def text(self, index: int) -> str:
        """Line `index` as text; what is not ASCII is replaced."""
        raw = self.buffer[int(self.starts[index]) : int(self.ends[index])].tobytes()
        return raw.decode("ascii", errors="replace")

    def characters(self, which: Ints, offset: Ints | int, width: int) -> Characters:
        """`width` characters of the lines `which` from column `offset`; blanks beyond the end of a line."""
        at = (self.starts[which] + offset)[:, np.newaxis] + np.arange(width)
        inside = at < self.ends[which][:, np.newaxis]
        return np.where(inside, self.buffer[np.minimum(at, len(self.buffer) - 1)], np.uint8(BLANK))

    def character(self, offset: int) -> NDArray[np.uint8]:
        """Character in column `offset` of every line; blank beyond its end."""
        at = self.starts + offset
        found = self.buffer[np.minimum(at, len(self.buffer) - 1)]
        found[at >= self.ends] = BLANK
        return found


def split_lines(content: bytes) -> Lines:
    """Lines of a file; ends of line are LF or CR LF, the last one may be missing."""
    buffer = np.frombuffer(content or b"\n", dtype=np.uint8)
    breaks = np.flatnonzero(buffer == NEWLINE)
    if buffer[-1] != NEWLINE:
        breaks = np.append(breaks, len(buffer))
    starts = np.concatenate([np.zeros(1, np.int64), breaks[:-1] + 1])
    ends = breaks - ((breaks > starts) & (buffer[breaks - 1] == RETURN))
    return Lines(buffer, starts, ends, np.arange(1, len(starts) + 1))


def integers(characters: Characters) -> tuple[Ints, Bools]:
    """Unsigned integers, right-aligned among blanks, and which of them are readable.

    >>> integers(np.frombuffer(b" 12  x5 ", np.uint8).reshape(2, 4))
    (array([0, 0]), array([False, False]))
    >>> integers(np.frombuffer(b"  12", np.uint8).reshape(1, 4))
    (array([12]), array([ True]))
    """
    digits = characters - np.uint8(ZERO)
    is_digit = digits < 10  # noqa: PLR2004 - the ten digits
    is_blank = characters == BLANK
    good: Bools = (is_digit | is_blank).all(axis=1) & is_digit[:, -1]
    good &= ~(is_blank[:, 1:] & is_digit[:, :-1]).any(axis=1)
    powers = 10 ** np.arange(characters.shape[1] - 1, -1, -1, dtype=np.int64)
    value = np.where(is_digit, digits, 0).astype(np.int64) @ powers
    return np.where(good, value, 0), good


def is_blank_line(lines: Lines, index: int) -> bool:
    """Whether a line holds nothing but white space."""
    return not lines.buffer[int(lines.starts[index]) : int(lines.ends[index])].tobytes().strip()
