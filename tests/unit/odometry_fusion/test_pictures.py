"""`kirotei motion evaluate --plot`: every panel from files, deterministic bytes, and what is said of bad ones."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from schemas.line import Curve, Landmark
from services.landmark_matching.matched_run_file import MatchesError, read_matched_run
from services.odometry_fusion.command import app
from services.odometry_fusion.evaluation import Marks, MotionTrack, MotionTruth, even_marks, measured_stretches
from services.odometry_fusion.motion_plot import draw_motion
from services.odometry_fusion.picture_plot import save_picture
from tests.unit.odometry_fusion.test_paper_runs import run_of
from tests.unit.odometry_fusion.test_shell_files import write_log
from tests.unit.train_position.made_up import straight_line

RUNNER = CliRunner()
BEGIN_M = 1000.0
MATCHES = "t_s,landmark,branch,accepted,reason,correction_m,axis_m,bound_m\n"


def landmark(name: str, start_m: float) -> Landmark:
    """The curve of Iwata et al., table 1, elsewhere."""
    return Landmark(
        id=name,
        direction="up",
        hand="left",
        radius_m=300.0,
        entry_straight_start_m=start_m,
        entry_straight_end_m=start_m + 20.0,
        entry_lower_limit_m=start_m + 54.0,
        exit_lower_limit_m=start_m + 126.0,
        exit_straight_start_m=start_m + 160.0,
        exit_straight_end_m=start_m + 180.0,
    )


LANDMARKS = (landmark("C1-up", 1274.0), landmark("C2-up", 1874.0), landmark("C3-up", 2274.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 2 km from 1000 m on, with everything that other commands would write of it."""
    folder = tmp_path_factory.mktemp("pictures")
    log, t_s, distance_m = run_of(slip_mps=4.0, turn=1.0 / 300.0)
    write_log(folder / "run", log, ending="parquet")
    at, axis_m = t_s[9::10], BEGIN_M + distance_m[9::10]
    truth = [f"{t:.2f},{d - BEGIN_M:.4f},0,{-1 if 70 <= t < 78 else 0}" for t, d in zip(at, axis_m, strict=True)]
    (folder / "run" / "truth.csv").write_text("t_s,distance_m,speed_mps,slip\n" + "\n".join(truth) + "\n")
    place = [f"{t:.2f},{d:.4f}" for t, d in zip(at, axis_m, strict=True)]
    (folder / "run" / "place.csv").write_text("t_s,axis_m\n" + "\n".join(place) + "\n")

    def when(place_m: float) -> float:
        return float(np.interp(place_m, axis_m + 1e-6 * at, at))

    balises = [f"{when(k * 500.0):.3f},B{k},0.0,1.0" for k in (3, 4)]
    (folder / "balises.csv").write_text("t_s,balise,sensor_offset_m,detection_bound_m\n" + "\n".join(balises) + "\n")
    rows = [
        f"{when(1400.0):.3f},C1-up,,1,accepted,-2.0,1400.0,6.0",
        f"{when(1998.0):.3f},C2-up,,0,slip near the landmark,,2000.0,",
        f"{when(2400.0):.3f},C3-up,,1,accepted,3.0,2400.0,7.0",
    ]
    (folder / "matches.csv").write_text(MATCHES + "\n".join(rows) + "\n")
    columns = "t_s,status,axis_m,chainage_m,branch,direction,speed_mps,bound_ahead_m,bound_behind_m,slip\n"
    positions = [
        f"{t:.2f},{'degraded' if 70 <= t < 80 else 'valid'},{x + 1.0:.3f},{x:.3f},,up,0,{5 + 0.1 * k:.2f},5,0"
        for k, (t, x) in enumerate(zip(at[::10], axis_m[::10], strict=True))
    ]
    (folder / "positions.csv").write_text(columns + "\n".join(positions) + "\n")
    bend = Curve(start_axis_m=2900.0, end_axis_m=3100.0, transition_in_m=40.0, transition_out_m=40.0, radius_m=-400.0)
    line = msgspec.structs.replace(straight_line(), landmarks=LANDMARKS, curves=(bend,))
    (folder / "line.json").write_bytes(msgspec.json.encode(line))
    done = RUNNER.invoke(app, ["run", f"{folder}/run", "--method", "wheel", "--out", f"{folder}/wheel.csv"])
    assert done.exit_code == 0, done.output
    return folder


