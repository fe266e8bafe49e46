"""Motion logs written again with what calibration has found: angles taken back, latency and wheel set."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from services.motion_sensors.calibration import Calibration
from services.motion_sensors.import_file import Recording, write_motion_log
from services.motion_sensors.mounting import angles_rotation
from services.odometry_fusion.motion_log import MotionLog


def calibrated(log: MotionLog, found: Calibration) -> MotionLog:
    """The log in the vehicle's axes; what could not be found stays as it is."""
    angles = [one.value if one.known else 0.0 for one in (found.roll_deg, found.pitch_deg, found.yaw_deg)]
    turned = angles_rotation(*np.radians(angles)).T
    return replace(
        log,
        imu=np.concatenate([log.imu[:, :3] @ turned, log.imu[:, 3:] @ turned], axis=1),
        imu_latency_s=max(found.latency_s.value, 0.0) if found.latency_s.known else log.imu_latency_s,
        wheel_diameter_m=found.wheel_diameter_m.value if found.wheel_diameter_m.known else log.wheel_diameter_m,
    )


def write_calibrated(source: Path, log: MotionLog, found: Calibration, out: Path) -> None:
    """Write the log of `source` into a new folder, its truth beside it where there is one. Raises OSError."""
    new = calibrated(log, found)
    run = Recording(new.imu_t_s, new.imu, new.tacho_t_s, new.pulses, new.pulses_per_revolution, new.wheel_diameter_m)
    write_motion_log(out, run, new.imu_latency_s, new.max_gradient_permille)
    for truth in (source / "truth.parquet", source / "truth.csv"):
        if truth.is_file():
            shutil.copyfile(truth, out / truth.name)
