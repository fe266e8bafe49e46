"""Whole numbers in streams of bits, most significant bit first: one by one, or whole columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from schemas.arrays import Uint8s

Int64s = NDArray[np.int64]
_WIDEST_COLUMN = 62


class BitReader:
    """Reads the fields of a message one after the other. Beyond its end: ValueError."""

    def __init__(self, content: bytes, length: int | None = None) -> None:
        """Stand before the first bit; `length` in bits where the last byte is not full."""
        self._bits = int.from_bytes(content, "big")
        self._length = 8 * len(content)
        self._end = self._length if length is None else length
        self.at = 0

    def uint(self, width: int) -> int:
        """Next `width` bits as a number without sign."""
        self.at += width
        if self.at > self._end:
            msg = f"the message ends after {self._end} bits, {self.at} are wanted"
            raise ValueError(msg)
        return self._bits >> (self._length - self.at) & ((1 << width) - 1)

    def sint(self, width: int) -> int:
        """Next `width` bits in two's complement."""
        value = self.uint(width)
        return value - (1 << width) if value >> (width - 1) else value

    def magnitude(self, width: int) -> int:
        """Next `width` bits as sign and magnitude.

        >>> BitReader(bytes([0b1000_0011])).magnitude(8)
        -3
        """
        value = self.uint(width)
        size = value & ((1 << (width - 1)) - 1)
        return -size if value >> (width - 1) else size


class BitWriter:
    """Writes fields one after the other; what does not fit into its width: ValueError."""

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._bits = 0
        self.length = 0

    def uint(self, value: int, width: int) -> None:
        """Append a number without sign."""
        if not 0 <= value < 1 << width:
            msg = f"{value} does not fit into {width} bits"
            raise ValueError(msg)
        self._bits = self._bits << width | value
        self.length += width

    def sint(self, value: int, width: int) -> None:
        """Append a number in two's complement."""
        half = 1 << (width - 1)
        if not -half <= value < half:
            msg = f"{value} does not fit into {width} bits with a sign"
            raise ValueError(msg)
        self.uint(value & ((1 << width) - 1), width)

    def magnitude(self, value: int, width: int) -> None:
        """Append a number as sign and magnitude."""
        if abs(value) >= 1 << (width - 1):
            msg = f"{value} does not fit into {width} bits with a sign"
            raise ValueError(msg)
        self.uint(abs(value) | (value < 0) << (width - 1), width)

    def content(self) -> bytes:
        """Everything written, the last byte filled up with zeros."""
        count = -(-self.length // 8)
        return (self._bits << (8 * count - self.length)).to_bytes(count, "big")


def bits_of(content: bytes) -> Uint8s:
    """Bits of `content`, one to an element."""
    return np.unpackbits(np.frombuffer(content, np.uint8))


def column(bits: Uint8s, at: int, count: int, width: int, *, signed: bool = False) -> Int64s:
    """`count` numbers of `width` bits that stand one after the other from bit `at` on.

    Raises ValueError when the bits end before.
    """
    stop = at + count * width
    if stop > len(bits) or width > _WIDEST_COLUMN:
        msg = f"{count} fields of {width} bits from bit {at} on do not fit into {len(bits)} bits"
        raise ValueError(msg)
    weights = 1 << np.arange(width - 1, -1, -1, dtype=np.int64)
    if signed:
        weights[0] = -weights[0]
    numbers: Int64s = bits[at:stop].reshape(count, width) @ weights
    return numbers
