"""Motion logs and motion.csv: what is read, what is refused, and how that is said."""

from __future__ import annotations

from pathlib import Path

import duckdb
import numpy as np
import pytest
from typer.testing import CliRunner

from services.odometry_fusion.command import app
from services.odometry_fusion.evaluation import (
    MotionTrack,
    MotionTruth,
    WheelWay,
    error_of,
    evaluate,
    even_marks,
    lag_of,
    measured_stretches,
    spans_of,
)
from services.odometry_fusion.motion_file import MotionTableError, read_motion, write_motion
from services.odometry_fusion.motion_log import MotionLog
from services.odometry_fusion.motion_log_file import IMU_COLUMNS, MotionLogError, read_motion_log
from services.odometry_fusion.motion_plot import draw_motion
from services.odometry_fusion.motion_truth_file import read_truth, read_wheel_beside
from services.odometry_fusion.picture_plot import save_picture
from tests.unit.odometry_fusion.test_paper_runs import paper, run_of

TOML = """axes = "x forward, y left, z up; right-handed"
pulses_per_revolution = 90
wheel_diameter_m = 0.816
imu_latency_s = 0.3
max_gradient_permille = 35.0
"""


def write_log(folder: Path, log: MotionLog, *, ending: str = "csv") -> None:
    """A motion log on disk."""
    folder.mkdir(exist_ok=True)
    (folder / "motion.toml").write_text(TOML)
    imu = dict(zip(IMU_COLUMNS, np.column_stack([log.imu_t_s, log.imu]).T.copy(), strict=True))
    tacho = {"t_s": log.tacho_t_s, "pulses": log.pulses}
    for name, columns in (("imu", imu), ("tacho", tacho)):
        base = duckdb.connect()
        base.register("columns_", columns)
        kind = "(FORMAT parquet)" if ending == "parquet" else "(FORMAT csv, HEADER true)"
        base.execute(f"COPY (SELECT * FROM columns_) TO '{folder}/{name}.{ending}' {kind}")  # noqa: S608 - our own names
        base.close()


def short() -> MotionLog:
    """The first 20 s of a run."""
    log, _, _ = run_of()
    return MotionLog(log.imu_t_s[:2000], log.imu[:2000], log.tacho_t_s[:200], log.pulses[:200], 90.0, 0.816, 0.3, 35.0)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_log_is_read_as_it_was_written(tmp_path: Path, ending: str) -> None:
    log = short()
    write_log(tmp_path / "run", log, ending=ending)
    read = read_motion_log(tmp_path / "run")
    assert read.issues == ()
    assert np.array_equal(read.log.imu, log.imu)
    assert np.array_equal(read.log.pulses, log.pulses)
    assert read.log.vehicle == log.vehicle


def change(path: Path, old: str, new: str) -> None:
    path.write_text(path.read_text().replace(old, new, 1))


def test_single_broken_samples_are_left_out_and_named(tmp_path: Path) -> None:
    write_log(tmp_path, short())
    lines = (tmp_path / "tacho.csv").read_text().splitlines()
    lines[5] = lines[5].split(",")[0] + ",nan"
    lines[9] = lines[8]
    lines[12] = lines[12].split(",")[0] + ","
    (tmp_path / "tacho.csv").write_text("\n".join(lines) + "\n")
    read = read_motion_log(tmp_path)
    assert len(read.log.pulses) == 197
    assert [issue.removeprefix(str(tmp_path)) for issue in read.issues] == [
        "/tacho.csv:6: not a finite number in 2 of 200 rows, here first; left out",
        "/tacho.csv:10: time does not rise in 1 of 200 rows, here first; left out",
    ]


REFUSED = {
    "no column": ("imu.csv", "gz_radps", "gz_degps", "column 'gz_radps' is missing"),
    "not a number": ("imu.csv", "\n0.01,", "\nsoon,", "imu.csv"),
    "no latency": ("motion.toml", "imu_latency_s = 0.3", "", "imu_latency_s is missing"),
    "absurd wheel": ("motion.toml", "0.816", "816", "wheel_diameter_m is 816; it must lie between 0.1 and 3"),
    "words": ("motion.toml", "= 90", '= "ninety"', "pulses_per_revolution is 'ninety', no number"),
    "other axes": ("motion.toml", "x forward, y left", "x forward, y right", "turn them first"),
    "no toml": ("motion.toml", "axes =", "axes ", "motion.toml"),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_what_cannot_be_meant_is_refused_with_its_name(tmp_path: Path, fault: str) -> None:
    write_log(tmp_path, short())
    name, old, new, words = REFUSED[fault]
    change(tmp_path / name, old, new)
    with pytest.raises(MotionLogError, match=words.replace("(", r"\(")) as caught:
        read_motion_log(tmp_path)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    ("factors", "words"),
    [([1 / 9.81] * 3 + [1.0] * 3, "specific force is 1,"), ([1.0] * 3 + [3000.0] * 3, "degrees instead of radians")],
)
def test_other_units_are_told(tmp_path: Path, factors: list[float], words: str) -> None:
    log = short()
    write_log(tmp_path, MotionLog(log.imu_t_s, log.imu * factors, log.tacho_t_s, log.pulses, 90.0, 0.816, 0.3, 35.0))
    with pytest.raises(MotionLogError, match=words):
        read_motion_log(tmp_path)


