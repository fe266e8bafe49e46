"""How large a fault can be, so that a slip of the pen makes no train that nobody can simulate."""

from __future__ import annotations

from typing import Final

from schemas.position import FaultKind

RANGES: Final[dict[FaultKind, tuple[float, float, str]]] = {
    "slide": (0.0, 50.0, "m/s"),
    "spin": (0.0, 50.0, "m/s"),
    "micro_slip": (0.0, 0.5, "of the speed"),
    "gyro_bias": (-10.0, 10.0, "rad/s"),
    "accelerometer_bias": (-100.0, 100.0, "m/s²"),
    "imu_saturated": (0.0, 10.0, "of the usual span"),
    "imu_late": (0.0, 60.0, "s"),
    "tacho_late": (0.0, 60.0, "s"),
    "tacho_missing_teeth": (0.0, 10_000.0, "teeth"),
    "radio_interference": (-100.0, 100.0, "dBm"),
    "radio_obstruction": (0.0, 200.0, "dB"),
    "radio_snow": (0.0, 200.0, "dB"),
    "radio_degradation": (0.0, 200.0, "dB per day"),
}
"""Smallest and largest magnitude with its unit; the other kinds have none, and take any number."""
ANY: Final = (-1e9, 1e9, "")


def size_fault(kind: FaultKind, magnitude: float | None) -> str:
    """In words what is wrong with a magnitude; empty when nothing is.

    >>> size_fault("imu_late", 1e300)
    'a magnitude of 1e+300 for imu_late: 0 to 60 s is wanted'
    >>> size_fault("slide", None)
    ''
    """
    low, high, unit = RANGES.get(kind, ANY)
    if magnitude is None or low <= magnitude <= high:
        return ""
    return f"a magnitude of {magnitude:g} for {kind}: {low:g} to {high:g} {unit} is wanted".rstrip()