def drawn(folder: Path, plot: str, **files: str) -> tuple[int, str]:
    given = {
        "line": "line.json",
        "balises": "balises.csv",
        "matches": "matches.csv",
        "positions": "positions.csv",
    } | files
    options = [word for name, file in given.items() if file for word in (f"--{name}", str(folder / file))]
    arguments = ["evaluate", "--motion", f"{folder}/wheel.csv", "--truth", f"{folder}/run/truth.csv"]
    done = RUNNER.invoke(app, [*arguments, *options, "--plot", f"{folder}/{plot}"])
    return done.exit_code, done.output


def test_one_picture_holds_speed_errors_balises_curvature_and_margin(folder: Path) -> None:
    code, words = drawn(folder, "a.svg")
    assert code == 0, words
    text = (folder / "a.svg").read_text("utf-8")
    for shown in (
        "speed [km/h]",
        "true slip",
        "5 m + 5 % of the way",
        "|error|, wheel",
        "Distance between balises",
        "(measured − true) / true [%]",
        "curvature [1/km]",
        "C1-up",
        "exit crossing",
        "slip",
        "curve that is no landmark",
        "place along the axis [km]",
        "margin [m]",
        "degraded",
        "20 m + 2 %",
        "since the last reference",
        "way gone [km]",
    ):
        assert f">{shown}</text>" in text, shown


def test_the_same_files_give_the_same_bytes(folder: Path) -> None:
    assert drawn(folder, "one.png") == drawn(folder, "two.png")
    assert (folder / "one.png").read_bytes() == (folder / "two.png").read_bytes()
    assert (folder / "one.png").read_bytes().startswith(b"\x89PNG")


def test_without_other_files_only_the_odometry_is_drawn(folder: Path) -> None:
    code, words = drawn(folder, "b.svg", line="", balises="", matches="", positions="")
    assert code == 0, words
    text = (folder / "b.svg").read_text("utf-8")
    assert "Distance between 1000 m marks" in text
    assert "curvature" not in text
    assert "margin [m]" not in text


@pytest.mark.parametrize(
    ("files", "rows", "code", "words"),
    [
        ({"line": ""}, "", 2, "--balises wants --line"),
        ({"line": "", "balises": ""}, "", 2, "--matches wants --line"),
        ({"matches": "bad.csv"}, MATCHES + "1,C9-up,,1,accepted,0,1400,6\n", 1, "bad.csv:2: the line has no landmark"),
        ({"matches": "bad.csv"}, MATCHES + "1,C1-up,,0,no curve,,1400,\n", 1, "no accepted landmark"),
        ({"matches": "bad.csv"}, MATCHES + "x,C1-up,,1,accepted,0,1400,6\n", 1, "bad.csv:2: "),
        ({"matches": "bad.csv"}, MATCHES + "nan,C1-up,,1,accepted,0,1400,6\n", 1, "bad.csv:2: a figure is not finite"),
        ({"matches": "bad.csv"}, "t_s,landmark\n", 1, "bad.csv:1: no column branch"),
        ({"balises": "bad.csv"}, "t_s,balise,sensor_offset_m,detection_bound_m\n9,X1,0,1\n", 1, "no balise 'X1'"),
    ],
)
def test_bad_files_are_named(folder: Path, files: dict[str, str], rows: str, code: int, words: str) -> None:
    (folder / "bad.csv").write_text(rows)
    found, said = drawn(folder, "c.svg", **files)
    assert found == code, said
    assert words in said
    assert not (folder / "c.svg").exists()


def test_files_for_a_picture_want_one(folder: Path) -> None:
    done = RUNNER.invoke(
        app,
        ["evaluate", "--motion", f"{folder}/wheel.csv", "--truth", f"{folder}/run/truth.csv", "--line", "line.json"],
    )
    assert done.exit_code == 2
    assert "give --plot" in done.output


