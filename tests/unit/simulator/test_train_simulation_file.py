from __future__ import annotations

import tomllib
from pathlib import Path

import duckdb
import msgspec
import numpy as np
import pytest

from schemas.line import Line
from services.line.line_file import load_line
from services.odometry_fusion.motion_log_file import read_motion_log
from services.simulator.scenario_file import read_any_scenario
from services.simulator.train_scenario import TrainScenario
from services.simulator.train_simulation_file import write_train_simulation


def scenario(name: str) -> TrainScenario:
    found = read_any_scenario(name)
    assert isinstance(found, TrainScenario)
    return found


def rows(path: Path) -> dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    with duckdb.connect() as base:
        return base.execute("select * from read_parquet(?)", [str(path)]).fetchnumpy()


def test_a_motion_log_can_be_read_by_the_odometry(tmp_path: Path) -> None:
    written = write_train_simulation(scenario("slips_33permille"), tmp_path, duration_s=120.0)
    assert written.files == ("imu.parquet", "motion.toml", "tacho.parquet", "truth.parquet")
    read = read_motion_log(tmp_path)
    assert read.issues == ()
    assert (read.log.pulses_per_revolution, read.log.imu_latency_s) == (90.0, 0.3)
    # 120 s at 100 Hz, but for the first 0.3 s, of which no sample has come in yet.
    assert read.log.imu.shape == (12_000 - 30, 6)
    assert read.log.imu_t_s[0] == pytest.approx(0.31)
    truth = rows(tmp_path / "truth.parquet")
    assert len(truth["t_s"]) == len(read.log.pulses) == 1200
    assert set(np.unique(truth["slip"])) <= {-1, 0, 1}
    about = tomllib.loads((tmp_path / "motion.toml").read_text("utf-8"))
    assert about["axes"].startswith("x forward, y left, z up")


def test_a_train_on_a_line_writes_line_place_and_recording(tmp_path: Path) -> None:
    written = write_train_simulation(scenario("demo_line"), tmp_path, duration_s=60.0)
    assert written.epochs == 300
    assert written.balises == 1
    line = msgspec.json.decode((tmp_path / "line.json").read_bytes(), type=Line)
    assert line == load_line(Path("demo")).line
    place = rows(tmp_path / "place.parquet")
    truth = rows(tmp_path / "truth.parquet")
    assert place["axis_m"] - place["axis_m"][0] == pytest.approx(truth["distance_m"] - truth["distance_m"][0])
    assert set(place["direction"]) == {"up"}
    assert (tmp_path / "balises.csv").read_text("utf-8").splitlines()[1].split(",")[1] == "B01"
    assert (tmp_path / "rover.obs").stat().st_size > 100_000


def test_the_same_scenario_and_seed_give_the_same_bytes(tmp_path: Path) -> None:
    for name, seed in (("one", None), ("same", None), ("other", 99)):
        write_train_simulation(scenario("wet_leaves"), tmp_path / name, duration_s=40.0, seed=seed)
    files = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert len(files) == 14
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "same" / file).read_bytes(), file
    changed = {f for f in files if (tmp_path / "one" / f).read_bytes() != (tmp_path / "other" / f).read_bytes()}
    assert {"imu.parquet", "tacho.parquet", "rover.obs"} <= changed
    assert "line.json" not in changed


def test_faults_stand_in_the_log_and_progress_is_told(tmp_path: Path) -> None:
    told: list[float] = []
    blind = msgspec.structs.replace(scenario("bad_sensors"), gnss=None)
    write_train_simulation(blind, tmp_path, duration_s=160.0, progress=told.append)
    assert told[-1] == 1.0
    assert told == sorted(told)
    imu = rows(tmp_path / "imu.parquet")
    gap_s = np.diff(imu["t_s"])
    # `imu_lost` for 1.5 s at 120 s; else 10 ms apart.
    assert gap_s.max() == pytest.approx(1.51, abs=1e-6)
    assert np.sort(gap_s)[-2] == pytest.approx(0.01)
    assert imu["t_s"][int(gap_s.argmax())] == pytest.approx(120.0, abs=0.11)
    frozen = (imu["t_s"] > 150.2) & (imu["t_s"] < 154.9)
    assert len(np.unique(imu["gx_radps"][frozen])) == 1
    assert rows(tmp_path / "tacho.parquet")["pulses"].max() < 65_536
