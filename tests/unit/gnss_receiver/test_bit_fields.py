"""Numbers in bits: whatever is written is read again, one by one and as columns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.gnss_receiver.bit_fields import BitReader, BitWriter, bits_of, column
from services.gnss_receiver.crc24q import crc24q, crc24q_of_bits


@st.composite
def fields(draw: st.DrawFn) -> list[tuple[str, int, int]]:
    """Kinds, values and widths that fit."""
    found = []
    for _ in range(draw(st.integers(1, 20))):
        width = draw(st.integers(2, 40))
        kind = draw(st.sampled_from(["uint", "sint", "magnitude"]))
        low = {"uint": 0, "sint": -(1 << (width - 1)), "magnitude": 1 - (1 << (width - 1))}[kind]
        high = (1 << width) - 1 if kind == "uint" else (1 << (width - 1)) - 1
        found.append((kind, draw(st.integers(low, high)), width))
    return found


@given(fields())
def test_what_is_written_is_read(numbers: list[tuple[str, int, int]]) -> None:
    writer = BitWriter()
    for kind, value, width in numbers:
        getattr(writer, kind)(value, width)
    reader = BitReader(writer.content())
    assert [getattr(reader, kind)(width) for kind, _, width in numbers] == [value for _, value, _ in numbers]
    assert writer.length == reader.at


@given(st.integers(0, 30), st.lists(st.integers(-(1 << 21), (1 << 21) - 1), max_size=20))
def test_columns_are_read_as_one_by_one(start: int, numbers: list[int]) -> None:
    writer = BitWriter()
    writer.uint(0, start)
    for number in numbers:
        writer.sint(number, 22)
    bits = bits_of(writer.content())
    assert column(bits, start, len(numbers), 22, signed=True).tolist() == numbers
    unsigned = column(bits, start, len(numbers), 22)
    assert np.array_equal(unsigned, np.array(numbers, np.int64) % (1 << 22))


def test_beyond_the_end_there_is_nothing() -> None:
    reader = BitReader(b"\xff\xff")
    reader.uint(10)
    with pytest.raises(ValueError, match="the message ends after 16 bits, 17 are wanted"):
        reader.uint(7)
    with pytest.raises(ValueError, match="the message ends after 12 bits"):
        BitReader(b"\xff\xff", 12).uint(13)
    with pytest.raises(ValueError, match="3 fields of 6 bits from bit 0 on do not fit into 16 bits"):
        column(bits_of(b"\xff\xff"), 0, 3, 6)


@pytest.mark.parametrize(("kind", "value"), [("uint", 8), ("uint", -1), ("sint", 4), ("sint", -5), ("magnitude", -4)])
def test_what_does_not_fit_is_refused(kind: str, value: int) -> None:
    with pytest.raises(ValueError, match=f"{value} does not fit into 3 bits"):
        getattr(BitWriter(), kind)(value, 3)


@given(st.binary(max_size=50), st.integers(0, 400))
def test_the_check_notices_every_flipped_bit(content: bytes, place: int) -> None:
    framed = content + crc24q(content).to_bytes(3, "big")
    assert crc24q(framed) == 0
    flipped = int.from_bytes(framed, "big") ^ 1 << (place % (8 * len(framed)))
    assert crc24q(flipped.to_bytes(len(framed), "big")) != 0
    assert crc24q_of_bits(int.from_bytes(content, "big"), 8 * len(content)) == crc24q(content)


def test_the_check_has_its_published_value() -> None:
    # Catalogue of parametrised CRC algorithms: CRC-24/LTE-A, which is CRC-24Q.
    assert crc24q(b"123456789") == 0xCDE703