def test_milliseconds_and_leaps_of_the_clock_are_refused(tmp_path: Path) -> None:
    log = short()
    for times, words in ((log.tacho_t_s * 1e3, "seconds between"), (log.tacho_t_s + 1e6, "share no time")):
        write_log(tmp_path, MotionLog(log.imu_t_s, log.imu, times, log.pulses, 90.0, 0.816, 0.3, 35.0))
        with pytest.raises(MotionLogError, match=words):
            read_motion_log(tmp_path)
    leap = np.where(np.arange(200) > 150, log.tacho_t_s + 1e6, log.tacho_t_s)
    write_log(tmp_path, MotionLog(log.imu_t_s, log.imu, leap, log.pulses, 90.0, 0.816, 0.3, 35.0))
    with pytest.raises(MotionLogError, match=r"tacho\.csv:153: t_s leaps by 1e"):
        read_motion_log(tmp_path)
    with pytest.raises(MotionLogError, match="no such folder"):
        read_motion_log(tmp_path / "nowhere")


def test_motion_csv_comes_back_and_never_loses_bound(tmp_path: Path) -> None:
    rows = paper(short())
    write_motion(tmp_path / "motion.csv", rows)
    track = read_motion(tmp_path / "motion.csv")
    assert track.distance_m == pytest.approx(rows.distance_m, abs=5.1e-5)  # four decimals
    assert (track.bound_m >= rows.bound_m - 1e-9).all()
    assert list(tmp_path.iterdir()) == [tmp_path / "motion.csv"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [("bound_m", "bound", "1: no motion table"), ("valid", "fine", "2: status 'fine'"), ("0.0000", "zero", "2: could")],
)
def test_a_table_that_is_none_is_refused_by_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "motion.csv"
    write_motion(path, paper(short()))
    change(path, old, new)
    with pytest.raises(MotionTableError, match=words):
        read_motion(path)


def made(
    error_m: np.ndarray, *, slip: tuple[float, float] = (40.0, 46.0), told: tuple[float, float] = (41.0, 50.0)
) -> tuple[MotionTrack, MotionTruth]:
    """10 m/s for 100 s, one true slip, one that is told, and an error over time."""
    t_s = np.arange(0.0, 100.0, 0.1)
    true = MotionTruth(t_s, 10.0 * t_s, np.full(1000, 10.0), ((t_s >= slip[0]) & (t_s < slip[1])).astype(np.int64))
    marked = (t_s >= told[0]) & (t_s < told[1])
    return MotionTrack(
        "made", t_s, 10.0 * t_s + error_m, true.speed_mps, marked, np.full(1000, 4.0), ("valid",) * 1000
    ), true


def test_evaluation_counts_what_it_says() -> None:
    t_s = np.arange(0.0, 100.0, 0.1)
    track, true = made(np.where(t_s > 45.0, 3.0, 0.0))
    found = evaluate(track, true, None)
    assert (found.slips, found.counted, found.detected, found.early, found.violations) == (1, 1, 1, 0, 0)
    assert found.readhered_percent == 100.0
    assert found.median_m == pytest.approx(3.0)
    assert found.worst_share == pytest.approx(0.75)
    assert found.false_per_hour == 0.0
    assert found.above_etcs_percent == 0.0


def test_a_bound_that_is_broken_or_missing_counts_against() -> None:
    track, true = made(np.full(1000, 0.0) + np.linspace(0.0, 8.0, 1000))
    assert evaluate(track, true, None).violations == 500
    assert error_of(track, true)[-1] == pytest.approx(8.0)
    blank = MotionTrack(
        "b", track.t_s, track.distance_m, track.speed_mps, track.slip, np.full(1000, np.nan), track.status
    )
    found = evaluate(blank, true, None)
    assert (found.violations, found.bounded_percent, found.above_etcs_percent) == (1000, 0.0, 100.0)


