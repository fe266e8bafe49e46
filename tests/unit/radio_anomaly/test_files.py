"""Files: passes in, models kept, events out, by the functions and by the command."""

from __future__ import annotations

import csv
import gzip
import json
from collections import Counter
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from services.radio_anomaly.command import app
from services.radio_anomaly.file_analysis import analyse, learn
from services.radio_anomaly.passes_file import read_passes
from services.radio_anomaly.radio_model import model_of, monitor_of
from services.radio_anomaly.radio_model_file import read_model, write_model
from services.radio_anomaly.settings import Settings
from services.radio_anomaly.weather_file import read_weather
from tests.unit.radio_anomaly.made_up import csv_of, one_pass

LEARNED = [one for number in range(24) for one in one_pass(number)]
LATER = [
    one
    for number in range(24, 32)
    for one in one_pass(number, change_db=-10.0 if number >= 26 else 0.0, stretch=(15, 25))
]
HEAD = "time,pass_id,radio,channel,direction,chainage_m,power_dbm\n"
GOOD = "2026-01-05T08:00:00Z,P,W1,c,up,120,-80\n"


def run(*arguments: str | Path) -> str:
    result = CliRunner().invoke(app, [str(one) for one in arguments])
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "learn.csv").write_text(csv_of(LEARNED), "utf-8")
    (tmp_path / "later.csv").write_text(csv_of(LATER), "utf-8")
    return tmp_path


@pytest.mark.parametrize(
    ("row", "word"),
    [
        ("2026-01-05T08:00:00,P,W1,c,up,120,-80\n", "zone"),
        ("yesterday,P,W1,c,up,120,-80\n", "ISO 8601"),
        ("1980-01-06T00:00:07Z,P,W1,c,up,120,-80\n", "reset"),
        ("2036-02-07T06:28:16Z,P,W1,c,up,120,-80\n", "reset"),
        ("2026-01-05T08:00:00Z,P,W1,c,up,120,nan\n", "no number"),
        ("2026-01-05T08:00:00Z,P,W1,c,up,120,-999\n", "no power"),
        ("2026-01-05T08:00:00Z,P,W1,c,up,9e12,-80\n", "off every line"),
        ("2026-01-05T08:00:00Z,P,W1,c,sideways,120,-80\n", "direction"),
        ("2026-01-05T08:00:00Z,P,W1,c,up,,-80\n", "without the other"),
        ("2026-01-05T08:00:00Z,P,,c,up,120,-80\n", "empty"),
        ("2026-01-05T08:00:00Z,P,W1,c,up\n", "fields"),
        ("2026-01-05T08:00:00Z,P,W1,c,up,120,\n", "neither"),
    ],
)
def test_rows_that_cannot_be_used_are_named_by_file_and_line(tmp_path: Path, row: str, word: str) -> None:
    path = tmp_path / "passes.csv"
    path.write_text(HEAD + GOOD + row, "utf-8")
    found = read_passes(path)
    assert len(found.readings) == 1
    assert sum(found.refused.values()) == 1
    assert found.named[0].startswith(f"{path}:3: ")
    assert word in found.named[0]


def test_what_was_measured_on_board_without_a_place_is_no_sites(tmp_path: Path) -> None:
    path = tmp_path / "passes.csv"
    head = "time,pass_id,radio,channel,direction,chainage_m,power_dbm,side\n"
    rows = "2026-01-05T08:00:00Z,,W1,c,,,-80,onboard\n2026-01-05T08:00:00Z,,W1,c,,,-80,wayside\n"
    path.write_text(head + rows, "utf-8")
    found = read_passes(path)
    assert [one.direction for one in found.readings] == [None]
    assert found.refused == {"no place, though measured on board": 1}


def test_a_file_that_is_none_is_one_clear_error(tmp_path: Path) -> None:
    path = tmp_path / "passes.csv"
    path.write_text("a,b\n1,2\n", "utf-8")
    with pytest.raises(ValueError, match="no column time"):
        read_passes(path)
    path.write_text(HEAD, "utf-8")
    with pytest.raises(ValueError, match="no usable row of 0"):
        read_passes(path)
    packed = tmp_path / "passes.csv.gz"
    packed.write_bytes(gzip.compress((HEAD + GOOD * 500).encode())[:60])
    with pytest.raises(ValueError, match="no CSV"):
        read_passes(packed)


def test_a_model_survives_its_file(tmp_path: Path) -> None:
    model = learn(LEARNED, Settings(), "line", "learn.csv", Counter())
    write_model(tmp_path / "m.json", model)
    again = read_model(tmp_path / "m.json")
    assert again == model
    assert model_of(monitor_of(again), again.origin, again.evidence) == model
    assert model.evidence is not None
    assert model.evidence.cells == 24 * 40
    assert model.evidence.rate is not None
    assert model.evidence.rate <= 0.01, "these passes are as normal as can be"


def test_files_of_other_versions_and_damaged_ones_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    path.write_text('{"format": 99}', "utf-8")
    with pytest.raises(ValueError, match="format 99"):
        read_model(path)
    path.write_text("{", "utf-8")
    with pytest.raises(ValueError, match="no radio model"):
        read_model(path)


def test_analysing_in_two_pieces_is_analysing_in_one(tmp_path: Path) -> None:
    model = learn(LEARNED, Settings(), "line", "", Counter())
    whole = analyse(LATER, model)
    cut = next(k for k, one in enumerate(LATER) if one.pass_id == "P029")
    first = analyse(LATER[:cut], model)
    write_model(tmp_path / "m.json", first.model)
    second = analyse(LATER[cut:], read_model(tmp_path / "m.json"))
    assert [*first.events, *second.events] == whole.events
    assert second.model == whole.model


