"""Methods of odometry by name."""

from __future__ import annotations

from typing import assert_never

from services.odometry_fusion.fused_odometry import FusedOdometry
from services.odometry_fusion.motion_log import MotionLog, MotionRows, OdometryStep, Remembered, Vehicle
from services.odometry_fusion.paper_odometry import PaperOdometry
from services.odometry_fusion.settings import Config
from services.odometry_fusion.wheel_odometry import WheelOdometry


def begin(vehicle: Vehicle, config: Config, known: Remembered | None = None) -> OdometryStep:
    """The configured method, at work on a vehicle, with what an earlier run has learned."""
    match config.method:
        case "wheel":
            return WheelOdometry(vehicle, config.wheel)
        case "paper":
            return PaperOdometry(vehicle, config.paper, known)
        case "fused":
            return FusedOdometry(vehicle, config.fused, known)
        case _:
            assert_never(config.method)


def run_log(log: MotionLog, config: Config) -> MotionRows:
    """Odometry of a whole log by the configured method."""
    return begin(log.vehicle, config).advance(log.end_s, log.imu_t_s, log.imu, log.tacho_t_s, log.pulses)
