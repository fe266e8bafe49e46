"""The check of RTCM 3 frames, Galileo pages and SBAS messages.

CRC-24Q by Qualcomm: generator 1 + x + x^3 + x^4 + x^5 + x^6 + x^7 + x^10 + x^11 + x^14 + x^17 +
x^18 + x^23 + x^24, register zero at the start (RTCM 10403.3, 4.2; Galileo OS SIS ICD 2.1, 5.1.9.4).
"""

from __future__ import annotations

from typing import Final

_GENERATOR: Final = 0x1864CFB
_TOP: Final = 1 << 24


def _entry(byte: int) -> int:
    remainder = byte << 16
    for _ in range(8):
        remainder <<= 1
        if remainder & _TOP:
            remainder ^= _GENERATOR
    return remainder


_TABLE: Final = tuple(_entry(byte) for byte in range(256))


def crc24q(content: bytes) -> int:
    """Remainder of `content`; zero when its last three bytes are the check of those before.

    >>> hex(crc24q(b"123456789"))
    '0xcde703'
    """
    crc = 0
    for byte in content:
        crc = (crc << 8 & 0xFFFFFF) ^ _TABLE[crc >> 16 ^ byte]
    return crc


def crc24q_of_bits(number: int, length: int) -> int:
    """Remainder of a message of `length` bits, given as a number.

    Zeros in front change nothing, because the register starts at zero.
    """
    return crc24q(number.to_bytes(-(-length // 8), "big"))
