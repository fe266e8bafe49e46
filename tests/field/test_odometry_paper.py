"""The paper's method on motion logs with known truth: the figures that it must reach, and what switches cost."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from services.odometry_fusion.evaluation import Evaluation, MotionTrack, evaluate
from services.odometry_fusion.methods import run_log
from services.odometry_fusion.motion_log import STATUSES
from services.odometry_fusion.motion_log_file import read_motion_log
from services.odometry_fusion.motion_truth_file import read_truth, read_wheel_beside
from services.odometry_fusion.paper_settings import PaperSettings
from services.odometry_fusion.settings import Config

MOTION = Path(os.environ.get("KIROTEI_FIELD_DATA", "/nonexistent")) / "motion"
pytestmark = pytest.mark.skipif(not MOTION.is_dir(), reason="KIROTEI_FIELD_DATA does not name a folder with motion/")


def judged(name: str, config: Config) -> Evaluation:
    rows = run_log(read_motion_log(MOTION / name).log, config)
    track = MotionTrack(
        name,
        rows.t_s,
        rows.distance_m,
        rows.speed_mps,
        rows.slip != 0,
        rows.bound_m,
        tuple(STATUSES[code] for code in rows.status.tolist()),
    )
    truth = MOTION / name / "truth.parquet"
    return evaluate(track, read_truth(truth), read_wheel_beside(truth))


@pytest.mark.parametrize("name", ["sim_a1", "sim_a2", "sim_b1"])
def test_slips_are_corrected_and_bounds_hold(name: str) -> None:
    found = judged(name, Config(method="paper"))
    # Iwata et al.: 43 of 44 slips, about ±2 % of 1 km.
    assert found.readhered_percent is not None
    assert found.within_2_percent is not None
    assert found.p95_m is not None
    assert found.readhered_percent >= 97.7
    assert found.within_2_percent >= 97.0
    assert found.p95_m < 5.0  # 0.5 % of 1 km
    assert found.violations == 0
    assert found.bounded_percent == 100.0
    assert found.above_etcs_percent == 0.0
    assert found.false_per_hour <= 1.0
    assert found.degraded_percent == 0.0


def test_without_pitch_correction_it_is_visibly_worse() -> None:
    config = Config(method="paper", paper=PaperSettings(pitch_correction="none"))
    found = [judged(name, config) for name in ("sim_a1", "sim_a2")]
    shares = [one.readhered_percent for one in found if one.readhered_percent is not None]
    assert np.mean(shares) < 80.0


def test_the_wheel_alone_holds_its_wide_bound() -> None:
    for name in ("sim_a1", "sim_a2", "sim_b1"):
        found = judged(name, Config(method="wheel"))
        assert found.violations == 0
        assert found.bounded_percent == 100.0
        assert found.p95_m is not None
        assert found.p95_m > 20.0
