"""Telegrams in the bits of CH1: preamble, circuit id, sequence, length, payload, check.

    preamble | circuit id 16 | sequence 16 | length 8 (bytes of payload) | payload | CRC-32C
Numbers are sent lowest bit first; the check covers everything behind the preamble.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.crc import bits_of, bytes_of, crc32c
from services.track_circuit.profile import Framing

HEADER_BYTES: Final = 5
CHECK_BYTES: Final = 4
LARGEST_FIELD: Final = 0xFFFF


@dataclass(frozen=True, slots=True)
class Frame:
    """A telegram as received."""

    symbol: int
    """Number of the preamble's first symbol."""
    symbols: int
    """How many it has, preamble included."""
    crc_ok: bool
    circuit_id: int | None
    """None, as the sequence, where the check failed: nothing in it can be believed."""
    sequence: int | None
    payload: bytes


def telegram_bits(circuit_id: int, sequence: int, payload: bytes, framing: Framing) -> NDArray[np.int8]:
    """The bits of one telegram. Raises ValueError for numbers and payloads that do not fit."""
    if not 0 <= circuit_id <= LARGEST_FIELD or not 0 <= sequence <= LARGEST_FIELD:
        msg = f"circuit id {circuit_id} and sequence {sequence} have 16 bits each"
        raise ValueError(msg)
    if len(payload) > framing.longest_payload:
        msg = f"a payload of {len(payload)} bytes is longer than {framing.longest_payload}"
        raise ValueError(msg)
    body = circuit_id.to_bytes(2, "little") + sequence.to_bytes(2, "little") + bytes([len(payload)]) + payload
    return np.concatenate([preamble_bits(framing), bits_of(body + crc32c(body).to_bytes(CHECK_BYTES, "little"))])


def preamble_bits(framing: Framing) -> NDArray[np.int8]:
    """The preamble, 0 or 1 each."""
    return np.array([int(bit) for bit in framing.preamble], np.int8)


def shortest_bits(framing: Framing) -> int:
    """Bits of a telegram without payload."""
    return len(framing.preamble) + 8 * (HEADER_BYTES + CHECK_BYTES)


class TelegramScanner:
    """Finds telegrams in bits that arrive piece by piece.

    A telegram with a good check wins over whatever overlaps it; a failed one is reported once no good one has begun
    within it. Random bits look like a preamble now and then: failures say little alone.
    """

    def __init__(self, framing: Framing) -> None:
        """Nothing heard yet."""
        self._framing = framing
        self._preamble = preamble_bits(framing)
        self._bits = np.empty(0, np.int8)
        self._first = 0
        self._failed: Frame | None = None

    def take(self, bits: NDArray[np.int8], first_symbol: int) -> list[Frame]:
        """Telegrams completed by these bits; a jump of the symbol number drops what was begun."""
        found: list[Frame] = []
        if first_symbol != self._first + len(self._bits):
            found = self.finish()
            self._bits, self._first = np.empty(0, np.int8), first_symbol
        self._bits = np.concatenate([self._bits, bits.astype(np.int8)])
        at = 0
        while (step := self._step(at, found)) > 0:
            at += step
        self._bits, self._first = self._bits[at:], self._first + at
        return found

    def finish(self) -> list[Frame]:
        """The failed telegram that still waited, if any; call at the end of a recording."""
        found = [] if self._failed is None else [self._failed]
        self._failed = None
        return found

    def _step(self, at: int, found: list[Frame]) -> int:
        """How many bits to go on; 0 when more are needed."""
        preamble = len(self._preamble)
        if self._failed is not None and self._first + at >= self._failed.symbol + self._failed.symbols:
            found.append(self._failed)
            self._failed = None
        if at + preamble + 8 * HEADER_BYTES > len(self._bits):
            return 0
        wrong = int(np.count_nonzero(self._bits[at : at + preamble] != self._preamble))
        if wrong > self._framing.preamble_errors:
            return 1
        header = bytes_of(self._bits[at + preamble : at + preamble + 8 * HEADER_BYTES])
        if header[4] > self._framing.longest_payload:
            return 1
        total = preamble + 8 * (HEADER_BYTES + header[4] + CHECK_BYTES)
        if at + total > len(self._bits):
            return 0
        frame = self._frame(at, total)
        if frame.crc_ok:
            if self._failed is not None and self._failed.symbol + self._failed.symbols <= frame.symbol:
                found.append(self._failed)
            self._failed = None
            found.append(frame)
            return total
        if self._failed is None:
            self._failed = frame
        return 1

    def _frame(self, at: int, total: int) -> Frame:
        body = bytes_of(self._bits[at + len(self._preamble) : at + total])
        message, check = body[:-CHECK_BYTES], int.from_bytes(body[-CHECK_BYTES:], "little")
        if crc32c(message) != check:
            return Frame(self._first + at, total, crc_ok=False, circuit_id=None, sequence=None, payload=b"")
        return Frame(
            symbol=self._first + at,
            symbols=total,
            crc_ok=True,
            circuit_id=int.from_bytes(message[0:2], "little"),
            sequence=int.from_bytes(message[2:4], "little"),
            payload=message[HEADER_BYTES:],
        )
