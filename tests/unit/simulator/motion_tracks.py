"""Tracks and sensors that tests know by heart."""

from __future__ import annotations

import numpy as np

from services.simulator.motion_settings import Imu, MotionSettings, Tacho
from services.simulator.track_table import TrackTable

PERFECT = Imu(
    noise=0.0,
    vibration=0.0,
    gyro_bias_dps=0.0,
    accelerometer_bias_mps2=0.0,
    temperature_change_c=0.0,
    mounting_deg=(0.0, 0.0, 0.0),
    distortion=0.0,
    latency_s=0.0,
)
IDEAL = MotionSettings(imu=PERFECT, tacho=Tacho(wheel_scale=0.0))


def uniform_track(
    length_m: int = 6000,
    curvature_per_m: float = 0.0,
    slope: float = 0.0,
    roll_rad: float = 0.0,
    limit_mps: float = 20.0,
    stops_m: tuple[float, ...] = (2000.0, 4000.0, 5800.0),
) -> TrackTable:
    """The same everywhere."""
    count = length_m + 1
    return TrackTable(
        np.full(count, curvature_per_m),
        np.full(count, slope),
        np.full(count, roll_rad),
        np.full(count, limit_mps),
        np.array(stops_m),
    )