def test_learn_and_analyse_by_command(folder: Path) -> None:
    model, out = folder / "m.json", folder / "events.csv"
    said = run("learn", "--in", folder / "learn.csv", "--model", model, "--plot", folder / "model.png")
    assert "24 passes" in said
    assert "held out" in said
    kept = model.read_bytes()
    plot = folder / "events.png"
    run("analyse", "--in", folder / "later.csv", "--model", model, "--out", out, "--plot", plot)
    assert model.read_bytes() == kept, "left as it was without --update"
    rows = list(csv.DictReader(out.read_text("utf-8").splitlines()))
    sure = [row for row in rows if row["confirmed"] == "1"]
    assert {row["kind"] for row in sure} == {"below"}
    assert {row["pass_id"] for row in sure} >= {"P028", "P029", "P030", "P031"}
    assert all(float(row["section_start_m"]) < 2500.0 and float(row["section_end_m"]) > 1500.0 for row in sure)
    assert len({row["incident_id"] for row in sure}) == 1, "one fault is one line"
    assert sure[-1]["incident"].startswith("obstruction, 1 event: W1 ch1 ")
    assert plot.stat().st_size > 10_000
    assert (folder / "model.png").stat().st_size > 10_000
    first = out.read_bytes(), plot.read_bytes()
    run("analyse", "--in", folder / "later.csv", "--model", model, "--out", out, "--plot", plot)
    assert (out.read_bytes(), plot.read_bytes()) == first
    run("analyse", "--in", folder / "later.csv", "--model", model, "--out", out, "--update")
    assert model.read_bytes() != kept
    shown = run("show", "--model", model)
    assert "held out" in shown
    assert "open: obstruction, 1 event: W1 ch1 " in shown


def test_the_papers_method_by_command(folder: Path) -> None:
    model, out = folder / "m.json", folder / "events.csv"
    run("learn", "--in", folder / "learn.csv", "--model", model, "--method", "paper", "--plot", folder / "p.svg")
    said = json.loads(run("analyse", "--in", folder / "later.csv", "--model", model, "--out", out, "--json"))
    faulty = {one["pass_id"] for one in said["events"] if one["kind"] == "below"}
    assert {"P026", "P027", "P028", "P029", "P030", "P031"} <= faulty
    assert "<svg" in (folder / "p.svg").read_text("utf-8")


def test_a_new_normal_is_accepted_and_revoked_by_command(folder: Path) -> None:
    model, out = folder / "m.json", folder / "events.csv"
    run("learn", "--in", folder / "learn.csv", "--model", model)
    run("analyse", "--in", folder / "later.csv", "--model", model, "--out", out, "--update")
    words = ("--radio", "W1", "--from", "1500", "--to", "2500", "--since", "2026-01-18", "--by", "Sato")
    name = run("accept", "--model", model, *words).split()[-1]
    more = [one for number in range(32, 36) for one in one_pass(number, change_db=-10.0, stretch=(15, 25))]
    (folder / "more.csv").write_text(csv_of(more), "utf-8")

    def sure() -> list[str]:
        run("analyse", "--in", folder / "more.csv", "--model", model, "--out", out)
        rows = csv.DictReader(out.read_text("utf-8").splitlines())
        return [row["kind"] for row in rows if row["confirmed"] == "1"]

    assert sure() == []
    run("revoke", name, "--model", model, "--by", "Abe")
    assert set(sure()) == {"below"}
    log = run("acceptances", "--model", model)
    assert "Sato" in log
    assert "revoked" in log
    again = CliRunner().invoke(app, ["revoke", name, "--model", str(model), "--by", "Abe"])
    assert again.exit_code == 1


def test_usage_and_failures_have_their_exit_codes(folder: Path) -> None:
    runner = CliRunner()
    gone = runner.invoke(app, ["analyse", "--in", "x", "--model", "no.json", "--out", "y"])
    assert gone.exit_code == 1
    run("learn", "--in", folder / "learn.csv", "--model", folder / "m.json")
    words = ["--model", str(folder / "m.json"), "--radio", "W1", "--since", "2026-01-18", "--by", "Sato"]
    assert runner.invoke(app, ["accept", *words, "--from", "5", "--to", "5"]).exit_code == 2
    assert runner.invoke(app, ["accept", *words[:-3], "then", "--by", "A", "--from", "5", "--to", "9"]).exit_code == 1


def test_weather_rows_are_read_in_order_and_refused_by_line(tmp_path: Path) -> None:
    path = tmp_path / "weather.csv"
    path.write_text("time,axis_m,snow_mm_per_h\n2026-01-05T09:00:00Z,10,1\n2026-01-05T08:00:00Z,10,0\n", "utf-8")
    assert [one.snow_mm_per_h for one in read_weather(path)] == [0.0, 1.0]
    path.write_text("time,axis_m,snow_mm_per_h\n2026-01-05T09:00:00Z,10,-1\n", "utf-8")
    with pytest.raises(ValueError, match=r"weather\.csv:2: "):
        read_weather(path)


def test_the_model_encodes_the_same_bytes_again() -> None:
    first = learn(LEARNED, Settings(), "line", "", Counter())
    second = learn(list(reversed(LEARNED)), Settings(), "line", "", Counter())
    assert msgspec.json.encode(first) == msgspec.json.encode(second)
