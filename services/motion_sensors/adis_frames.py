"""Burst frames of Analog Devices' ADIS1647x inertial sensors, as a bridge forwards them byte by byte.

A frame (ADIS16470 data sheet rev. D, burst read function) has ten words, most significant byte first:
status, angular rates x y z, accelerations x y z, temperature, data counter, checksum, which is the sum
of all bytes before it. Frames carry no mark of their beginning; the checksum finds it.
"""

from __future__ import annotations

import math
import struct
from typing import Final

from services.motion_sensors.imu_sample import STANDARD_GRAVITY_MPS2, ImuSample, new_counts

_FRAME: Final = struct.Struct(">H6hhHH")
LENGTH: Final = _FRAME.size
_TEMPERATURE_C: Final = 0.1
"""Per count; 0 counts are 0 °C."""
_STATUS: Final = {1: "data path overrun", 2: "flash", 3: "SPI", 4: "standby", 5: "sensor", 6: "memory", 7: "clock"}
"""Bits of the status word that tell a fault (table 24 of the data sheet)."""


class AdisFrames:
    """Finds and decodes frames. Scales are those of the model: ADIS16470 0.1 °/s and 1.25 mg per count."""

    counter_modulus = 65_536

    def __init__(self, gyro_dps: float = 0.1, accelerometer_mg: float = 1.25) -> None:
        """Begin between frames."""
        self._gyro_radps = math.radians(gyro_dps)
        self._accelerometer_mps2 = accelerometer_mg * 1e-3 * STANDARD_GRAVITY_MPS2
        self._rest = b""
        self.counts = new_counts()

    def feed(self, chunk: bytes) -> list[ImuSample]:
        """Samples that the bytes complete; what fits no frame is skipped byte by byte and counted."""
        buffer, at, samples = self._rest + chunk, 0, []
        while at + LENGTH <= len(buffer):
            frame = buffer[at : at + LENGTH]
            # All zeros satisfy the checksum: a line that is held low, not a sensor at rest.
            if sum(frame[:-2]) & 0xFFFF == int.from_bytes(frame[-2:], "big") and any(frame):
                samples.append(self._sample(frame))
                at += LENGTH
            else:
                self.counts["skipped_bytes"] += 1
                at += 1
        self._rest = buffer[at:]
        self.counts["frames"] += len(samples)
        return samples

    def _sample(self, frame: bytes) -> ImuSample:
        status, gx, gy, gz, ax, ay, az, temperature, counter, _ = _FRAME.unpack(frame)
        faults = [text for bit, text in _STATUS.items() if status >> bit & 1]
        return ImuSample(
            (
                *(self._accelerometer_mps2 * one for one in (ax, ay, az)),
                *(self._gyro_radps * one for one in (gx, gy, gz)),
            ),
            counter=counter,
            temperature_c=_TEMPERATURE_C * temperature,
            fault=f"sensor reports {', '.join(faults)}" if faults else "",
        )


def adis_frame(rates_counts: tuple[int, int, int], forces_counts: tuple[int, int, int], counter: int) -> bytes:
    """A frame as a sensor sends it, of raw counts; for simulating a sensor on a line.

    >>> AdisFrames().feed(adis_frame((10, 0, 0), (0, 0, 800), 7))[0].counter
    7
    """
    body = _FRAME.pack(0, *rates_counts, *forces_counts, 250, counter & 0xFFFF, 0)[:-2]
    return body + (sum(body) & 0xFFFF).to_bytes(2, "big")