@pytest.mark.parametrize(
    ("told", "readhered", "early", "false"),
    [((41.0, 60.0), 0.0, 0, 0), ((41.0, 43.0), 0.0, 1, 0), ((70.0, 72.0), 0.0, 0, 1), ((39.9, 53.0), 100.0, 0, 0)],
)
def test_slips_told_too_long_too_short_or_elsewhere(
    told: tuple[float, float], readhered: float, early: int, false: int
) -> None:
    track, true = made(np.zeros(1000), told=told)
    found = evaluate(track, true, None)
    assert (found.readhered_percent, found.early) == (readhered, early)
    assert found.false_per_hour * found.hours == pytest.approx(false)


def test_slips_that_cost_the_wheel_nothing_do_not_count() -> None:
    track, true = made(np.zeros(1000))
    cheap = evaluate(track, true, WheelWay(true.t_s, true.distance_m + 0.0))
    dear = evaluate(track, true, WheelWay(true.t_s, true.distance_m + np.interp(true.t_s, [40, 46], [0, 5])))
    assert (cheap.slips, cheap.counted, cheap.readhered_percent) == (1, 0, None)
    assert dear.counted == 1


def test_a_constant_lag_is_found_where_nothing_slips() -> None:
    t_s = np.arange(0.0, 200.0, 0.1)
    way_m = 200.0 * np.sin(t_s / 20.0)
    truth = MotionTruth(t_s, way_m, np.gradient(way_m, t_s), np.zeros(2000, np.int64))
    late = MotionTrack(
        "late", t_s, 200.0 * np.sin((t_s - 0.3) / 20.0), t_s, np.zeros(2000, np.bool_), np.ones(2000), ("valid",) * 2000
    )
    assert lag_of(late, truth) == pytest.approx(0.3)
    assert [tuple(span) for span in spans_of(np.array([0, 1, 1, 0, 1], bool), np.arange(5.0))] == [
        (1.0, 3.0),
        (4.0, 4.0),
    ]


def test_marks_measure_the_distance_between_them() -> None:
    track, true = made(np.linspace(0.0, 10.0, 1000))  # 1 % too long
    found = measured_stretches(track.t_s, track.distance_m, true, even_marks(true, 200.0))
    assert found.measured_m / found.true_m == pytest.approx(1.01, abs=1e-4)
    assert found.slipped.tolist() == [False, True, False, False]


def test_commands_run_judge_and_draw(tmp_path: Path) -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0)
    write_log(tmp_path / "run", log, ending="parquet")
    rows = ["t_s,distance_m,speed_mps,slip"]
    rows += [
        f"{t:.2f},{d:.4f},0,{-1 if 70 <= t < 78 else 0}" for t, d in zip(t_s[9::10], distance_m[9::10], strict=True)
    ]
    truth = tmp_path / "run" / "truth.csv"
    truth.write_text("\n".join(rows) + "\n")
    runner = CliRunner()
    for method in ("wheel", "paper"):
        done = runner.invoke(
            app, ["run", str(tmp_path / "run"), "--method", method, "--out", f"{tmp_path}/{method}.csv"]
        )
        assert done.exit_code == 0, done.output
    motions = ["--motion", f"{tmp_path}/wheel.csv", "--motion", f"{tmp_path}/paper.csv"]
    judged = runner.invoke(app, ["evaluate", *motions, "--truth", str(truth), "--plot", f"{tmp_path}/plot.png"])
    assert judged.exit_code == 0, judged.output
    assert "wheel taken up again rightly [%]" in judged.output
    first = (tmp_path / "plot.png").read_bytes()
    tracks = [read_motion(tmp_path / "wheel.csv"), read_motion(tmp_path / "paper.csv")]
    true = read_truth(truth)
    save_picture(tmp_path / "plot.png", draw_motion(tracks, true, read_wheel_beside(truth), even_marks(true, 1000.0)))
    assert (tmp_path / "plot.png").read_bytes() == first
    as_json = runner.invoke(app, ["evaluate", *motions, "--truth", str(truth), "--json"])
    assert '"violations": 0' in as_json.output


def test_commands_say_in_one_line_why_not(tmp_path: Path) -> None:
    runner = CliRunner()
    write_log(tmp_path, short())
    for arguments, code, words in (
        (["run", str(tmp_path), "--method", "guess", "--out", "x.csv"], 2, "--method"),
        (["run", str(tmp_path / "no"), "--method", "paper", "--out", "x.csv"], 1, "no such folder"),
        (["run", str(tmp_path), "--method", "paper", "--out", f"{tmp_path}/no/x.csv"], 1, "No such file"),
        (["evaluate", "--motion", f"{tmp_path}/motion.toml", "--truth", "t.csv"], 1, "t.csv: no such file"),
        (["evaluate", "--motion", f"{tmp_path}/tacho.csv", "--truth", f"{tmp_path}/tacho.csv"], 1, "is missing"),
    ):
        done = runner.invoke(app, arguments)
        assert done.exit_code == code, done.output
        assert words in done.output
        assert "Traceback" not in done.output
