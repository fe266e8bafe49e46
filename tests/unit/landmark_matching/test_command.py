"""`kirotei landmarks survey` and `match` on motion logs of a simulated train, and what they say of bad input."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import duckdb
import numpy as np
import pytest
from typer.testing import CliRunner

from services.landmark_matching.command import app
from services.line.alignment import alignment_of
from services.line.built_in_file import built_in_line
from services.simulator.motion_log import MotionLog, simulate_motion_log
from services.simulator.motion_settings import Imu, MotionSettings
from services.simulator.train_route import route_of
from services.simulator.train_scenario import Journey

RUNNER = CliRunner()
BEGIN_M = 250.0
AXES = "x forward, y left, z up; right-handed; accelerometers give specific force"


def write_log(folder: Path, log: MotionLog) -> None:
    folder.mkdir()
    text = f'axes = "{AXES}"\npulses_per_revolution = {log.pulses_per_revolution}\n'
    text += f"wheel_diameter_m = {log.wheel_diameter_m}\nimu_latency_s = {log.imu_latency_s}\n"
    (folder / "motion.toml").write_text(text + f"max_gradient_permille = {log.max_gradient_permille}\n")
    names = ("ax_mps2", "ay_mps2", "az_mps2", "gx_radps", "gy_radps", "gz_radps")
    imu = {"t_s": log.imu_t_s} | {name: np.ascontiguousarray(log.imu[:, k]) for k, name in enumerate(names)}
    with duckdb.connect() as con:
        for name, table in (("imu", imu), ("tacho", {"t_s": log.tacho_t_s, "pulses": log.pulses})):
            con.register("columns", table)
            con.sql("select * from columns").write_parquet(str(folder / f"{name}.parquet"))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, MotionLog]:
    """From Kirihama to Kuzuhara on the demo line: six landmarks."""
    journey = Journey(stops=("kirihama", "kuzuhara"), irregularity_seed=4)
    route = route_of(alignment_of(built_in_line("demo")), journey)
    settings = MotionSettings(imu=Imu(latency_s=0.0))
    log = simulate_motion_log(route.track, settings, np.random.default_rng(2), start_m=route.start_m)
    folder = tmp_path_factory.mktemp("runs") / "run1"
    write_log(folder, log)
    return folder, log


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text("utf-8").splitlines()))


@pytest.mark.parametrize("start", [[], ["--start-axis", "250", "--direction", "up"]])
def test_a_run_is_matched_within_its_bounds(run: tuple[Path, MotionLog], tmp_path: Path, start: list[str]) -> None:
    folder, log = run
    out, plot = tmp_path / "matches.csv", tmp_path / "curvature.png"
    result = RUNNER.invoke(
        app, ["match", str(folder), "--line", "demo", "--out", str(out), "--plot", str(plot), "--json", *start]
    )
    assert result.exit_code == 0, result.output
    rows = rows_of(out)
    assert len(rows) >= 5
    for row in rows:
        assert row["accepted"] == "1", row
        true_m = float(np.interp(float(row["t_s"]), log.truth_t_s, log.way_m))
        assert abs(float(row["axis_m"]) - true_m) <= float(row["bound_m"])
        assert abs(float(row["axis_m"]) - true_m) <= 4.0  # a crossing spreads by 1 m, the line's landmarks are exact
    assert json.loads(result.stdout)["accepted"] == len(rows)
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_a_survey_makes_a_database_that_the_run_matches(run: tuple[Path, MotionLog], tmp_path: Path) -> None:
    folder, _ = run
    out = tmp_path / "landmarks.json"
    result = RUNNER.invoke(app, ["survey", str(folder), "--line", "demo", "--out", str(out)])
    assert result.exit_code == 0, result.output
    database = json.loads(out.read_text("utf-8"))
    assert database["evidence"] == ["run1"]
    assert database["line"] == "demo"
    again = tmp_path / "again.json"
    RUNNER.invoke(app, ["survey", str(folder), "--line", "demo", "--out", str(again)])
    assert again.read_bytes() == out.read_bytes()
    matches = tmp_path / "matches.csv"
    arguments = ["match", str(folder), "--line", "demo", "--landmarks", str(out), "--out", str(matches)]
    assert RUNNER.invoke(app, arguments).exit_code == 0
    assert [row["landmark"] for row in rows_of(matches) if row["accepted"] == "1"] == [
        one["id"] for one in database["landmarks"]
    ]


def test_a_run_that_is_nowhere_on_the_line_is_left_out_by_name(run: tuple[Path, MotionLog], tmp_path: Path) -> None:
    folder, _ = run
    lost = tmp_path / "elsewhere" / "run1"
    shutil.copytree(folder, lost)
    # a wheel twice as large: no place of the line fits
    toml = lost / "motion.toml"
    toml.write_text(toml.read_text("utf-8").replace("wheel_diameter_m = 0", "wheel_diameter_m = 1"), "utf-8")
    out = tmp_path / "landmarks.json"
    result = RUNNER.invoke(app, ["survey", str(folder), str(lost), "--line", "demo", "--out", str(out), "--json"])
    assert result.exit_code == 0, result.output
    assert "elsewhere/run1 left out: the curvature does not tell where the run is" in result.stderr
    assert "landmarks survey: 100 %" in result.stderr
    assert "C29-up" in json.loads(result.stdout)["not_surveyed"]
    assert json.loads(out.read_text("utf-8"))["evidence"] == [f"{folder.parent.name}/run1"]


def test_a_run_given_twice_is_refused(run: tuple[Path, MotionLog], tmp_path: Path) -> None:
    folder, _ = run
    again = folder.parent / "." / folder.name
    result = RUNNER.invoke(app, ["survey", str(folder), str(again), "--line", "demo", "--out", str(tmp_path / "x")])
    assert result.exit_code == 2
    assert "given twice" in result.output


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--start-axis", "250", "--direction", "left"], 2, "neither up nor down"),
        (["--direction", "up"], 2, "go with --start-axis"),
        (["--start-axis", "250", "--branch", "nowhere"], 2, "no branch 'nowhere'"),
        (["--method", "wheel"], 2, "neither paper nor fused"),
        (["--landmarks", "/nowhere.json"], 1, "/nowhere.json: No such file"),
        (["--plot", "curvature.pdf"], 1, ".png or .svg"),
    ],
)
def test_bad_options_are_named(
    run: tuple[Path, MotionLog], tmp_path: Path, arguments: list[str], code: int, words: str
) -> None:
    folder, _ = run
    out = tmp_path / "matches.csv"
    result = RUNNER.invoke(app, ["match", str(folder), "--line", "demo", "--out", str(out), *arguments])
    assert result.exit_code == code
    assert words in result.output


def test_a_folder_that_is_no_log_is_named(tmp_path: Path) -> None:
    result = RUNNER.invoke(app, ["survey", str(tmp_path), "--line", "demo", "--out", str(tmp_path / "x.json")])
    assert result.exit_code == 1
    assert str(tmp_path) in result.output
    assert not (tmp_path / "x.json").exists()
