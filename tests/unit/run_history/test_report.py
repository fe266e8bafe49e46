"""Reports from simulated runs of a short stretch of the demo line: pages, tables, pseudonyms, the same bytes twice."""

from __future__ import annotations

import csv
import json
import re
import shutil
from collections import defaultdict
from datetime import UTC, datetime
from pathlib import Path

import duckdb
import pytest
from typer.testing import CliRunner

from services.line.line_file import load_line
from services.run_history import report_file
from services.run_history.command import app
from services.run_history.demo_vehicle import demo_vehicle
from services.run_history.pseudonym import pseudonym
from services.run_history.report_words import WORDS
from services.run_history.vehicle_file import read_vehicle

STOPS = [one.id for one in load_line(Path("demo")).line.stations[:2]]
SCENARIO = f"""
name = "short"
seed = 2
line = "demo"
[journey]
stops = {json.dumps(STOPS)}
[driving]
dwell_s = [25.0, 30.0]
[adhesion]
"""
RUNS = 4


def kirotei(*arguments: object, fails: bool = False) -> str:
    result = CliRunner().invoke(app, [str(one) for one in arguments])
    assert (result.exit_code != 0) == fails, result.output
    return result.output


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of `runs demo`."""
    folder = tmp_path_factory.mktemp("report")
    scenario = folder / "short.toml"
    scenario.write_text(SCENARIO, "utf-8")
    said = kirotei("demo", "--out", folder / "demo", "--runs", RUNS, "--scenario", scenario)
    assert f"{RUNS} runs, {RUNS} legs, {RUNS} counted" in said
    return folder / "demo"


def report(made: Path, out: Path, *more: object) -> str:
    """Report of the same log under the same salt."""
    shutil.copy(made / "report.salt", out.with_name(f"{out.stem}.salt"))
    log = made / "runs_log.csv"
    return kirotei("report", "--log", log, "--line", "demo", "--vehicle", made / "vehicle.toml", "--out", out, *more)


def test_one_command_makes_the_whole_report_of_simulated_runs(made: Path) -> None:
    page = (made / "report.html").read_text("utf-8")
    for key in ("margin_title", "energy_title", "diagram", "reception", "estimate", "upper_limit", "optimum", "advice"):
        assert WORDS[key][0] in page, key
    stations = load_line(Path("demo")).line.stations
    assert f"{stations[0].name} → {stations[1].name}" in page
    # Speeds and distributions there and back, diagram, reception, and a sheet for each leg.
    assert page.count("<svg") >= 2 * 2 + 2 + RUNS
    assert "<text" in page  # not drawn as outlines: text can be selected
    assert not re.search(r'(?:src|href)="(?!#)', page)  # nothing from outside
    identities = re.findall(r'\bid="([^"]+)"', page)
    used = set(re.findall(r"url\(#([^)]+)\)", page)) | set(re.findall(r'href="#([^"]+)"', page))
    assert used <= set(identities)


def test_runs_are_pseudonyms_without_dates_unless_names_are_asked_for(made: Path, tmp_path: Path) -> None:
    page = (made / "report.html").read_text("utf-8")
    tables = (made / "report.runs.csv").read_text("utf-8")
    salt = bytes.fromhex((made / "report.salt").read_text("ascii"))
    assert "demo-001" not in page + tables
    assert "2026-" not in page
    assert pseudonym("demo-001", salt) in page + tables
    assert (made / "report.salt").stat().st_mode & 0o077 == 0
    report(made, tmp_path / "r.html", "--names")
    assert "demo-001" in (tmp_path / "r.html").read_text("utf-8")


def test_the_same_log_and_salt_give_the_same_bytes(made: Path, tmp_path: Path) -> None:
    report(made, tmp_path / "report.html", "--processes", "2")
    for name in ("report.html", "report.margins.csv", "report.runs.csv", "report.reception.csv"):
        assert (tmp_path / name).read_bytes() == (made / name).read_bytes(), name


def test_pdf_text_is_text_and_the_same_bytes_again(made: Path, tmp_path: Path) -> None:
    for name in ("r.pdf", "again.pdf"):
        report(made, tmp_path / name, "--sheets", "0")
    content = (tmp_path / "r.pdf").read_bytes()
    assert content == (tmp_path / "again.pdf").read_bytes()
    assert content.startswith(b"%PDF-")
    assert b"/ToUnicode" in content
    assert b"/Type3" not in content


def test_without_a_japanese_font_the_pdf_is_in_english_and_says_so(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Stands for a host without such fonts: none of the names is found there.
    monkeypatch.setattr(report_file, "CJK_FONTS", ())
    monkeypatch.setattr(report_file, "CJK_FILES", ("no such font",))
    said = report(made, tmp_path / "r.pdf", "--lang", "ja", "--sheets", "0")
    assert report_file.NO_FONT in said
    report(made, tmp_path / "r.html", "--lang", "ja", "--sheets", "0")
    page = (tmp_path / "r.html").read_text("utf-8")  # a browser has fonts of its own
    assert WORDS["margin_title"][1] in page
    assert '<html lang="ja">' in page


def test_tables_are_the_same_as_csv_and_parquet(made: Path) -> None:
    for name in ("margins", "runs", "reception"):
        with (made / f"report.{name}.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        with duckdb.connect() as connection:
            connection.execute("SET threads=1")
            found = connection.execute("SELECT * FROM read_parquet(?)", [str(made / f"report.{name}.parquet")])
            assert [column[0] for column in found.description] == list(rows[0])
            assert len(found.fetchall()) == len(rows)
    with (made / "report.runs.csv").open(encoding="utf-8", newline="") as file:
        assert all(float(row["regenerated_kwh"]) > 0.0 < float(row["auxiliaries_kwh"]) for row in csv.DictReader(file))
    with (made / "report.margins.csv").open(encoding="utf-8", newline="") as file:
        assert {row["small_sample"] for row in csv.DictReader(file)} == {"True"}


def test_a_table_of_runs_alone_gives_statistics_without_speeds(made: Path, tmp_path: Path) -> None:
    log, vehicle, runs = made / "runs_log.csv", made / "vehicle.toml", tmp_path / "runs.csv"
    kirotei("analyse", "--log", log, "--line", "demo", "--vehicle", vehicle, "--out", runs)
    said = kirotei("report", "--runs", runs, "--out", tmp_path / "r.html", "--json")
    assert json.loads(said)["counted"] == RUNS
    page = (tmp_path / "r.html").read_text("utf-8")
    assert WORDS["margin_title"][0] in page
    assert WORDS["diagram"][0] not in page
    both = report(made, tmp_path / "b.html", "--runs", runs)
    assert f"{RUNS} counted" in both
    assert WORDS["optimum"][0] in (tmp_path / "b.html").read_text("utf-8")


def gpx_folder(made: Path, folder: Path) -> Path:
    """The same log as GPX 1.1 files, one a run, with the speed as the only extension."""
    points: dict[str, list[str]] = defaultdict(list)
    with (made / "runs_log.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            at = datetime.fromtimestamp(float(row["t_unix_s"]), UTC).isoformat().replace("+00:00", "Z")
            points[row["run_id"]].append(
                f'<trkpt lat="{row["lat_deg"]}" lon="{row["lon_deg"]}"><time>{at}</time>'
                f"<extensions><speed>{row['speed_mps']}</speed></extensions></trkpt>"
            )
    folder.mkdir()
    for run, lines in points.items():
        text = "\n".join(lines)
        (folder / f"{run}.gpx").write_text(
            f'<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>{text}</trkseg></trk></gpx>',
            "utf-8",
        )
    return folder


def test_one_command_makes_the_report_of_a_folder_of_gpx_files(made: Path, tmp_path: Path) -> None:
    folder = gpx_folder(made, tmp_path / "gpx")
    away = (folder / "demo-001.gpx").read_text("utf-8").replace('lat="', 'lat="1')
    (folder / "away.gpx").write_text(away, "utf-8")
    (folder / "empty.gpx").write_text("", "utf-8")
    (folder / "pointless.gpx").write_text("<gpx><trk></trk></gpx>", "utf-8")
    out = tmp_path / "r.html"
    asked = ("--line", "demo", "--vehicle", "demo", "--out", out, "--sheets", "1", "--lang", "ja")
    said = kirotei("report", "--log", folder, *asked)
    assert f"{RUNS} runs, {RUNS} legs" in said
    for name in ("empty.gpx", "pointless.gpx"):
        assert f"{folder / name}: this file was left out" in said
    assert "the line of another railway?" in said or "too few" in said
    page = out.read_text("utf-8")
    assert WORDS["diagram"][1] in page
    assert "このファイルは除外" in page
    assert "empty" not in page  # files are often called by people
    only = kirotei("report", "--log", folder / "empty.gpx", *asked, fails=True)
    assert f"{folder / 'empty.gpx'}:1" in only


def test_places_that_leave_the_monitor_record_are_said(made: Path, tmp_path: Path) -> None:
    monitor = tmp_path / "monitor.csv"
    lines = (made / "runs_log.csv").read_text("utf-8").splitlines()
    told = [lines[0]]
    first_s: dict[str, float] = {}
    for line in lines[1:]:
        t, lat, lon, speed, run = line.split(",")
        zero_s = first_s.setdefault(run, float(t))
        told.append(f"{zero_s + (float(t) - zero_s) / 1.15:.3f},{lat},{lon},{float(speed) * 1.15:.2f},{run}")
    monitor.write_text("\n".join(told), "utf-8")
    report(made, tmp_path / "r.html", "--reference", monitor, "--sheets", "0")
    assert "leave the reference by over 5 km/h" in (tmp_path / "r.html").read_text("utf-8")
    report(made, tmp_path / "s.html", "--reference", made / "runs_log.csv", "--sheets", "0")
    assert "leave the reference" not in (tmp_path / "s.html").read_text("utf-8")


def test_hours_without_runs_are_said_and_give_a_report_all_the_same(made: Path, tmp_path: Path) -> None:
    said = report(made, tmp_path / "r.html", "--from-hour", "2", "--until-hour", "3")
    assert "no run counts" in said
    assert WORDS["none_counts"][0] in (tmp_path / "r.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--out", "r.html"), "give --runs"),
        (("--out", "r.doc", "--runs", "runs.csv"), "wanted is .html or .pdf"),
        (("--out", "r.html", "--log", "x.csv"), "go together"),
        (("--out", "r.html", "--runs", "runs.csv", "--reference", "x.csv"), "compared with --log"),
        (("--out", "r.html", "--runs", "runs.csv", "--zone", "Mars/Base"), "Mars/Base"),
        (("--out", "r.html", "--runs", "runs.csv"), "runs.csv"),
    ],
)
def test_what_does_not_go_together_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert words in kirotei("report", *arguments, fails=True)
    assert not (tmp_path / "r.html").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("running_time_s", "running"), "without the columns running_time_s"),
        (("Z,", ","), "without its time zone"),
        ((",down,", ",sideways,"), "direction"),
        (("2026-", "year "), "departure"),
    ],
)
def test_a_broken_table_names_its_line_and_column(
    made: Path, tmp_path: Path, change: tuple[str, str], words: str
) -> None:
    runs = tmp_path / "runs.csv"
    kirotei(
        "analyse", "--log", made / "runs_log.csv", "--line", "demo", "--vehicle", made / "vehicle.toml", "--out", runs
    )
    runs.write_text(runs.read_text("utf-8").replace(*change), "utf-8")
    said = kirotei("report", "--runs", runs, "--out", tmp_path / "r.html", fails=True)
    assert words in said
    assert f"{runs}:" in said


def test_the_demo_vehicle_is_the_one_in_the_file(made: Path) -> None:
    assert read_vehicle(made / "vehicle.toml") == demo_vehicle()
    assert "mass_t" in demo_vehicle().assumed()
