"""ASCII sentences `$VNIMU` of VectorNav attitude sensors (VN-100 user manual, asynchronous IMU measurements).

Fields: magnetic x y z [G], acceleration x y z [m/s²], angular rate x y z [rad/s], temperature [°C],
pressure [kPa]; after `*` the exclusive or of the characters between, as two hexadecimal digits.
"""

from __future__ import annotations

import math
from typing import Final

from services.motion_sensors.imu_sample import ImuSample, new_counts

_FIELDS: Final = 12
_LONGEST: Final = 256


class VectornavSentences:
    """Finds and decodes sentences."""

    counter_modulus = 0

    def __init__(self) -> None:
        """Begin between sentences."""
        self._rest = b""
        self.counts = new_counts()

    def feed(self, chunk: bytes) -> list[ImuSample]:
        """Samples that the bytes complete; other sentences are counted as skipped bytes."""
        *lines, rest = (self._rest + chunk).split(b"\n")
        self._rest = rest if len(rest) <= _LONGEST else b""
        self.counts["skipped_bytes"] += len(rest) - len(self._rest)
        samples = []
        for line in lines:
            sample = self._sample(line.strip())
            if sample is not None:
                samples.append(sample)
        self.counts["frames"] += len(samples)
        return samples

    def _sample(self, line: bytes) -> ImuSample | None:
        start = line.rfind(b"$VNIMU,")
        body, star, check = line[start + 1 :].partition(b"*")
        if start < 0 or not star:
            self.counts["skipped_bytes"] += len(line)
            return None
        if check.strip().upper() != f"{checksum(body):02X}".encode():
            self.counts["checksum_errors"] += 1
            return None
        try:
            values = [float(one) for one in body.decode("ascii").split(",")[1:_FIELDS]]
        except ValueError:
            values = []
        if len(values) < _FIELDS - 1 or not all(map(math.isfinite, values)):
            self.counts["checksum_errors"] += 1
            return None
        return ImuSample(tuple(values[3:9]), temperature_c=values[9])


def checksum(body: bytes) -> int:
    """Exclusive or of all bytes between `$` and `*`.

    >>> hex(checksum(b"VNRRG,1"))
    '0x6b'
    """
    result = 0
    for one in body:
        result ^= one
    return result
