"""One sample of an inertial sensor as its protocol gives it."""

from __future__ import annotations

from typing import Final, NamedTuple, Protocol

STANDARD_GRAVITY_MPS2: Final = 9.80665
"""CGPM 1901; sensors that give accelerations in g mean this."""


class ImuSample(NamedTuple):
    """Six values in the sensor's own axes; None where the protocol does not tell."""

    values: tuple[float, ...]
    """Specific force x y z [m/s²], angular rate x y z [rad/s]."""
    counter: int | None = None
    """The sensor's own count of samples; wraps at `ImuFrames.counter_modulus`."""
    device_s: float | None = None
    """The sensor's own clock [s]."""
    temperature_c: float | None = None
    fault: str = ""
    """What the sensor itself says is wrong."""


class ImuFrames(Protocol):
    """A decoder of one protocol: bytes in, samples out. Remembers what is cut at the end of a chunk."""

    counter_modulus: int
    """The sensor's sample counter wraps here; 0 without one."""
    counts: dict[str, int]
    """`frames` understood, `checksum_errors`, `skipped_bytes`."""

    def feed(self, chunk: bytes) -> list[ImuSample]:
        """Samples that the bytes complete."""


def new_counts() -> dict[str, int]:
    """Counters of a decoder."""
    return {"frames": 0, "checksum_errors": 0, "skipped_bytes": 0}
