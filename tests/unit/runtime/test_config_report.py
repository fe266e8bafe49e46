"""What `kirotei config check` and `show` say."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.cli import app
from services.runtime.config_report import checked

PLACE = '[place]\nline = "demo"\nkind = "train"\nname = "T1"\n'


def profile(folder: Path, text: str) -> Path:
    path = folder / "host.toml"
    path.write_text(text, "utf-8")
    return path


@pytest.fixture(autouse=True)
def _state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Keep the user's own state folder and environment out of it."""
    monkeypatch.setenv("KIROTEI_STATE_DIR", str(tmp_path / "state"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")


def test_a_valid_profile_lists_what_is_not_at_its_default(tmp_path: Path) -> None:
    path = profile(tmp_path, f'services = ["simulator"]\n{PLACE}[simulator]\ndevice = "rear"\nspeed = 1.0\n')
    report = checked(path, {"KIROTEI__SIMULATOR__SEED": "7"})
    assert report.problems == []
    assert ("simulator.device", '"rear"', '"front"') in report.values
    assert ("simulator.seed", "7", "null") in report.values
    assert not [value for value in report.values if value[0] == "simulator.speed"]


def test_a_table_of_a_service_that_is_not_started_is_noted(tmp_path: Path) -> None:
    report = checked(profile(tmp_path, f"{PLACE}[simulator]\n"), {})
    assert report.notes == ["[simulator] is set but not in `services`: `kirotei up` does not start it"]


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        (PLACE, 0, "host.toml: valid"),
        (f"{PLACE}[simulator]\nspeed = 0\n", 1, "host.toml: simulator.speed: expected float > 0 and <= 100, got 0"),
        ("services = 3\n", 1, "host.toml: place: missing: expected table"),
        ("services = \n", 1, "host.toml:1: Invalid value (column 12)"),
    ],
)
def test_check_ends_with_its_verdict(tmp_path: Path, text: str, code: int, words: str) -> None:
    path = profile(tmp_path, text)
    result = CliRunner().invoke(app, ["config", "check", str(path)])
    assert result.exit_code == code
    assert words in result.output
    result = CliRunner().invoke(app, ["config", "check", "--json", str(path)])
    assert result.exit_code == code
    assert json.loads(result.output)["valid"] is (code == 0)


def test_a_file_that_is_not_there_is_wrong_usage(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["config", "check", str(tmp_path / "absent.toml")])
    assert result.exit_code == 2
    assert "absent.toml: no such file" in result.output


def test_show_explains_a_services_settings() -> None:
    result = CliRunner().invoke(app, ["config", "show", "simulator"])
    assert result.exit_code == 0
    assert "| `speed` | float | > 0 and <= 100 | `1.0` | Simulated seconds per second." in result.output
    rows = json.loads(CliRunner().invoke(app, ["config", "show", "host", "--json"]).output)
    assert "place.line" in [row["name"] for row in rows]
    result = CliRunner().invoke(app, ["config", "show", "simulater"])
    assert result.exit_code == 2
    assert "did you mean simulator?" in result.output
