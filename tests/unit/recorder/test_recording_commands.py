"""What a person types, and is told."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from services.cli import app
from services.recorder.contents_words import utc
from services.recorder.file_names import is_own, recording_stem
from services.recorder.key_choice import fault_of
from services.recorder.mcap_file import RecordingWriter
from services.recorder.offline_replay_command import parts_of, place_of
from services.recorder.part_file import PartFile
from services.runtime.node import Sample
from tests.unit.recorder.samples import START_NS, TRAIN, truth_sample


def kirotei(*words: str | Path) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


def record(path: Path, samples: list[Sample]) -> Path:
    part = PartFile(path)
    writer = RecordingWriter(part)
    for sample in samples:
        writer.write(sample)
    writer.finish()
    part.complete()
    return path


@pytest.fixture(autouse=True)
def _environment_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take back what a command tells the libraries that it loads."""
    for name in ("KIROTEI_STATE_DIR", "NUMBA_CACHE_DIR"):
        monkeypatch.setenv(name, os.environ.get(name, ""))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A recording of ten seconds with a gap."""
    return record(tmp_path / "run.mcap", [truth_sample(index) for index in range(50) if index not in (20, 21)])


def test_info_shows_keys_rates_gaps_and_senders(run: Path) -> None:
    told = kirotei("recording", "info", run)
    assert told.exit_code == 0
    assert f"complete, {run.stat().st_size / 1000:.1f} kB, 48 messages" in told.stdout
    assert "2026-03-01 10:00:00.000 to 2026-03-01 10:00:09.800 UTC, 9.8 s" in told.stdout
    row = next(line for line in told.stdout.splitlines() if line.endswith("/truth/front"))
    assert row.split() == ["48", "4.80", "Hz", "2", "0.6", "s", "kirotei/v1/demo/train/T1/truth/front"]
    assert "senders: demo/train/T1/simulator" in told.stdout


def test_info_as_json_holds_everything(run: Path) -> None:
    found = json.loads(kirotei("recording", "info", run, "--json").stdout)
    assert (found["complete"], found["messages"], found["faults"]) == (True, 48, [])
    (key,) = found["keys"]
    assert (key["topic"], key["missing"], key["sources"]) == ("truth", 2, ["demo/train/T1/simulator"])


def test_info_of_a_broken_file_shows_what_is_there_and_says_what_is_wrong(run: Path) -> None:
    run.write_bytes(run.read_bytes()[:-10])
    told = kirotei("recording", "info", run)
    assert told.exit_code == 1
    assert "unfinished" in told.stdout
    assert "ends in the middle of a record" in told.stderr
    assert f"`kirotei recording repair {run}`" in told.stderr


def test_info_of_garbage_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("no recording\n")
    told = kirotei("recording", "info", path)
    assert told.exit_code == 1
    assert f"{path}: byte 0: not an MCAP recording" in told.stderr


def test_repair_completes_a_cut_file(run: Path) -> None:
    part = run.with_name("cut.mcap.part")
    part.write_bytes(run.read_bytes()[:-10])
    told = kirotei("recording", "repair", part)
    assert (told.exit_code, told.stderr) == (0, "")
    assert f"{run.with_name('cut.mcap')}: 48 messages saved" in told.stdout
    assert kirotei("recording", "info", run.with_name("cut.mcap")).exit_code == 0
    again = kirotei("recording", "repair", run.with_name("cut.mcap"), "--json")
    assert json.loads(again.stdout)["outcome"] == "complete"


def test_repair_of_garbage_fails_and_leaves_it(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"no recording")
    told = kirotei("recording", "repair", path)
    assert told.exit_code == 1
    assert "nothing can be saved" in told.stdout
    assert path.read_bytes() == b"no recording"


def test_recording_never_overwrites(run: Path) -> None:
    told = kirotei("record", run)
    assert (told.exit_code, "a recording is never overwritten" in told.stderr) == (2, True)
    shutil.copy(run, run.with_name("other.mcap.part"))
    told = kirotei("record", run.with_name("other.mcap"))
    assert (told.exit_code, "another recording is running" in told.stderr) == (2, True)
    told = kirotei("record", run.parent / "nowhere" / "a.mcap")
    assert (told.exit_code, "there is no folder" in told.stderr) == (2, True)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "give either --live or --through"),
        (["--live", "--through", "gnss_correction"], "give either --live or --through"),
        (["--live", "--out", "x.mcap"], "go with --through"),
        (["--live", "--key", "a//b"], "--key a//b: has an empty chunk"),
        (["--through", "gnss_correction"], "--through needs --out"),
        (["--through", "gnss_correction", "--out", "x.mcap", "--speed", "2"], "go with --live"),
        (["--through", "gnss_corection", "--out", "x.mcap"], "did you mean gnss_correction?"),
        (["--through", "gnss_correction", "--out", "x.mcap", "--place", "T1"], "'T1' is no place"),
        (["--through", "gnss_correction", "--out", "/nowhere/x.mcap"], "there is no folder /nowhere"),
    ],
)
def test_replay_says_what_does_not_go_together(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = kirotei("replay", run, *words)
    assert result.exit_code == 2
    assert told in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_replay_into_itself_and_of_nothing_is_refused(run: Path) -> None:
    assert "is the recording itself" in kirotei("replay", run, "--through", "gnss_correction", "--out", run).stderr
    assert "no such file" in kirotei("replay", run.with_name("no.mcap"), "--live").stderr


def test_a_failed_replay_leaves_nothing_half_written(run: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    out = run.with_name("out.mcap")
    profile = tmp_path_factory.mktemp("profile") / "host.toml"
    profile.write_text(
        'services = ["gnss_receiver"]\n[place]\nline = "demo"\nkind = "train"\nname = "T1"\n'
        '[gnss_receiver]\nobservations = "rover.obs"\n'
    )
    for words, told in (
        (["gnss_correction"], "nothing in it is read by"),
        (["gnss_receiver", "--config", profile], "gnss_receiver reads no topic"),
    ):
        result = kirotei("replay", run, "--out", out, "--through", *words)
        assert (result.exit_code, told in result.stderr) == (1, True), result.stderr
    run.write_bytes(run.read_bytes()[:-10])
    result = kirotei("replay", run, "--through", "gnss_correction", "--out", out)
    assert (result.exit_code, "unfinished recording" in result.stderr) == (1, True)
    assert list(run.parent.iterdir()) == [run]


def test_a_service_that_needs_settings_says_so(run: Path) -> None:
    result = kirotei("replay", run, "--through", "gnss_receiver", "--out", run.with_name("out.mcap"))
    assert result.exit_code == 1
    assert "gnss_receiver does not run on its defaults" in result.stderr


def test_settings_come_from_a_profile(tmp_path: Path) -> None:
    profile = tmp_path / "host.toml"
    profile.write_text(
        '[place]\nline = "demo"\nkind = "train"\nname = "T1"\n'
        '[gnss_correction]\nmethod = "remove"\n["gnss_correction@rear"]\nmethod = "original"\n'
    )
    parts = parts_of("gnss_correction, gnss_correction@rear", profile)
    assert [(part.instance, part.config.method) for part in parts] == [  # type: ignore[attr-defined]  # the service's own settings
        ("gnss_correction", "remove"),
        ("gnss_correction@rear", "original"),
    ]


def test_live_replay_of_unknown_keys_has_no_place(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", [Sample("somebody/else", b"", b"", START_NS)])
    told = kirotei("replay", path, "--live")
    assert told.exit_code == 1
    assert f"{path}: the recording holds no message of a known topic" in told.stderr


@pytest.mark.parametrize(
    ("expression", "fault"),
    [
        ("kirotei/v1/**", None),
        ("**", None),
        ("*/**/fix", None),
        ("", "has an empty chunk"),
        ("a/", "has an empty chunk"),
        ("a/**/**", "has **/**: write ** once"),
        ("a/**/*", "has **/*: write */**"),
        ("a/b$*", "has 'b$*': a wildcard is a whole chunk, * or **"),
        ("a/***", "has '***': a wildcard is a whole chunk, * or **"),
    ],
)
def test_key_expressions_are_checked_as_zenoh_would(expression: str, fault: str | None) -> None:
    assert fault_of(expression) == fault


def test_words() -> None:
    assert place_of("demo/train/T1") == TRAIN
    assert utc(START_NS) == "2026-03-01 10:00:00.000"
    assert is_own(f"{recording_stem(2**64 - 1, 12_345)}.mcap")
