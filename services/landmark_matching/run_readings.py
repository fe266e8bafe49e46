"""Readings and samples of a whole run, from the rows of an odometry."""

from __future__ import annotations

from collections.abc import Sequence

from services.landmark_matching.reading import Reading, Sample, SampleMaker
from services.landmark_matching.settings import MatchSettings
from services.odometry_fusion.motion_log import LOST, MotionRows


def readings_of(rows: MotionRows) -> list[Reading]:
    """One reading per row; the leading end is the one towards which the vehicle's x axis points."""
    columns = zip(
        rows.t_s.tolist(),
        rows.distance_m.tolist(),
        rows.speed_mps.tolist(),
        rows.curvature_per_m.tolist(),
        rows.curvature_distance_m.tolist(),
        (rows.slip != 0).tolist(),
        (rows.status != LOST).tolist(),
        (rows.excess_m + rows.provisional_m).tolist(),
        rows.curvature_sigma_per_m.tolist(),
        strict=True,
    )
    return [Reading(*values) for values in columns]


def samples_of(readings: Sequence[Reading], settings: MatchSettings) -> list[Sample]:
    """Curvature about places, for all readings that tell any."""
    maker = SampleMaker(settings.window_s, settings.lowest_speed_mps, settings.longest_step_s, settings.leap_mps2)
    return [sample for reading in readings if (sample := maker.take(reading)) is not None]
