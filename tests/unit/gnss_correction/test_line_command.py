"""The line on the command line: a simulated run solved by file, and what cannot be meant."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.gnss_correction.command import app
from services.simulator.scenario_file import read_scenario
from services.simulator.simulation_file import write_simulation


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated")
    write_simulation(read_scenario("street_canyon"), folder, duration_s=60.0)
    return folder


def solve(folder: Path, out: Path, *further: str) -> tuple[int, str]:
    given = ["solve", "--rover", str(folder / "rover.obs"), "--nav", str(folder / "nav.rnx"), "--out", str(out)]
    result = CliRunner().invoke(app, [*given, *further])
    return result.exit_code, result.output


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def wheel_file(path: Path) -> Path:
    """Wheels that stand for twelve seconds."""
    path.write_text("gps_week,tow_s,speed_mps\n" + "".join(f"2412,{190_800 + 0.2 * k:.1f},0\n" for k in range(60)))
    return path


def test_a_recording_is_solved_along_its_line(simulated: Path, tmp_path: Path) -> None:
    out, line = tmp_path / "fixes.csv", str(simulated / "track_centreline.csv")
    code, _ = solve(simulated, out, "--method", "line", "--line", line)
    assert code == 0
    fixes = rows(out)
    assert all(row["status"] == "fix" and row["chainage_m"] and row["chainage_bound_m"] for row in fixes)
    # The train stands at 150 m for 15 s, then starts; the antenna is 4 m above the rail.
    assert abs(float(fixes[50]["chainage_m"]) - 150.0) < 6.0
    assert abs(float(fixes[50]["chainage_m"]) - 150.0) < float(fixes[50]["chainage_bound_m"])


def test_every_method_has_chainages_with_a_line_and_none_without(simulated: Path, tmp_path: Path) -> None:
    out, line = tmp_path / "fixes.csv", str(simulated / "track_centreline.csv")
    assert solve(simulated, out, "--method", "robust", "--line", line)[0] == 0
    placed = [row for row in rows(out) if row["chainage_m"]]
    assert len(placed) > 200
    assert all(row["chainage_bound_m"] for row in placed)
    assert solve(simulated, out, "--method", "robust")[0] == 0
    assert "chainage_m" not in rows(out)[0]


def test_what_cannot_be_meant_is_said(simulated: Path, tmp_path: Path) -> None:
    out, line = tmp_path / "fixes.csv", str(simulated / "track_centreline.csv")
    wheel = str(wheel_file(tmp_path / "wheel.csv"))
    assert solve(simulated, out, "--method", "line")[0] == 2
    code, text = solve(simulated, out, "--method", "robust", "--line", line, "--wheel", wheel)
    assert code == 2
    assert "only the method line" in text
    code, text = solve(simulated, out, "--method", "line", "--line", str(simulated / "truth.csv"))
    assert code == 1
    assert "truth.csv:1: no column chainage_m" in text
    code, text = solve(simulated, out, "--method", "line", "--line", line, "--wheel", line)
    assert code == 1
    assert "no column gps_week, tow_s, speed_mps" in text
    assert not out.exists()


def test_wheels_are_taken_in(simulated: Path, tmp_path: Path) -> None:
    out, line = tmp_path / "fixes.csv", str(simulated / "track_centreline.csv")
    wheel = str(wheel_file(tmp_path / "wheel.csv"))
    assert solve(simulated, out, "--method", "line", "--line", line, "--wheel", wheel)[0] == 0
    standing = rows(out)[5:55]
    assert max(abs(float(row["ve_mps"])) for row in standing) < 0.05


def test_the_evaluation_prints_the_error_along_the_line(simulated: Path, tmp_path: Path) -> None:
    out, line = tmp_path / "fixes.csv", str(simulated / "track_centreline.csv")
    assert solve(simulated, out, "--method", "line", "--line", line)[0] == 0
    truth = str(simulated / "truth.csv")
    given = ["evaluate", "--fixes", str(out), "--truth", truth, "--centreline", line]
    printed = CliRunner().invoke(app, given).output
    assert "Error along the line against the truth" in printed
    assert "epochs beyond their bound" in printed