def test_a_run_is_placed_by_what_was_accepted(folder: Path) -> None:
    run = read_matched_run(folder / "run", folder / "matches.csv", LANDMARKS, 8.0)
    assert [(one.kind, one.accepted) for one in run.matches] == [
        ("accepted", True),
        ("slip", False),
        ("accepted", True),
    ]
    first, last = run.matches[0], run.matches[-1]
    # The sensor is 8 m behind the front end, of which the file tells.
    assert (first.axis_m, last.axis_m) == (1392.0, 2392.0)
    t_s, axis_m = [point.t_s for point in run.trace], [point.axis_m for point in run.trace]
    # Samples are 2 m apart and the speed changes by 1 cm/s between two at most; the slip is bridged to 0.3 m/s.
    assert np.interp([first.t_s, last.t_s], t_s, axis_m) == pytest.approx([1392.0, 2392.0], abs=0.1)


def test_where_two_landmarks_do_not_fit_only_their_surroundings_are_placed(folder: Path, tmp_path: Path) -> None:
    rows = (folder / "matches.csv").read_text().splitlines()
    told = tmp_path / "matches.csv"
    told.write_text("\n".join([rows[0], rows[1], rows[3].replace("2400.0", "1500.0")]) + "\n")
    run = read_matched_run(folder / "run", told, LANDMARKS, 0.0)
    axis_m = np.array([point.axis_m for point in run.trace])
    # 1000 m lie between them by odometry, 100 m by the file: each has the half of that which is nearer to it.
    first = np.array([point.t_s for point in run.trace]) < 0.5 * (run.matches[0].t_s + run.matches[1].t_s)
    assert axis_m[first].max() == pytest.approx(1900.0, abs=5.0)
    assert axis_m[~first].min() == pytest.approx(1000.0, abs=5.0)
    assert len(run.trace) == len(read_matched_run(folder / "run", folder / "matches.csv", LANDMARKS, 0.0).trace)


def test_a_train_that_turns_back_measures_no_distance_from_a_mark_to_itself() -> None:
    t_s = np.arange(0.0, 101.0)
    way_m = np.where(t_s <= 50.0, 10.0 * t_s, 1000.0 - 10.0 * t_s)
    truth = MotionTruth(t_s, way_m, np.full(101, 10.0), np.where(t_s == 15.0, 1, 0))
    marks = Marks("balises", np.array([10.0, 40.0, 60.0, 90.0, 200.0]), np.array([100.0, 400.0, 400.0, 100.0, 900.0]))
    found = measured_stretches(t_s, 1.02 * way_m, truth, marks)
    assert found.true_m.tolist() == [300.0, 300.0]
    assert found.measured_m == pytest.approx([306.0, 306.0])
    assert found.slipped.tolist() == [True, False]


def test_one_mark_makes_no_distance_and_the_picture_says_so(tmp_path: Path) -> None:
    t_s = np.arange(0.0, 50.0)
    truth = MotionTruth(t_s, t_s, np.ones(50), np.zeros(50, np.int64))
    track = MotionTrack("made", t_s, t_s, np.ones(50), np.zeros(50, np.bool_), np.ones(50), ("valid",) * 50)
    save_picture(tmp_path / "a.svg", draw_motion([track], truth, None, even_marks(truth, 1000.0)))
    assert "no two of them were passed" in (tmp_path / "a.svg").read_text("utf-8")


@pytest.mark.parametrize("count", [0, 5])
def test_a_picture_shows_one_to_four_tracks(count: int) -> None:
    t_s = np.arange(0.0, 50.0)
    truth = MotionTruth(t_s, t_s, np.ones(50), np.zeros(50, np.int64))
    track = MotionTrack("made", t_s, t_s, np.ones(50), np.zeros(50, np.bool_), np.ones(50), ("valid",) * 50)
    with pytest.raises(ValueError, match="1 to 4 tracks"):
        draw_motion([track] * count, truth, None, even_marks(truth, 10.0))


def test_matches_of_nothing_are_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "matches.csv").write_text(MATCHES)
    with pytest.raises((MatchesError, OSError), match=str(tmp_path)):
        read_matched_run(tmp_path, tmp_path / "matches.csv", LANDMARKS, 0.0)
