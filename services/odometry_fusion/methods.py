"""Methods of odometry by name."""

from __future__ import annotations

from typing import assert_never

from services.odometry_fusion.first_rest import stated_rest
from services.odometry_fusion.fused_odometry import FusedOdometry
from services.odometry_fusion.log_rest import joined, parts_of
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
    """Odometry of a whole log by the configured method, as one."""
    return joined(run_parts(log, config))


def run_parts(log: MotionLog, config: Config) -> list[MotionRows]:
    """The same, in parts of which each begins anew: several where the log begins with wheels that may be locked."""

    def whole(part: MotionLog) -> MotionRows:
        step = begin(part.vehicle, config)
        return step.advance(part.end_s, part.imu_t_s, part.imu, part.tacho_t_s, part.pulses)

    known = stated_rest(config.imu_rest_mps2, config.imu_rest_radps)
    return [whole(log)] if config.method == "wheel" else parts_of(log, whole, known)
