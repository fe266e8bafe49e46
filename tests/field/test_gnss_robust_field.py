"""What the method `robust` must reach on real recordings with default settings (found through KIROTEI_FIELD_DATA)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from schemas.gnss import Fix
from services.gnss_correction.evaluation import Polyline, TruthError, truth_error
from services.gnss_correction.fix_messages import Corrected, fixes_of
from services.gnss_correction.fixes_file import read_fixes, read_truth
from services.gnss_correction.integrity import Integrity, bounded_errors, integrity_of
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.settings import Config
from services.gnss_correction.solve_file import solve_file
from services.gnss_receiver.observations import satellite_code
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations

DATA = os.environ.get("KIROTEI_FIELD_DATA", "")
pytestmark = pytest.mark.skipif(not DATA, reason="KIROTEI_FIELD_DATA does not say where the recordings are")
GNSS = Path(DATA) / "gnss"
BERLIN = GNSS / "berlin_5hz"
ALERT_LIMIT_M = 50.0


def held(folder: Path, nav: str, out: Path, truth: Polyline, systems: str = "GRECJ") -> tuple[TruthError, Integrity]:
    solve_file(folder / "rover.obs", [folder / nav], Config(method="robust", systems=systems), out)
    track = read_fixes(out, "robust")
    error = truth_error(track, truth)
    assert error is not None
    integrity = integrity_of(bounded_errors(track, truth), ALERT_LIMIT_M)
    # A bound on every fix, and no error beyond it, whatever the recording.
    assert (integrity.bounded_percent, integrity.misleading) == (100.0, 0)
    return error, integrity


@pytest.mark.parametrize(
    ("systems", "nav", "mean_m", "p95_m", "bound_m"),
    [
        ("GR", "nav_mixed.rnx", 6.0, 12.0, 45.0),
        ("GRECJ", "nav_mixed.rnx", 6.0, 12.0, 45.0),
        # With eight satellites among buildings, each left out in turn leaves places that lie farther apart.
        ("G", "nav_gps.16n", 9.0, 20.0, 62.0),
    ],
)
def test_berlin(tmp_path: Path, systems: str, nav: str, mean_m: float, p95_m: float, bound_m: float) -> None:
    error, integrity = held(BERLIN, nav, tmp_path / "f.csv", read_truth(BERLIN / "truth.csv"), systems)
    assert error.fixation_percent == 100.0
    assert error.mean_m <= mean_m
    assert error.p95_m <= p95_m
    assert integrity.bound_p50_m is not None
    assert integrity.bound_p50_m <= bound_m


def test_berlin_by_glonass_alone_keeps_its_bound(tmp_path: Path) -> None:
    error, _ = held(BERLIN, "nav_mixed.rnx", tmp_path / "f.csv", read_truth(BERLIN / "truth.csv"), "R")
    # Seven satellites low among buildings: errors of tens of metres, and bounds that say so.
    assert error.fixation_percent == 100.0
    assert error.maximum_m <= 90.0


@pytest.mark.parametrize(("name", "mean_m"), [("shanghai_dgps", 1.3), ("boulder_4hz", 9.5)])
def test_other_receivers(tmp_path: Path, name: str, mean_m: float) -> None:
    folder = GNSS / name
    error, integrity = held(folder, "nav.rnx", tmp_path / "f.csv", read_truth(folder / "truth.csv"))
    assert error.mean_m <= mean_m
    assert integrity.bound_p50_m is not None
    assert integrity.bound_p50_m <= 40.0


def test_static_antenna(tmp_path: Path) -> None:
    folder = GNSS / "static_dgps"
    lat_deg, lon_deg, h_m = (float(one) for one in (folder / "rover_position.txt").read_text().split()[:3])
    week_s = read_observations(folder / "rover.obs")
    ends_s = np.array([-1.0, 1.0]) + (week_s.gps_week * 604_800.0 + week_s.tow_s)[[0, -1]]
    # Two points of truth an hour apart would count as a gap.
    at = np.arange(ends_s[0], ends_s[1] + 1.0)
    truth = Polyline(np.full(len(at), lat_deg), np.full(len(at), lon_deg), np.full(len(at), h_m), at)
    error, integrity = held(folder, "nav.rnx", tmp_path / "f.csv", truth)
    assert error.maximum_m <= 5.0
    assert integrity.bound_p50_m is not None
    assert integrity.bound_p50_m <= 20.0


def _informed() -> Correction:
    made = Correction(Config(systems="GR"), ("robust",))
    navigation = read_navigation([BERLIN / "nav_mixed.rnx"])
    for one in navigation.ephemerides:
        made.add(one)
    if navigation.ionosphere is not None:
        made.add(navigation.ionosphere)
    return made


@pytest.mark.parametrize("tunnel", [(300, 350), (450, 750), (300, 900)])
def test_the_first_epochs_after_a_tunnel_keep_their_bound(tunnel: tuple[int, int]) -> None:
    observations = read_observations(BERLIN / "rover.obs")
    pseudorange_m = observations.pseudorange_m.copy()
    rows = slice(int(observations.first_row[tunnel[0]]), int(observations.first_row[tunnel[1]]))
    pseudorange_m[rows] = np.nan
    object.__setattr__(observations, "pseudorange_m", pseudorange_m)
    fixes = _kept(_informed().block(observations))
    assert {fix.status for fix in fixes[slice(*tunnel)]} == {"predicted"}
    assert {fix.status for fix in fixes[tunnel[1] :]} == {"fix"}


FIRST, MIDDLE = 0, 700


@pytest.mark.parametrize(
    "faults",
    [
        {"G12": (100.0, FIRST)},
        {"G12": (300.0, MIDDLE)},
        {"G29": (100.0, FIRST)},
        {"G29": (-100.0, FIRST)},
        {"G24": (-100.0, FIRST)},
        {"G12": (100.0, MIDDLE), "G25": (30.0, MIDDLE)},
        {"G24": (-100.0, FIRST), "G06": (-100.0, FIRST)},
    ],
)
def test_satellites_that_are_off_mislead_nobody(faults: dict[str, tuple[float, int]]) -> None:
    observations = read_observations(BERLIN / "rover.obs")
    pseudorange_m = observations.pseudorange_m.copy()
    for name, (late_m, from_epoch) in faults.items():
        rows = np.flatnonzero(observations.satellite == satellite_code(name))
        pseudorange_m[rows[rows >= observations.first_row[from_epoch]]] += late_m
    object.__setattr__(observations, "pseudorange_m", pseudorange_m)
    fixes = _kept(_informed().block(observations))
    assert {fix.status for fix in fixes} == {"fix"}


def _kept(corrected: Corrected) -> list[Fix]:
    """Fixes, none of which is farther from the truth than its bound."""
    fixes = fixes_of(corrected, "robust")
    truth = read_truth(BERLIN / "truth.csv")
    t_s = np.array([fix.gps_week * 604_800.0 + fix.tow_s for fix in fixes])
    lat_deg, lon_deg = (np.interp(t_s, truth.at, column) for column in (truth.lat_deg, truth.lon_deg))
    north_m = (np.array([fix.lat_deg for fix in fixes]) - lat_deg) * 111_250.0
    east_m = (np.array([fix.lon_deg for fix in fixes]) - lon_deg) * 111_250.0 * np.cos(np.radians(52.5))
    assert (np.hypot(north_m, east_m) <= np.array([fix.bound_m for fix in fixes])).all()
    return fixes


def test_two_runs_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.csv", "b.csv"):
        solve_file(BERLIN / "rover.obs", [BERLIN / "nav_mixed.rnx"], Config(), tmp_path / name)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
