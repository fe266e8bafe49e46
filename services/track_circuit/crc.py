"""The check of telegrams: CRC-32C.

Generator 0x1EDC6F41 (Castagnoli, Bräuer and Herrmann 1993): Hamming distance 6 up to 5243 bits of data, where the
Ethernet polynomial reaches 6 only up to 268 bits (Koopman 2002). Every pattern of up to five wrong bits is found in
telegrams of every length that the framing allows, every burst of up to 32 bits too, and of arbitrary corruption all
but one in 2^32.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

REFLECTED: Final = 0x82F63B78
"""The generator with its lowest power in the highest bit, for bytes sent lowest bit first."""
WIDTH: Final = 32


def _table() -> tuple[int, ...]:
    found = []
    for byte in range(256):
        register = byte
        for _ in range(8):
            register = (register >> 1) ^ (REFLECTED if register & 1 else 0)
        found.append(register)
    return tuple(found)


_TABLE: Final = _table()


def crc32c(message: bytes) -> int:
    """The check of a message; begins with ones and is inverted at the end.

    >>> hex(crc32c(b"123456789"))
    '0xe3069283'
    """
    register = 0xFFFFFFFF
    for byte in message:
        register = (register >> 8) ^ _TABLE[(register ^ byte) & 0xFF]
    return register ^ 0xFFFFFFFF


def bits_of(message: bytes) -> NDArray[np.int8]:
    """Bits as they are sent: of each byte the lowest first, as the check's order demands."""
    return np.unpackbits(np.frombuffer(message, np.uint8), bitorder="little").astype(np.int8)


def bytes_of(bits: NDArray[np.int8]) -> bytes:
    """The bytes of bits in the order of `bits_of`; their number is a multiple of eight."""
    return np.packbits(bits.astype(np.uint8), bitorder="little").tobytes()


def undetected_per_hour(bit_rate_hz: float, shortest_bits: int, confirmations: int) -> float:
    """False telegrams accepted per hour when every received telegram is corrupted arbitrarily.

    Each passes the check with 2^-32, and `confirmations` in a row have to; telegrams follow each other without
    gaps and are the shortest that there are.
    """
    return 3600.0 * bit_rate_hz / shortest_bits * 2.0 ** (-WIDTH * confirmations)
