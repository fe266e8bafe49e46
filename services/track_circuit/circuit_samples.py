"""Samples on their way in: blocks with their number, their time, and whether some are missing before them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NS = 1_000_000_000
FULL_SCALE = 0.9999
"""Of ±1: samples from here on are clipped; 16 bits end at 0.99997."""
CLIPPED_SHARE = 1e-4
"""More clipped samples than this are told."""


class SampleError(ValueError):
    """Samples that cannot be read: the file or device, and why."""


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive samples of one channel, full scale ±1."""

    samples: NDArray[np.float64]
    first_sample: int
    """Number of the first one, counted by the converter."""
    t_ns: int
    """Time of the first one."""
    gap: bool = False
    """Samples are missing before it."""

    @property
    def clipped(self) -> int:
        """How many stand at full scale."""
        return int(np.count_nonzero(np.abs(self.samples) >= FULL_SCALE))


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of a recording without gaps."""

    begin: int
    """Where it begins in the recording's samples."""
    end: int
    first_sample: int
    """Number of its first sample, counted by the converter."""
    t_ns: int


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording that was opened: what it says of itself, and its samples, read when asked for."""

    name: str
    sample_rate_hz: float
    samples: NDArray[np.generic]
    """One channel as recorded, integers or floats; may stay on disk."""
    scale: float
    """From there to full scale ±1."""
    stretches: tuple[Stretch, ...]
    circuit: str = ""
    profile: bytes | None = None
    """JSON of the profile, where the recording brings one."""
    warnings: tuple[str, ...] = ()

    @property
    def duration_s(self) -> float:
        """Length of all stretches."""
        return sum(one.end - one.begin for one in self.stretches) / self.sample_rate_hz

    def taken(self, begin: int, end: int) -> NDArray[np.float64]:
        """Samples as numbers of full scale ±1."""
        return np.asarray(self.samples[begin:end], np.float64) * self.scale

    def blocks(self, seconds: float) -> Iterator[Block]:
        """All samples in blocks of `seconds`; a block after missing samples says so."""
        size = max(1, round(seconds * self.sample_rate_hz))
        for number, stretch in enumerate(self.stretches):
            for begin in range(stretch.begin, stretch.end, size):
                before = begin - stretch.begin
                yield Block(
                    self.taken(begin, min(begin + size, stretch.end)),
                    stretch.first_sample + before,
                    stretch.t_ns + round(before / self.sample_rate_hz * NS),
                    gap=before == 0 and number > 0,
                )
