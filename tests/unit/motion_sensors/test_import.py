from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from numpy.typing import NDArray
from typer.testing import CliRunner

from services.motion_sensors import command
from services.motion_sensors.import_file import PULSES, WHEEL_M, pulses_of_speed
from services.odometry_fusion.motion_log_file import read_motion_log

app = typer.Typer()
app.command("import")(command.import_log)
app.command()(command.calibrate)


def call(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(one) for one in arguments])
    return result.exit_code, result.output


def segment(folder: Path) -> Path:
    """A made-up segment of comma2k19: 10 m/s on level track."""

    def put(name: str, values: NDArray[np.float64]) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            np.save(file, values)

    t = 46_000.0 + np.arange(0.0, 60.0, 0.01)
    put("processed_log/IMU/accelerometer/t", t)
    put("processed_log/IMU/accelerometer/value", np.tile([0.1, 0.2, -9.8], (len(t), 1)))
    put("processed_log/IMU/gyro/t", t[::2])
    put("processed_log/IMU/gyro/value", np.tile([0.01, 0.02, 0.03], (len(t[::2]), 1)))
    put("processed_log/CAN/wheel_speed/t", t)
    put("processed_log/CAN/wheel_speed/value", np.full((len(t), 4), 10.0))
    put("global_pose/frame_times", t[::5])
    put("global_pose/frame_velocities", np.tile([6.0, 8.0, 0.0], (len(t[::5]), 1)))
    return folder


def test_a_segment_becomes_a_motion_log_in_our_axes(tmp_path: Path) -> None:
    code, said = call("import", "comma2k19", segment(tmp_path / "segment"), "--out", tmp_path / "log")
    assert code == 0, said
    log = read_motion_log(tmp_path / "log").log
    assert log.imu[0] == pytest.approx([0.1, -0.2, 9.8, 0.01, -0.02, -0.03])
    metre = np.pi * WHEEL_M / PULSES
    assert (log.pulses[-1] - log.pulses[0]) * metre == pytest.approx(599.9, abs=0.01)
    assert (tmp_path / "log" / "truth.parquet").exists()


def test_tables_with_their_own_names_units_and_axes(tmp_path: Path) -> None:
    (tmp_path / "imu.csv").write_text(
        "sep=,\nStamp,AX,AY,AZ,GX,GY,GZ,more\n"
        + "".join(f"{10 * k},0.05,0.025,-1.0,9,0,-4.5,x\n" for k in range(500))
        + "broken,,,,,,,\n5000,0,0,1e300,0,0,0,x\n"
    )
    (tmp_path / "wheel.csv").write_text("Stamp,kmh\n" + "".join(f"{100 * k},36\n" for k in range(51)))
    code, said = call(
        "import", "csv", tmp_path / "imu.csv", "--tacho", tmp_path / "wheel.csv", "--out", tmp_path / "log",
        "--imu-columns", "t=Stamp,ax=AX,ay=AY,az=AZ,gx=GX,gy=GY,gz=GZ", "--tacho-columns", "t=Stamp,speed=kmh",
        "--axes", "x,-y,-z", "--time-scale", 0.001, "--force-unit", "g", "--rate-unit", "dps", "--speed-unit", "kmh",
    )  # fmt: skip
    assert code == 0, said
    assert "imu.csv: 2 rows that are no measurements left out, line 503 for one" in said.replace("\n", "")
    log = read_motion_log(tmp_path / "log").log
    nine = np.pi / 20
    assert log.imu[3] == pytest.approx([0.4903325, -0.24516625, 9.80665, nine, 0.0, nine / 2])
    assert log.imu_t_s[-1] == pytest.approx(4.99)
    assert (log.pulses[-1]) * np.pi * WHEEL_M / PULSES == pytest.approx(50.0, abs=1e-3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("--tacho-columns", "t=Stamp,speed=nothing"), "nothing"),
        (("--imu-columns", "t=Stamp"), "say which column is ax"),
        (("--axes", "x,y,-z"), "right-handed"),
        (("--axes", "x,y"), "wants three"),
        (("--force-unit", "stone"), "stone"),
        (("--imu-columns", "t"), "not of the form"),
    ],
)
def test_what_cannot_be_read_is_named_and_nothing_is_left(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    (tmp_path / "imu.csv").write_text("Stamp,AX\n0,1\n1,2\n")
    (tmp_path / "wheel.csv").write_text("Stamp,kmh\n0,1\n1,2\n")
    code, said = call(
        "import", "csv", tmp_path / "imu.csv", "--tacho", tmp_path / "wheel.csv", "--out", tmp_path / "log",
        "--imu-columns", "t=Stamp,ax=AX,ay=AX,az=AX,gx=AX,gy=AX,gz=AX", "--tacho-columns", "t=Stamp,speed=kmh", *change,
    )  # fmt: skip
    assert code in (1, 2)
    assert words in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["imu.csv", "wheel.csv"]


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("CAN/wheel_speed/t", np.arange(100.0), "one of the files is cut off"),
        ("IMU/accelerometer/value", np.zeros(5), "n rows of 3"),
        ("IMU/accelerometer/t", np.array(["a", "b"]), "not all numbers"),
        ("IMU/gyro/t", np.array(5.0), "n rows of 3"),
        ("CAN/wheel_speed/value", np.full((6000, 4), 1e300), "not all numbers"),
        ("IMU/gyro/value", np.full((3000, 3), np.nan), "not all numbers"),
    ],
)
def test_a_broken_segment_is_named_and_nothing_is_left(
    tmp_path: Path, name: str, values: NDArray[np.float64], words: str
) -> None:
    path = segment(tmp_path / "segment") / "processed_log" / name
    with path.open("wb") as file:
        np.save(file, values)
    code, said = call("import", "comma2k19", tmp_path / "segment", "--out", tmp_path / "log")
    assert (code, words in said, path.name in said) == (1, True, True)
    assert not (tmp_path / "log").exists()


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (["5,0,0,9.8,0,0,0"] * 50, "1 samples last 0 s"),
        ([f"{1e9 * k},0,0,9.8,0,0,0" for k in range(50)], "are the column and the unit of time right?"),
        (["0,1e300,0,9.8,0,0,0", "1,0,0,9.8,0,0,1e300"], "no rows of numbers"),
    ],
)
def test_a_table_that_is_no_run_is_refused(tmp_path: Path, rows: list[str], words: str) -> None:
    header = "t_s,ax_mps2,ay_mps2,az_mps2,gx_radps,gy_radps,gz_radps\n"
    (tmp_path / "imu.csv").write_text(header + "\n".join(rows) + "\n")
    (tmp_path / "wheel.csv").write_text("t_s,pulses\n" + "".join(f"{k},{60 * k}\n" for k in range(50)))
    code, said = call("import", "csv", tmp_path / "imu.csv", "--tacho", tmp_path / "wheel.csv", "--out", tmp_path / "l")
    assert (code, words in said, (tmp_path / "l").exists()) == (1, True, False)


