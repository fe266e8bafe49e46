"""Radio passes as files, scenarios of them, and the commands that write and disturb."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from schemas.radio import RadioMeasurement
from services.radio_probe.report_fields import FieldReader
from services.simulator.command import fault, simulate
from services.simulator.fault_board import FaultBoard
from services.simulator.radio_passes import radio_pass, world_of
from services.simulator.radio_passes_file import write_radio_passes
from services.simulator.radio_scenario import RadioScenario, radio_scenario_from_toml
from services.simulator.scenario import ScenarioError
from services.simulator.scenario_file import embedded_scenarios, radio_line_for, read_any_scenario, read_scenario
from services.simulator.train_scenario import train_scenario_from_toml
from services.simulator.train_simulation_file import write_train_simulation

SMALL = """
name = "small"
[straight]
sites = 2
[radio]
period_s = 4.0
[passes]
days = 2
[[faults]]
kind = "radio_dead"
radio = "R02"
from_day = 1.0
"""
APP = typer.Typer()
APP.command()(simulate)
APP.command()(fault)


def run(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(APP, words)
    return result.exit_code, result.output


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_passes_are_written_as_they_are(tmp_path: Path) -> None:
    scenario = radio_scenario_from_toml(SMALL)
    written = write_radio_passes(scenario, tmp_path / "a")
    rows = table(tmp_path / "a" / "passes.csv")
    assert (written.passes, written.rows, written.files) == (4, len(rows), ("passes.csv", "weather.csv"))
    line, chainage = radio_line_for(scenario)
    taken = radio_pass(scenario, world_of(scenario, line), 0, chainage)
    first = [row for row in rows if row["pass_id"] == taken.pass_id]
    assert [float(row["power_dbm"]) for row in first] == pytest.approx(
        taken.measured["channel_power_dbm"].tolist(), abs=0.0051
    )
    assert first[0]["time"] == "2026-01-05T06:00:04.000Z"
    assert {row["direction"] for row in rows} == {"up", "down"}
    dead = [row for row in rows if row["radio"] == "R02" and row["time"] >= "2026-01-06"]
    assert dead
    assert all(row["decoded_power_dbm"] == "" and float(row["received_ratio"]) == 0.0 for row in dead)
    assert len(table(tmp_path / "a" / "weather.csv")) == 4
    write_radio_passes(scenario, tmp_path / "b")
    assert (tmp_path / "a" / "passes.csv").read_bytes() == (tmp_path / "b" / "passes.csv").read_bytes()
    write_radio_passes(scenario, tmp_path / "b", seed=9)
    assert (tmp_path / "a" / "passes.csv").read_bytes() != (tmp_path / "b" / "passes.csv").read_bytes()


def test_the_radio_probe_understands_every_column(tmp_path: Path) -> None:
    write_radio_passes(radio_scenario_from_toml(SMALL), tmp_path)
    reader = FieldReader(RadioMeasurement, {})
    row = {name: cell for name, cell in table(tmp_path / "passes.csv")[0].items() if cell}
    one = reader.read(row)
    assert reader.unknown == {}
    assert (one.radio, one.direction, one.channel_power_dbm) == ("R01", "up", float(row["power_dbm"]))


def test_a_train_s_run_is_a_pass(tmp_path: Path) -> None:
    scenario = train_scenario_from_toml('name = "x"\nline = "demo"\n[radio]\n')
    written = write_train_simulation(scenario, tmp_path, duration_s=40.0)
    assert "passes.csv" in written.files
    rows = table(tmp_path / "passes.csv")
    assert {row["radio"] for row in rows} == {"R01"}
    assert len(rows) == 80
    assert len({row["pass_id"] for row in rows}) == 1
    assert float(rows[-1]["chainage_m"]) > float(rows[0]["chainage_m"]) > 4200.0


def test_the_scenarios_of_passes() -> None:
    names = {name for name in embedded_scenarios() if isinstance(read_any_scenario(name), RadioScenario)}
    assert names == {"radio_table2", "radio_passes", "radio_faults", "radio_lapse"}
    for name in names:
        scenario = read_any_scenario(name)
        assert isinstance(scenario, RadioScenario)
        assert len(radio_line_for(scenario)[0].sites) in (5, 13)
    with pytest.raises(ScenarioError, match="radio passes"):
        read_scenario("radio_table2")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name = "x"\n[passes]\n', "give either `line` or a"),
        (SMALL + 'colour = "red"\n', "unknown field `colour` - at `$.faults"),
        (SMALL.replace("days = 2", "days = 2\nstart = 2026-01-05T00:00:00"), "needs a zone"),
        (SMALL.replace("days = 2", "days = 2\nfrom_axis_m = 9.0\nto_axis_m = 8.0"), "is no stretch"),
        (SMALL.replace("radio_dead", "slide"), "Invalid enum value 'slide'"),
        (SMALL.replace("period_s = 4.0", "noise_figure_db = inf"), "noise_figure_db"),
    ],
)
def test_what_is_wrong_in_a_scenario_is_named(text: str, words: str) -> None:
    with pytest.raises(ScenarioError) as error:
        radio_scenario_from_toml(text)
    assert words in str(error.value)


def test_faults_of_a_train_s_scenario_have_their_place() -> None:
    text = 'kind = "radio_obstruction"\nat_s = 2.0\nseconds = 3.0\nstart_axis_m = 900.0\nradio = "R01"\n'
    scenario = train_scenario_from_toml(f'name = "x"\nline = "demo"\n[radio]\n[[faults]]\n{text}')
    board = FaultBoard(scenario.faults)
    for now_s, since_s in ((1.0, []), (2.5, [2.0]), (5.0, [])):
        board.at(now_s)
        assert [one.since_s for one in board.radio()] == since_s
    board = FaultBoard(scenario.faults)
    board.at(3.0)
    (one,) = board.radio()
    assert (one.kind, one.magnitude, one.where.start_axis_m, one.where.radio) == (
        "radio_obstruction",
        15.0,
        900.0,
        "R01",
    )
    with pytest.raises(ScenarioError, match="no radios"):
        train_scenario_from_toml('name = "x"\n[track]\n[radio]\n')


def test_the_command_writes_passes(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(SMALL, "utf-8")
    code, text = run("simulate", str(path), "--out", str(tmp_path / "out"), "--json")
    assert code == 0
    assert json.loads(text)["files"] == ["passes.csv", "weather.csv"]
    code, text = run("simulate", str(path), "--out", str(tmp_path / "out"))
    assert "4 passes" in text
    lost = tmp_path / "lost.toml"
    lost.write_text(
        SMALL.replace("[straight]\nsites = 2", "").replace('"small"', '"small"\nline = "nowhere.json"'), "utf-8"
    )
    code, text = run("simulate", str(lost), "--out", str(tmp_path / "out"))
    assert code == 2
    assert "nowhere.json" in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fault", "slide", "--at", "4000"), "go with the faults of radios"),
        (("fault", "radio_obstruction", "--at", "4000:3000"), "give a place or a stretch"),
        (("fault", "radio_obstruction", "--at", "there"), "give a place or a stretch"),
    ],
)
def test_what_cannot_be_meant_is_refused(words: tuple[str, ...], said: str) -> None:
    code, text = run(*words)
    assert code == 2
    assert said in text.replace("\n", " ")
