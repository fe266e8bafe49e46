"""`kirotei position run` and `evaluate` on small tables."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from services.train_position.command import app
from tests.unit.train_position.made_up import straight_line

RUNNER = CliRunner()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A minute at 20 m/s from 5 km on, with a wheel that counts 1 % too little, and what references say."""
    (tmp_path / "line.json").write_bytes(msgspec.json.encode(straight_line()))
    motion, truth = ["t_s,distance_m,speed_mps,slip,bound_m,status"], ["t_s,axis_m"]
    for k in range(600):
        t_s = k / 10.0
        motion.append(f"{t_s},{20.0 * t_s / 1.01:.4f},20.0,0,{1.0 + 0.4 * t_s:.3f},valid")
        truth.append(f"{t_s},{5_000.0 + 20.0 * t_s:.3f}")
    (tmp_path / "motion.csv").write_text("\n".join(motion) + "\n")
    (tmp_path / "truth.csv").write_text("\n".join(truth) + "\n")
    (tmp_path / "matches.csv").write_text(
        "t_s,landmark,branch,accepted,reason,correction_m,axis_m,bound_m\n"
        "20.0,C1-up,,1,accepted,0,5401.0,5.0\n40.0,C2-up,,0,length,0,5800.0,0.0\n"
    )
    (tmp_path / "balises.csv").write_text("t_s,balise,sensor_offset_m,detection_bound_m\n50.0,B12,0.0,1.0\n")
    (tmp_path / "changes.csv").write_text("t_s,kind,length_m,front_shift_m\n55.0,coupled,90,0\n")
    return tmp_path


def run(folder: Path, *extra: str) -> tuple[int, str]:
    names = {"--motion": "motion.csv", "--line": "line.json", "--out": "positions.csv", "--matches": "matches.csv"}
    given = [part for option, name in names.items() for part in (option, str(folder / name))]
    found = RUNNER.invoke(app, ["run", *given, *extra])
    return found.exit_code, found.output


def test_a_run_is_placed_and_judged(folder: Path) -> None:
    extra = ("--start-axis-m", "5000", "--direction", "up", "--balises", str(folder / "balises.csv"))
    changes = ("--changes", str(folder / "changes.csv"), "--passes", str(folder / "passes.csv"), "--json")
    code, output = run(folder, *extra, *changes)
    assert code == 0, output
    assert json.loads(output)["references_within_bound"] == 2
    with (folder / "positions.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 600
    assert {row["status"] for row in rows} == {"valid"}
    picture = folder / "margin.png"
    found = RUNNER.invoke(
        app,
        [
            "evaluate",
            str(folder / "positions.csv"),
            "--truth",
            str(folder / "truth.csv"),
            "--passes",
            str(folder / "passes.csv"),
            "--plot",
            str(picture),
            "--json",
        ],
    )
    assert found.exit_code == 0, found.output
    (judged,) = json.loads(found.output)
    assert judged["within"] == judged["compared"] == 600
    assert judged["resets"] >= 1
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("extra", "code", "words"),
    [
        (("--direction", "left"), 2, "neither up nor down"),
        (("--fixes", "none.csv"), 2, "--about"),
        (("--balises", "none.csv"), 1, "none.csv: No such file"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(folder: Path, extra: tuple[str, ...], code: int, words: str) -> None:
    found, output = run(folder, *extra)
    assert found == code
    assert words in output
    assert not (folder / "positions.csv").exists()


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("motion.csv", "20.0,0,1.040,valid", "20.0,0,nan,valid", "motion.csv:3: bound_m is 'nan'"),
        ("motion.csv", "20.0,0,1.040,valid", "20.0,0,-4,valid", "motion.csv:3: bound_m is -4"),
        ("motion.csv", "20.0,0,1.040,valid", "20.0,0,1.04,fine", "motion.csv:3: status is 'fine'"),
        ("matches.csv", "5401.0", "", "matches.csv:2: axis_m is blank"),
        ("matches.csv", "axis_m", "place", "no column axis_m"),
    ],
)
def test_a_wrong_table_is_named_by_file_and_line(folder: Path, file: str, old: str, new: str, words: str) -> None:
    path = folder / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    code, output = run(folder)
    assert code == 1
    assert words in output
