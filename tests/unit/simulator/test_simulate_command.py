from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from schemas.topic import Place
from services.simulator.command import fault, simulate
from services.simulator.fault_command import nobody_there
from services.simulator.live_command import profile_text
from services.simulator.motion_log import simulate_motion_log
from services.simulator.motion_settings import Driving, MotionSettings
from services.simulator.scenario_file import alignment_for
from services.simulator.train_route import route_of
from services.simulator.train_scenario import Journey, train_scenario_from_toml
from tests.unit.simulator.motion_tracks import PERFECT

APP = typer.Typer()
APP.command()(simulate)
APP.command()(fault)


def run(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(APP, words)
    return result.exit_code, result.output


def test_a_train_s_simulation_is_summed_up(tmp_path: Path) -> None:
    code, text = run("simulate", "slips_16permille", "--out", str(tmp_path / "run"), "--duration", "30", "--json")
    assert code == 0
    summary = json.loads(text)
    assert summary["duration_s"] == 30.0
    assert summary["files"] == ["imu.parquet", "motion.toml", "tacho.parquet", "truth.parquet"]
    code, text = run("simulate", "curves_only", "--out", str(tmp_path / "line"), "--duration", "5")
    assert code == 0
    assert "5 s, 0.00 km, 0 slips" in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("simulate", "demo_line"), "either --out DIR or --live"),
        (("simulate", "demo_line", "--out", "x", "--live"), "either --out DIR or --live"),
        (("simulate", "demo_line", "--out", "x", "--fleet", "2"), "--fleet goes with --live"),
        (("simulate", "demo_lin", "--out", "x"), "no scenario 'demo_lin'; there are: bad_sensors"),
        (("simulate", "demo_line", "--out", __file__), "no folder"),
        (("fault", "slid"), "no fault 'slid', did you mean slide?"),
        (("fault", "slide", "--off", "--seconds", "3"), "go with switching on"),
        (("fault", "imu_late", "--magnitude", "1e300"), "0 to 60 s is wanted"),
        (("fault", "slide", "--magnitude", "nan"), "0 to 50 m/s is wanted"),
        (("fault", "slide", "--train", "T 1"), "cannot stand in a key"),
    ],
)
def test_what_cannot_be_meant_is_refused(words: tuple[str, ...], said: str) -> None:
    code, text = run(*words)
    assert code == 2
    assert said in text.replace("\n", " ")


def test_a_journey_that_cannot_be_is_named_with_its_file(tmp_path: Path) -> None:
    path = tmp_path / "far.toml"
    path.write_text('name="far"\nline="demo"\n[journey]\nstops=["atlantis"]\n', "utf-8")
    code, text = run("simulate", str(path), "--out", str(tmp_path / "run"))
    assert code == 2
    assert "far.toml: journey.stops: no station 'atlantis'" in text.replace("\n", "")
    assert not (tmp_path / "run").exists()


def test_a_journey_without_a_stop_ahead_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "short.toml"
    path.write_text('name="short"\nline="demo"\n[journey]\nstops=["matsuo"]\n', "utf-8")
    code, text = run("simulate", str(path), "--out", str(tmp_path / "run"))
    assert (code, (tmp_path / "run").exists()) == (2, False)
    assert "no stop is more than the train's length" in text.replace("\n", " ")


def test_a_fault_of_a_train_that_does_not_run_names_those_that_do() -> None:
    alive = {"demo/train/T1/simulator", "demo/train/T2/simulator", "demo/train/T2/train_position"}
    said = nobody_there(Place("demo", "train", "T9"), alive)
    assert said == "no simulator of demo/train/T9 is running; there are: T1, T2 (--train, --line)"
    assert "none is on line demo" in nobody_there(Place("demo", "train", "T1"), set())


def test_trains_of_a_fleet_share_the_first_one_s_router() -> None:
    first, second = profile_text("demo_line", 0, None), profile_text("own/scenario.toml", 1, 7)
    assert "enabled = false" not in first
    assert "seed" not in first
    assert "enabled = false" in second
    assert 'name = "T2"' in second
    assert f'scenario = "{Path("own/scenario.toml").resolve()}"' in second
    assert "under_way_s = 240.0" in second
    assert "seed = 8" in second


def test_a_log_on_a_line_knows_its_places() -> None:
    loaded = alignment_for(train_scenario_from_toml('name="a"\nline="demo"'))
    assert loaded is not None
    route = route_of(loaded.alignment, Journey(direction="down", start_axis_m=3500.0, stops=("kirihama", "matsuo")))
    settings = MotionSettings(imu=PERFECT, driving=Driving(dwell_s=(2.0, 2.0)))
    log = simulate_motion_log(route.track, settings, np.random.default_rng(1), start_m=route.start_m, duration_s=400.0)
    places = route.places_of(log.way_m, log.trip)
    assert places[0] == pytest.approx(3500.0, abs=0.1)
    assert places.min() == pytest.approx(250.0, abs=7.0)
    # At Kirihama the rear end, 60 m back, becomes the front end.
    turned = int(np.flatnonzero(np.diff(log.trip))[0])
    assert places[turned + 1] - places[turned] == pytest.approx(60.0, abs=0.5)
    assert places[-1] > places[turned + 1]
