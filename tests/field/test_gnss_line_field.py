"""The method line on real drives, with one and the same settings: figures against the truth."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from services.gnss_correction.along_track import AlongError, along_error
from services.gnss_correction.fixes_file import read_fixes, read_truth
from services.gnss_correction.settings import Config
from services.gnss_correction.solve_file import Solved, solve_file
from services.line.line_file import read_line

GNSS = Path(os.environ.get("KIROTEI_FIELD_DATA", "/nonexistent")) / "gnss"
pytestmark = pytest.mark.skipif(not GNSS.is_dir(), reason="KIROTEI_FIELD_DATA does not name a folder with gnss/")
BERLIN = GNSS / "berlin_5hz"
BERLIN_NAV = [BERLIN / "nav_gps.16n", BERLIN / "nav_glo.16g"]
WHEEL = BERLIN / "libRSF_input_corrected_pseudoranges_odometry.txt"


@dataclass(frozen=True)
class Run:
    """One recording, solved."""

    solved: Solved
    error: AlongError
    statuses: set[str]
    fixes: bytes


def solve(folder: Path, nav: list[Path], out: Path, *, wheel: Path | None = None, line: Path | None = None) -> Run:
    config = Config(method="line", line_file=str(line or folder / "track_centreline.csv"), compare=())
    solved = solve_file(folder / "rover.obs", nav, config, out, wheel=wheel)
    track = read_fixes(out, "line")
    error = along_error(track, read_truth(folder / "truth.csv"), read_line(folder / "track_centreline.csv"))
    assert error is not None
    statuses = {row.split(",")[2] for row in out.read_text("utf-8").splitlines()[1:]}
    return Run(solved, error, statuses, out.read_bytes())


@pytest.fixture(scope="module")
def berlin(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return solve(BERLIN, BERLIN_NAV, tmp_path_factory.mktemp("line") / "fixes.csv")


def test_berlin_by_satellites_alone(berlin: Run) -> None:
    assert berlin.statuses == {"fix"}
    assert berlin.error.known_percent == 100.0
    assert berlin.error.beyond_bound == 0
    # Wanted are 4 m, 12 m and 20 m; 1.8 m, 5.5 m and 15.9 m were measured.
    assert berlin.error.mean_m <= 3.0
    assert berlin.error.p95_m <= 9.0
    assert berlin.error.bound_p50_m is not None
    assert berlin.error.bound_p50_m <= 20.0


def test_berlin_with_the_wheels(tmp_path: Path) -> None:
    run = solve(BERLIN, BERLIN_NAV, tmp_path / "fixes.csv", wheel=WHEEL)
    assert run.error.known_percent == 100.0
    assert run.error.beyond_bound == 0
    # Wanted are 2.5 m and 6 m; 1.4 m and 3.3 m were measured.
    assert run.error.mean_m <= 2.0
    assert run.error.p95_m <= 5.0


def test_berlin_by_gps_alone_recovers(tmp_path: Path) -> None:
    # Half the satellites: it goes astray beside a wall, finds back, and never says more than it knows.
    run = solve(BERLIN, BERLIN_NAV[:1], tmp_path / "fixes.csv")
    assert run.error.known_percent == 100.0
    assert run.error.beyond_bound == 0
    assert run.error.mean_m <= 6.0


def test_the_same_recording_gives_the_same_bytes(berlin: Run, tmp_path: Path) -> None:
    assert solve(BERLIN, BERLIN_NAV, tmp_path / "again.csv").fixes == berlin.fixes


def test_a_walk_of_one_epoch_per_second(tmp_path: Path) -> None:
    # It begins with minutes of standing where the line also ends: either end may be meant, and the bound says so.
    folder = GNSS / "shanghai_dgps"
    run = solve(folder, [folder / "nav.rnx"], tmp_path / "fixes.csv")
    assert run.error.known_percent == 100.0
    assert run.error.beyond_bound == 0
    assert run.error.p95_m <= 6.0
    assert run.error.bound_p50_m is not None
    assert run.error.bound_p50_m <= 25.0


def test_a_walk_with_four_satellites_is_not_overstated(tmp_path: Path) -> None:
    folder = GNSS / "boulder_4hz"
    run = solve(folder, [folder / "nav.rnx"], tmp_path / "fixes.csv")
    assert run.error.beyond_bound == 0


def test_a_drive_elsewhere_is_not_on_the_line(tmp_path: Path) -> None:
    line = tmp_path / "elsewhere.csv"
    rows = (BERLIN / "track_centreline.csv").read_text("utf-8").splitlines()
    moved = [",".join((chainage, str(float(lat) + 0.01), lon, h)) for chainage, lat, lon, h in map(_cells, rows[1:])]
    line.write_text("\n".join([rows[0], *moved]) + "\n", "utf-8")
    config = Config(method="line", line_file=str(line), compare=())
    solved = solve_file(BERLIN / "rover.obs", BERLIN_NAV, config, tmp_path / "fixes.csv")
    # 1.1 km to the north of the drive: further than anything reflects.
    assert solved.fixes == 0
    assert "not on the line" in solved.reasons


def test_a_line_of_its_own_file_is_as_long_as_it_says() -> None:
    line = read_line(BERLIN / "track_centreline.csv")
    # The file counts horizontal metres, the axis those on the slope.
    assert np.isclose(line.axis.length_m, float(line.chainage.at(line.axis.length_m)), rtol=2e-3)


def _cells(row: str) -> list[str]:
    return row.split(",")
