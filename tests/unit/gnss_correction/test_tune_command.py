"""`kirotei gnss tune`, and thresholds and smoothing as options of `solve`, on a made-up recording."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from services.gnss_correction.command import app
from services.gnss_correction.thresholds_file import read_thresholds
from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.rinex_navigation_file import write_navigation
from services.gnss_receiver.rinex_observation_file import write_observations
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, START_S, constellation, measured

NOISE_M = 0.4
EPOCHS = 100
WAVELENGTH_M = 299_792_458.0 / 1_575.42e6


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with 20 s of a standing receiver at 5 Hz: white code noise, a perfect carrier, the line it stands on."""
    folder = tmp_path_factory.mktemp("recording")
    generator = np.random.default_rng(2)
    ephemerides = constellation()
    clean = [measured(ephemerides, START_S + 0.2 * k) for k in range(EPOCHS)]
    noisy = [
        msgspec.structs.replace(
            one,
            pseudorange_m=one.pseudorange_m + NOISE_M * generator.standard_normal(len(one.satellites)),
            carrier_phase_cycles=one.pseudorange_m / WAVELENGTH_M,
        )
        for one in clean
    ]
    write_observations(folder / "rover.obs", noisy)
    write_navigation(folder / "brdc.nav", Navigation(tuple(ephemerides)))
    lat, lon, h = PLACE_DEG
    line = f"chainage_m,lat_deg,lon_deg,h_ell_m\n0,{lat - 0.001},{lon},{h}\n222,{lat + 0.001},{lon},{h}\n"
    (folder / "line.csv").write_text(line)
    return folder


def run(command: str, folder: Path, *options: object) -> tuple[int, str, str]:
    files = ("--rover", folder / "rover.obs", "--nav", folder / "brdc.nav")
    result = CliRunner().invoke(app, [command, *(str(one) for one in (*files, *options))])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, result.stderr


def test_thresholds_are_tuned_swept_and_used(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "thresholds.toml"
    code, told, _ = run(
        "tune", recording, "--out", out, "--receiver", "roof", "--sweep", "--centreline", recording / "line.csv"
    )
    assert code == 0
    assert f"thresholds of roof from {EPOCHS} epochs" in told
    assert "distance to the line\nelevation   threshold  flagged  method" in told
    tuned = read_thresholds(out)
    assert (tuned.recording, tuned.epochs, tuned.interval_s) == ("rover.obs", EPOCHS, 0.2)
    flagged = {}
    for name, options in (("paper", ()), ("tuned", ("--thresholds", out))):
        code, told, _ = run("solve", recording, "--method", "remove", "--out", tmp_path / "f.csv", "--json", *options)
        assert code == 0
        flagged[name] = json.loads(told)["flagged_per_epoch"]
    # With 0.4 m of noise the paper's threshold flags half of a clean sky, the tuned one a hundredth of it.
    assert flagged["tuned"] < 0.1 * flagged["paper"]


def test_tuning_again_gives_the_same_bytes(recording: Path, tmp_path: Path) -> None:
    written = []
    for name in ("a.toml", "b.toml"):
        assert run("tune", recording, "--out", tmp_path / name)[0] == 0
        written.append((tmp_path / name).read_bytes())
    assert written[0] == written[1]


def test_smoothing_makes_fixes_quieter(recording: Path, tmp_path: Path) -> None:
    spread_m = {}
    for name, options in (("code", ()), ("smoothed", ("--smooth",))):
        out = tmp_path / f"{name}.csv"
        code, _, _ = run("solve", recording, "--method", "original", "--out", out, *options)
        assert code == 0
        rows = out.read_text().splitlines()
        column = rows[0].split(",").index("lat_deg")
        lat_deg = np.array([float(row.split(",")[column]) for row in rows[1 + EPOCHS // 2 :]])
        spread_m[name] = float(np.std(np.radians(lat_deg)) * 6.4e6)
    # After 50 epochs the mean of a hundred is far steadier than single ones.
    assert spread_m["smoothed"] < 0.3 * spread_m["code"]


@pytest.mark.parametrize(
    ("command", "options", "code", "said"),
    [
        ("tune", ("--sweep",), 2, "--sweep needs --truth or --centreline"),
        ("tune", ("--config", "{tmp}/none.toml"), 1, "none.toml: No such file or directory"),
        ("solve", ("--thresholds", "{tmp}/none.toml"), 1, "none.toml: No such file or directory"),
        ("solve", ("--thresholds", "{tmp}/bad.toml"), 1, "bad.toml: Object missing required field"),
    ],
)
def test_what_is_wrong_is_said(
    recording: Path, tmp_path: Path, command: str, options: tuple[str, ...], code: int, said: str
) -> None:
    (tmp_path / "bad.toml").write_text("version = 1\n")
    given = [option.format(tmp=tmp_path) for option in options]
    ended, _, told = run(command, recording, "--out", tmp_path / "out", *given)
    assert ended == code
    assert said in told
    assert not (tmp_path / "out").exists()


def test_a_recording_without_enough_clean_changes_is_refused(recording: Path, tmp_path: Path) -> None:
    short = tmp_path / "short"
    short.mkdir()
    (short / "brdc.nav").write_bytes((recording / "brdc.nav").read_bytes())
    write_observations(short / "rover.obs", [measured(constellation(), START_S + 0.2 * k) for k in range(10)])
    code, _, told = run("tune", short, "--out", tmp_path / "out.toml")
    assert code == 1
    assert "clean changes of" in told
    assert "200 needed" in told
    assert not (tmp_path / "out.toml").exists()
