"""`kirotei gnss` on recordings that were made up."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.gnss_correction.command import app
from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.rinex_navigation_file import write_navigation
from services.gnss_receiver.rinex_observation_file import write_observations
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, START_S, WEEK, constellation, measured

EPOCHS = 12


@dataclass(frozen=True)
class Recording:
    rover: Path
    nav: Path
    truth: Path
    line: Path


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("recording")
    rover, nav, truth, line = (folder / name for name in ("rover.obs", "brdc.nav", "truth.csv", "line.csv"))
    ephemerides = constellation()
    write_observations(rover, [measured(ephemerides, START_S + 0.2 * k) for k in range(EPOCHS)])
    write_navigation(nav, Navigation(tuple(ephemerides)))
    lat, lon, h = PLACE_DEG
    rows = [f"{WEEK},{START_S + t},{lat},{lon},{h}" for t in (-1.0, 0.0, 1.0, 2.0, 3.0)]
    truth.write_text("gps_week,tow_s,lat_deg,lon_deg,h_ell_m\n" + "\n".join(rows) + "\n")
    line.write_text(f"chainage_m,lat_deg,lon_deg,h_ell_m\n0,{lat - 0.001},{lon},{h}\n222,{lat + 0.001},{lon},{h}\n")
    return Recording(rover, nav, truth, line)


def run(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, result.stderr


def test_a_recording_becomes_fixes_verdicts_and_tables(recording: Recording, tmp_path: Path) -> None:
    outs = {}
    for method in ("original", "remove", "adjust"):
        outs[method] = tmp_path / f"{method}.csv"
        verdicts = tmp_path / f"{method}_verdicts.csv"
        code, told, progress = run(
            "solve", "--rover", recording.rover, "--nav", recording.nav, "--method", method,
            "--systems", "G,E", "--weights", "elevation", "--out", outs[method], "--verdicts", verdicts,
        )  # fmt: skip
        assert code == 0
        assert f"{EPOCHS} fixes for {EPOCHS} epochs" in told
        assert progress == "solving rover.obs: 100 %\n"
        rows = verdicts.read_text().splitlines()
        assert (len(rows) - 1) % EPOCHS == 0
        assert rows[-1].endswith(",0,clean")
    chosen = [part for path in outs.values() for part in ("--fixes", path)]
    code, told, _ = run(
        "evaluate", *chosen, "--truth", recording.truth, "--centreline", recording.line, "--plot", tmp_path / "map.svg"
    )
    assert code == 0
    assert "Table 1: distance to the line [m]\n                    original  remove  adjust\n" in told
    assert "with a fix [%]   100.000  100.000  100.000" in told
    assert (tmp_path / "map.svg").exists()
    code, told, _ = run("evaluate", *chosen, "--truth", recording.truth, "--json")
    figures = json.loads(told)
    assert [one["name"] for one in figures] == ["original", "remove", "adjust"]
    # RINEX keeps millimetres of pseudorange; geometry may double them.
    assert all(one["truth"]["maximum_m"] < 0.02 for one in figures)
    assert figures[0]["line"] is None


def test_the_summary_as_json(recording: Recording, tmp_path: Path) -> None:
    code, told, _ = run(
        "solve", "--rover", recording.rover, "--nav", recording.nav, "--out", tmp_path / "f.csv", "--json"
    )
    assert code == 0
    summary = json.loads(told)
    assert (summary["epochs"], summary["fixes"], summary["method"], summary["issues"]) == (EPOCHS, EPOCHS, "robust", [])


def test_settings_come_from_a_file(recording: Recording, tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text('[gnss_correction]\nmethod = "remove"\nelevation_mask_deg = 89.0\n')
    solve = (
        "solve",
        "--rover",
        recording.rover,
        "--nav",
        recording.nav,
        "--out",
        tmp_path / "f.csv",
        "--config",
        settings,
    )
    code, told, _ = run(*solve)
    assert code == 0
    assert f"0 fixes for {EPOCHS} epochs" in told
    assert "method remove" in told
    assert f"no fix: {EPOCHS} epochs, too few satellites" in told


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[gnss_correction]\nthreshold = 1.0\n", "gnss_correction.threshold: unknown field, did you mean threshold_m?"),
        ("[gnss_correction]\nthreshold_m = -1.0\n", "gnss_correction.threshold_m: expected float > 0, got -1.0"),
        ("gnss_correction = 3\n", "gnss_correction: expected a table [gnss_correction]"),
        ("[gnss_correction\n", "Expected ']'"),
    ],
)
def test_settings_that_are_wrong_are_named(recording: Recording, tmp_path: Path, text: str, told: str) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text(text)
    solve = (
        "solve",
        "--rover",
        recording.rover,
        "--nav",
        recording.nav,
        "--out",
        tmp_path / "f.csv",
        "--config",
        settings,
    )
    code, _, error = run(*solve)
    assert code == 2
    assert str(settings) in error
    assert told in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--systems", "X"), "--systems"),
        (("--method", "move"), "--method: expected one of adjust, line, original, remove, robust"),
        (("--weights", "none"), "--weights: expected one of cn0, elevation"),
    ],
)
def test_options_that_are_wrong_are_usage_errors(
    recording: Recording, tmp_path: Path, options: tuple[str, str], told: str
) -> None:
    code, _, error = run(
        "solve", "--rover", recording.rover, "--nav", recording.nav, "--out", tmp_path / "f.csv", *options
    )
    assert code == 2
    assert told in error
    assert list(tmp_path.iterdir()) == []


def test_without_navigation_it_asks_for_it(recording: Recording, tmp_path: Path) -> None:
    code, _, error = run("solve", "--rover", recording.rover, "--out", tmp_path / "f.csv")
    assert code == 2
    assert "--nav" in error


def test_fixes_and_verdicts_are_two_files(recording: Recording, tmp_path: Path) -> None:
    out = tmp_path / "f.csv"
    code, _, error = run("solve", "--rover", recording.rover, "--nav", recording.nav, "--out", out, "--verdicts", out)
    assert code == 2
    assert "cannot be one file" in error


def test_ephemerides_that_cover_nothing_are_said(recording: Recording, tmp_path: Path) -> None:
    old = tmp_path / "old.nav"
    ephemerides = [one for one in constellation() if one.satellite < "G05"]
    write_navigation(old, Navigation(tuple(ephemerides)))
    late = tmp_path / "late.obs"
    write_observations(late, [measured(constellation(), START_S + 7_200.0)])
    text = late.read_text("ascii")
    tomorrow = tmp_path / "tomorrow.obs"
    tomorrow.write_text(text.replace("2024 02 06", "2024 02 07").replace("  2024     2     6", "  2024     2     7"))
    code, _, error = run("solve", "--rover", tomorrow, "--nav", old, "--out", tmp_path / "f.csv")
    assert code == 1
    assert "cover no epoch of the recording, 2024-02-07" in error
    code, _, error = run(
        "solve", "--rover", recording.rover, "--nav", old, "--out", tmp_path / "f.csv", "--systems", "E"
    )
    assert code == 1
    assert "no ephemeris of the systems E" in error
    assert not (tmp_path / "f.csv").exists()


@pytest.mark.parametrize("option", ["--rover", "--nav", "--out"])
def test_files_that_are_not_there_are_said_in_one_line(recording: Recording, tmp_path: Path, option: str) -> None:
    paths = {"--rover": recording.rover, "--nav": recording.nav, "--out": tmp_path / "f.csv"}
    paths[option] = tmp_path / "nowhere" / "file"
    code, _, error = run("solve", *(part for pair in paths.items() for part in pair))
    assert code == 1
    assert "nowhere" in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_file_of_another_kind_is_said(recording: Recording, tmp_path: Path) -> None:
    code, _, error = run("solve", "--rover", recording.nav, "--nav", recording.nav, "--out", tmp_path / "f.csv")
    assert code == 1
    assert str(recording.nav) in error
    code, _, error = run("evaluate", "--fixes", recording.truth)
    assert code == 1
    assert f"{recording.truth}:1: no column status" in error
    code, _, error = run("evaluate", "--fixes", recording.truth, "--plot", tmp_path / "map.gif")
    assert code == 2
    assert "neither .png nor .svg" in error
