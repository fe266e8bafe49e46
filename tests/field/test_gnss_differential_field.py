"""Recordings with a base: what corrections reach. KIROTEI_FIELD_DATA names the folder with gnss/."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from services.gnss_correction.fixes_file import read_fixes, read_truth
from services.gnss_correction.settings import Config
from services.gnss_correction.solve_file import Solved, solve_file
from services.gnss_reference.base_file import Base
from services.gnss_reference.base_position import parse_position
from services.numerics.geodesy import enu_about

ROOT = Path(os.environ.get("KIROTEI_FIELD_DATA", "/nonexistent")) / "gnss"
pytestmark = pytest.mark.skipif(not ROOT.is_dir(), reason="KIROTEI_FIELD_DATA does not name a folder with gnss/")
STATIC, WALK = ROOT / "static_dgps", ROOT / "shanghai_dgps"
WALK_BASE_DEG = (31.182404242, 121.401896317, 7.0009)
"""APPROX POSITION XYZ of its base.obs, which is off by some two metres."""
SMOOTHED = Config(smooth_s=100.0)


def static_place() -> tuple[float, float, float]:
    return parse_position((STATIC / "rover_position.txt").read_text())


def solved(folder: Path, config: Config, out: Path, position_deg: tuple[float, float, float]) -> Solved:
    base = Base(folder / "base.obs", position_deg)
    return solve_file(folder / "rover.obs", [folder / "nav.rnx"], config, out, base=base)


def static_p95_m(config: Config, out: Path, east_deg: float = 0.0) -> tuple[Solved, float]:
    lat_deg, lon_deg, h_m = parse_position((STATIC / "base_position.txt").read_text())
    summary = solved(STATIC, config, out, (lat_deg, lon_deg + east_deg, h_m))
    track = read_fixes(out, "static")
    error = enu_about(static_place(), track.lat_deg, track.lon_deg, track.h_m)
    return summary, float(np.percentile(np.hypot(error[:, 0], error[:, 1]), 95))


@pytest.mark.parametrize(
    ("config", "limit_m"),
    [
        # rnx2rtkp: 0.19 m.
        (Config(), 0.15),
        (SMOOTHED, 0.15),
        (Config(method="original"), 0.19),
        (Config(method="original", smooth_s=100.0), 0.12),
    ],
)
def test_static_pair(tmp_path: Path, config: Config, limit_m: float) -> None:
    summary, p95_m = static_p95_m(config, tmp_path / "fixes.csv")
    assert (summary.fixes, summary.corrected, summary.uncorrected) == (summary.epochs, summary.epochs, {})
    assert p95_m <= limit_m


def test_a_base_that_was_moved_by_a_hundred_metres_is_not_believed(tmp_path: Path) -> None:
    summary, p95_m = static_p95_m(Config(), tmp_path / "fixes.csv", east_deg=0.0011)
    assert (summary.fixes, summary.corrected) == (summary.epochs, 0)
    assert p95_m <= 3.4, "as without a base"


@pytest.mark.parametrize(("config", "mean_m", "p95_m"), [(Config(), 0.55, 1.30), (SMOOTHED, 0.55, 1.30)])
def test_walk_in_shanghai(tmp_path: Path, config: Config, mean_m: float, p95_m: float) -> None:
    summary = solved(WALK, config, tmp_path / "fixes.csv", WALK_BASE_DEG)
    assert summary.fixes == summary.epochs
    track, truth = read_fixes(tmp_path / "fixes.csv", "walk"), read_truth(WALK / "truth.csv")
    reference = truth.reference_deg
    true = enu_about(reference, truth.lat_deg, truth.lon_deg, truth.h_m)
    found = enu_about(reference, track.lat_deg, track.lon_deg, track.h_m)
    inside = (track.t_s >= truth.at[0]) & (track.t_s <= truth.at[-1])
    after = np.clip(np.searchsorted(truth.at, track.t_s), 1, len(truth.at) - 1)
    # Where the truth is silent nobody knows.
    inside &= truth.at[after] - truth.at[after - 1] <= 1.5
    error = found[inside, :2] - np.stack([np.interp(track.t_s[inside], truth.at, true[:, i]) for i in (0, 1)], -1)
    off = np.hypot(*(error - error.mean(axis=0)).T)
    assert off.mean() <= mean_m
    assert np.percentile(off, 95) <= p95_m


def test_streams_alone_give_what_rinex_gives(tmp_path: Path) -> None:
    """Rover and base as RTCM 3; the base's stream names no day. RINEX rounds to 1 mm, ephemerides to twelve digits."""
    # Without BeiDou: only the streams have B2a, and a further signal changes the mean.
    config = Config(method="original", systems="GEJ")
    streams = Base(WALK / "base.rtcm3", WALK_BASE_DEG)
    rover = WALK / "rover.rtcm3"
    by_rinex = solved(WALK, config, tmp_path / "rinex.csv", WALK_BASE_DEG)
    by_streams = solve_file(rover, [rover], config, tmp_path / "rtcm3.csv", base=streams)
    assert (by_streams.epochs, by_streams.fixes, by_streams.corrected) == (
        by_rinex.epochs,
        by_rinex.fixes,
        by_rinex.corrected,
    )
    tracks = [read_fixes(tmp_path / f"{name}.csv", name) for name in ("rinex", "rtcm3")]
    places = [enu_about(WALK_BASE_DEG, one.lat_deg, one.lon_deg, one.h_m)[one.fixed] for one in tracks]
    # Errors of 1 mm in pseudoranges grow with the dilution of precision, up to 30.
    assert np.abs(places[0] - places[1]).max() <= 0.03
