"""MTData2 messages of Xsens (Movella) MTi sensors (MT Low Level Communication Protocol).

A message: FA FF 36, length, packets, checksum; all bytes after FA add up to 0 modulo 256. A packet:
identifier (two bytes), length, content, most significant byte first. The last four bits of an identifier
name the frame and the number format; read here are single precision (0) and double precision (3).
"""

from __future__ import annotations

import math
import struct
from typing import Final

from services.motion_sensors.imu_sample import ImuSample, new_counts

_START: Final = b"\xfa\xff\x36"
_EXTENDED: Final = 0xFF
"""A length of this says that two more bytes of length follow."""
_COUNTER, _TIME_FINE, _TEMPERATURE, _ACCELERATION, _RATE = 0x1020, 0x1060, 0x0810, 0x4020, 0x8020
_KIND: Final = 0xFFF0
_FORMATS: Final = {0: ("f", 4), 3: ("d", 8)}
_LONGEST: Final = 2048
"""Bytes of the longest message's content; what claims more is no start of one."""
_TICK_S: Final = 1e-4


class XsensFrames:
    """Finds and decodes messages that hold acceleration and rate of turn."""

    counter_modulus = 65_536

    def __init__(self) -> None:
        """Begin between messages."""
        self._rest = b""
        self.counts = new_counts()

    def feed(self, chunk: bytes) -> list[ImuSample]:
        """Samples that the bytes complete."""
        buffer, samples = self._rest + chunk, []
        while True:
            start = buffer.find(_START)
            if start < 0:
                kept = buffer[-2:] if buffer.endswith((b"\xfa", b"\xfa\xff")) else b""
                self.counts["skipped_bytes"] += len(buffer) - len(kept)
                self._rest = kept
                break
            self.counts["skipped_bytes"] += start
            buffer = buffer[start:]
            head, length = _head(buffer)
            if length <= _LONGEST and (head < 0 or len(buffer) < head + length + 1):
                self._rest = buffer
                break
            if length > _LONGEST or sum(buffer[1 : head + length + 1]) & 0xFF:
                self.counts["checksum_errors"] += 1
                buffer = buffer[1:]
                continue
            sample = _sample(buffer[head : head + length])
            if sample is not None:
                samples.append(sample)
            buffer = buffer[head + length + 1 :]
        self.counts["frames"] += len(samples)
        return samples


def _head(buffer: bytes) -> tuple[int, int]:
    """Where the packets of a message begin and how long they are; (-1, 0) while that is not known."""
    if len(buffer) < 4:  # noqa: PLR2004 - start and length
        return -1, 0
    if buffer[3] != _EXTENDED:
        return 4, buffer[3]
    return (6, int.from_bytes(buffer[4:6], "big")) if len(buffer) >= 6 else (-1, 0)  # noqa: PLR2004 - with extended length


def _sample(packets: bytes) -> ImuSample | None:
    forces: tuple[float, ...] = ()
    rates: tuple[float, ...] = ()
    counter: int | None = None
    device_s = temperature_c = None
    at = 0
    while at + 3 <= len(packets):
        kind, size = int.from_bytes(packets[at : at + 2], "big"), packets[at + 2]
        content = packets[at + 3 : at + 3 + size]
        at += 3 + size
        if kind == _COUNTER and size == 2:  # noqa: PLR2004 - a word
            counter = int.from_bytes(content, "big")
        elif kind == _TIME_FINE and size == 4:  # noqa: PLR2004 - two words
            device_s = _TICK_S * int.from_bytes(content, "big")
        elif kind & _KIND == _TEMPERATURE:
            temperature_c = next(iter(_numbers(kind, content)), None)
        elif kind & _KIND == _ACCELERATION:
            forces = _numbers(kind, content)
        elif kind & _KIND == _RATE:
            rates = _numbers(kind, content)
    if len(forces) != 3 or len(rates) != 3 or not all(map(math.isfinite, (*forces, *rates))):  # noqa: PLR2004 - axes
        return None
    return ImuSample((*forces, *rates), counter=counter, device_s=device_s, temperature_c=temperature_c)


def _numbers(kind: int, content: bytes) -> tuple[float, ...]:
    letter, size = _FORMATS.get(kind & 0x3, ("", 0))
    if not letter or len(content) % size:
        return ()
    return struct.unpack(f">{len(content) // size}{letter}", content)
