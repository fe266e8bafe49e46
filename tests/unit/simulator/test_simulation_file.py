from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import typer
from numpy.typing import NDArray
from typer.testing import CliRunner

from schemas.gnss import Ephemeris, Fix, Ionosphere
from services.gnss_receiver.observations import Observations
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations
from services.numerics.geodesy import enu_about
from services.simulator.command import simulate
from services.simulator.scenario import Scenario
from services.simulator.simulation_file import FILES, write_simulation

Solve = Callable[[Observations, Sequence[Ephemeris], Ionosphere], list[Fix]]


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def column(table: list[dict[str, str]], name: str) -> list[float]:
    return [float(row[name]) for row in table]


def test_files_solve_to_the_truth_beside_them(ideal: Scenario, solve: Solve, tmp_path: Path) -> None:
    written = write_simulation(ideal, tmp_path / "new" / "run", duration_s=60.0)
    folder = tmp_path / "new" / "run"
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)
    observations, navigation = read_observations(folder / "rover.obs"), read_navigation([folder / "nav.rnx"])
    assert (observations.issues, navigation.issues) == ((), ())
    assert len(observations) == written.epochs == 301
    assert navigation.ionosphere is not None
    fixes = solve(observations, navigation.ephemerides, navigation.ionosphere)
    truth = rows(folder / "truth.csv")
    assert column(truth, "tow_s") == pytest.approx(observations.tow_s.tolist())
    first = (float(truth[0]["lat_deg"]), float(truth[0]["lon_deg"]), float(truth[0]["h_ell_m"]))
    here = enu_about(first, *zip(*((f.lat_deg or 0.0, f.lon_deg or 0.0, f.h_m or 0.0) for f in fixes), strict=True))
    there = enu_about(first, column(truth, "lat_deg"), column(truth, "lon_deg"), column(truth, "h_ell_m"))
    # RINEX rounds pseudoranges to a millimetre; geometry stretches that by the dilution of precision, about 3.
    assert np.abs(here - there).max() < 5e-3
    errors = rows(folder / "pseudorange_error.csv")
    assert len(errors) == len(observations.satellite)
    assert set(column(errors, "error_m")) == {0.0}


def test_the_centreline_runs_through_stations_and_train(canyon: Scenario, tmp_path: Path) -> None:
    write_simulation(canyon, tmp_path, duration_s=60.0)
    line, stations, truth = (rows(tmp_path / f"{n}.csv") for n in ("track_centreline", "stations", "truth"))
    origin = (canyon.line.origin_lat_deg, canyon.line.origin_lon_deg, 50.0)

    def plan(table: list[dict[str, str]]) -> NDArray[np.float64]:
        places = enu_about(origin, column(table, "lat_deg"), column(table, "lon_deg"), column(table, "h_ell_m"))
        return np.asarray(places[:, :2])

    axis, chainage = plan(line), np.array(column(line, "chainage_m"))
    assert chainage[-1] == pytest.approx(3700.0)
    # Chords of 2 m are as long as their arcs but for a millionth; coordinates are filed to ten decimals of a degree.
    steps = np.hypot(*np.diff(axis, axis=0).T)
    assert np.abs(steps - np.diff(chainage)).max() < 1e-4
    for row, place in zip(stations, plan(stations), strict=True):
        nearest = int(np.hypot(*(axis - place).T).argmin())
        assert chainage[nearest] == pytest.approx(float(row["chainage_m"]), abs=1.0)
    # Half a chord away from the nearest vertex at most.
    assert max(np.hypot(*(axis - place).T).min() for place in plan(truth)) <= 1.0 + 1e-4


def test_the_same_seed_writes_the_same_bytes(canyon: Scenario, tmp_path: Path) -> None:
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        write_simulation(canyon, tmp_path / name, seed=seed, duration_s=10.0)
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert (tmp_path / "a" / "rover.obs").read_bytes() != (tmp_path / "c" / "rover.obs").read_bytes()


def test_what_cannot_be_finished_leaves_nothing_behind(canyon: Scenario, tmp_path: Path) -> None:
    write_simulation(canyon, tmp_path, duration_s=1.0)
    before = {name: (tmp_path / name).read_bytes() for name in FILES}
    (tmp_path / "truth.csv").unlink()
    (tmp_path / "truth.csv").mkdir()
    with pytest.raises(OSError, match=r"truth\.csv"):
        write_simulation(canyon, tmp_path, seed=9, duration_s=1.0)
    assert {path.name for path in tmp_path.iterdir()} == set(FILES)
    assert (tmp_path / "stations.csv").read_bytes() == before["stations.csv"]


def run_command(*arguments: str) -> tuple[int, str, str]:
    app = typer.Typer(rich_markup_mode=None)
    app.command()(simulate)
    ended = CliRunner().invoke(app, arguments)
    return ended.exit_code, ended.stdout, ended.stderr


def test_the_command_tells_what_it_wrote(tmp_path: Path) -> None:
    code, printed, _ = run_command("street_canyon", "--out", str(tmp_path), "--duration", "2", "--json")
    assert code == 0
    told = json.loads(printed)
    assert told["epochs"] == 11
    assert told["reception"] == {"line_of_sight": 11 * 11}
    code, printed, _ = run_command("street_canyon", "--out", str(tmp_path), "--duration", "2", "--seed", "4")
    assert code == 0
    assert "11 epochs over 2 s" in printed


def test_the_command_names_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text('name = "bad"\n', "utf-8")
    (tmp_path / "file").write_text("", "utf-8")
    for arguments, code, told in [
        (["no_such", "--out", str(tmp_path)], 2, "no scenario 'no_such'"),
        ([str(tmp_path / "bad.toml"), "--out", str(tmp_path)], 2, "bad.toml: Object missing required field `line`"),
        (["street_canyon", "--out", str(tmp_path / "file")], 2, "is there and is no folder"),
        (["street_canyon", "--out", str(tmp_path / "file" / "x"), "--duration", "1"], 1, "Not a directory"),
        (["street_canyon"], 2, "--out"),
    ]:
        ended, _, error = run_command(*arguments)
        assert ended == code
        assert told in error