def test_a_log_that_is_there_is_not_touched(tmp_path: Path) -> None:
    (tmp_path / "log").mkdir()
    code, said = call("import", "comma2k19", segment(tmp_path / "segment"), "--out", tmp_path / "log")
    assert code == 1
    assert "is there already" in said


def test_calibration_prints_what_it_knows_and_what_not(tmp_path: Path) -> None:
    call("import", "comma2k19", segment(tmp_path / "segment"), "--out", tmp_path / "log")
    code, said = call("calibrate", tmp_path / "log", "--known-distance", 600, "--json")
    assert code == 0, said
    found = json.loads(said)
    assert found["wheel_diameter_m"]["value"] == pytest.approx(WHEEL_M, rel=1e-3)
    assert found["latency_s"] is None
    code, said = call("calibrate", tmp_path / "log")
    assert "nothing to go by" in said


def test_a_log_is_written_again_calibrated_with_its_truth(tmp_path: Path) -> None:
    call("import", "comma2k19", segment(tmp_path / "segment"), "--out", tmp_path / "log")
    code, said = call("calibrate", tmp_path / "log", "--known-distance", 300, "--out", tmp_path / "new")
    assert code == 0, said
    old, new = read_motion_log(tmp_path / "log").log, read_motion_log(tmp_path / "new").log
    assert (new.pulses == old.pulses).all()
    way_m = (new.pulses[-1] - new.pulses[0]) * np.pi * new.wheel_diameter_m / new.pulses_per_revolution
    assert way_m == pytest.approx(300.0)
    assert (tmp_path / "new/truth.parquet").read_bytes() == (tmp_path / "log/truth.parquet").read_bytes()
    code, said = call("calibrate", tmp_path / "log", "--out", tmp_path / "new")
    assert code == 1
    assert "is there already" in said


def test_pulses_of_a_speed_add_up_to_its_integral() -> None:
    t = np.linspace(0.0, 10.0, 101)
    times, pulses = pulses_of_speed(np.append(t, 5.0), np.append(2.0 * t, 99.0))
    assert len(times) == 101
    assert pulses[-1] * np.pi * WHEEL_M / PULSES == pytest.approx(100.0, abs=1e-3)
