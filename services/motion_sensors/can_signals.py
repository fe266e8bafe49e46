"""Signals in CAN frames: where their bits stand, how they become values; samples made of several frames.

Bits are counted as in DBC files: little endian from the signal's least significant bit, big endian
from its most significant one, both as byte·8 + bit within the byte.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

from services.motion_sensors.imu_sample import ImuSample

_VALUES: Final = ("ax_mps2", "ay_mps2", "az_mps2", "gx_radps", "gy_radps", "gz_radps")


class CanSignal(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One signal. Value = raw × scale + offset."""

    frame_id: Annotated[int, Meta(ge=0, le=0x1FFF_FFFF)]
    start_bit: Annotated[int, Meta(ge=0, le=511)]
    bits: Annotated[int, Meta(ge=1, le=64)]
    order: Literal["little", "big"] = "little"
    signed: bool = False
    scale: float = 1.0
    offset: float = 0.0

    def raw(self, content: bytes) -> int | None:
        """Raw number in a frame's bytes; None when the frame is too short for it.

        >>> CanSignal(frame_id=1, start_bit=0, bits=16, signed=True).raw(bytes((0xFE, 0xFF)))
        -2
        >>> CanSignal(frame_id=1, start_bit=7, bits=16, order="big").raw(bytes((0x12, 0x34)))
        4660
        """
        if self.order == "little":
            if self.start_bit + self.bits > 8 * len(content):
                return None
            number = int.from_bytes(content, "little") >> self.start_bit
        else:
            # Position of the most significant bit when all bytes are written one after the other.
            first = 8 * (self.start_bit // 8) + 7 - self.start_bit % 8
            after = 8 * len(content) - first - self.bits
            if after < 0:
                return None
            number = int.from_bytes(content, "big") >> after
        number &= (1 << self.bits) - 1
        return number - (1 << self.bits) if self.signed and number >> (self.bits - 1) else number

    def value(self, content: bytes) -> float | None:
        """Value in a frame's bytes; None when the frame is too short for it."""
        raw = self.raw(content)
        return None if raw is None else raw * self.scale + self.offset


class CanImuLayout(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the values of an inertial sensor stand. The frame of `gz_radps` comes last and completes a sample."""

    ax_mps2: CanSignal
    ay_mps2: CanSignal
    az_mps2: CanSignal
    gx_radps: CanSignal
    gy_radps: CanSignal
    gz_radps: CanSignal
    counter: CanSignal | None = None


class CanImuSamples:
    """Collects values until a sample is whole."""

    def __init__(self, layout: CanImuLayout) -> None:
        """Begin with nothing."""
        self._signals = {name: getattr(layout, name) for name in _VALUES}
        self._counter = layout.counter
        self._last = layout.gz_radps.frame_id
        self._held: dict[str, float] = {}
        self._number: int | None = None
        self.counter_modulus = 1 << layout.counter.bits if layout.counter else 0
        self.counts = {"frames": 0, "short_frames": 0, "incomplete_samples": 0}

    def feed(self, frame_id: int, content: bytes) -> ImuSample | None:
        """Sample that a frame completes, if it does; what stays incomplete is not kept for the next."""
        found = {name: signal.value(content) for name, signal in self._signals.items() if signal.frame_id == frame_id}
        if found.keys() & self._held.keys():
            # The frame that should have completed the sample before was lost, and maybe others of it, too.
            self.counts["incomplete_samples"] += 1
            self._held = {}
        for name, value in found.items():
            if value is None or not math.isfinite(value):
                self.counts["short_frames"] += 1
                return None
            self._held[name] = value
        if self._counter is not None and self._counter.frame_id == frame_id:
            self._number = self._counter.raw(content)
        self.counts["frames"] += bool(found)
        if frame_id != self._last:
            return None
        held, self._held = self._held, {}
        if len(held) < len(_VALUES):
            self.counts["incomplete_samples"] += 1
            return None
        return ImuSample(tuple(held[name] for name in _VALUES), counter=self._number)
