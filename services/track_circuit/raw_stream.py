"""Raw 16-bit samples from standard input."""

from __future__ import annotations

import sys
from typing import Final

import numpy as np

from services.track_circuit.circuit_samples import Recording, SampleError, Stretch

LARGEST_BYTES: Final = 4 * 1024 * 1024 * 1024
"""Six hours at 96 kHz; more is no recording but a live source, which the service is for."""


def read_raw(rate_hz: float) -> Recording:
    """Everything on standard input as little-endian 16-bit samples of one channel. Raises SampleError."""
    content = sys.stdin.buffer.read(LARGEST_BYTES)
    warnings = ("standard input: cut within a sample",) if len(content) % 2 else ()
    samples = np.frombuffer(content, "<i2", count=len(content) // 2)
    if not len(samples):
        msg = "standard input: holds no samples"
        raise SampleError(msg)
    return Recording(
        name="standard input",
        sample_rate_hz=rate_hz,
        samples=samples,
        scale=2.0**-15,
        stretches=(Stretch(0, len(samples), 0, 0),),
        warnings=warnings,
    )
