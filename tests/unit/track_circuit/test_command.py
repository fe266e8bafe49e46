"""`kirotei track-circuit`: tables of simulated recordings, trained coefficients, and clear words for what is wrong."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner, Result

from services.simulator.track_circuit_scene import SimulatedCircuit
from services.simulator.track_circuit_settings import TrackCircuitSettings
from services.track_circuit.cdma_qam import modulate_cdma_qam
from services.track_circuit.command import app
from services.track_circuit.fsk import keyed
from services.track_circuit.profile import Framing, Profile
from services.track_circuit.telegram import telegram_bits

RATE_HZ = 48_000
PROFILE = Profile(framing=Framing())


def recorded(
    folder: Path, samples: NDArray[np.float64], profile: dict[str, Any] | None, rate_hz: int = RATE_HZ
) -> Path:
    path = folder / "run.sigmf-meta"
    (folder / "run.sigmf-data").write_bytes(np.rint(samples * 32767.0).astype("<i2").tobytes())
    whole = {"core:datatype": "ri16_le", "core:sample_rate": rate_hz, "trackcircuit:circuit_id": "T12"}
    whole |= {} if profile is None else {"trackcircuit:profile": profile}
    path.write_text(json.dumps({"global": whole, "captures": [{"core:sample_start": 0}], "annotations": []}))
    return path


def asked(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def simulated() -> NDArray[np.float64]:
    """Four seconds of telegrams of circuit 1 through a kilometre of rail."""
    circuit = SimulatedCircuit(TrackCircuitSettings())
    blocks = [circuit.step(0) for _ in range(40)]
    return np.concatenate([np.asarray(block.samples, np.float64) for block in blocks if block is not None])


def test_telegrams_and_bits_of_a_recording(tmp_path: Path, simulated: NDArray[np.float64]) -> None:
    path = recorded(tmp_path, simulated, msgspec.to_builtins(PROFILE))
    out, bits = tmp_path / "telegrams.csv", tmp_path / "bits.csv"
    result = asked("demodulate", path, "--out", out, "--bits", bits, "--json")
    assert result.exit_code == 0, result.stderr
    rows = rows_of(out)
    assert [row["state"] for row in rows[:2]] == ["unconfirmed", "good"]
    assert {(row["circuit"], row["payload_hex"], row["crc_ok"]) for row in rows} == {("T12", "a55a", "1")}
    sequences = [int(row["sequence"]) for row in rows]
    assert sequences == list(range(sequences[0], sequences[0] + len(rows)))
    times_s = np.array([float(row["t_s"]) for row in rows])
    # A telegram has 13 + 8 * 11 = 101 symbols of 1/300 s.
    np.testing.assert_allclose(np.diff(times_s), 101.0 / 300.0, atol=1e-3)
    told = json.loads(result.stdout)
    assert told["symbols"] == len(rows_of(bits))
    assert told["symbols"] > 1100
    assert list(rows_of(bits)[0]) == ["symbol", "bit", "soft"]


def test_a_picture_is_drawn_on_demand_and_other_endings_are_refused(
    tmp_path: Path, simulated: NDArray[np.float64]
) -> None:
    path = recorded(tmp_path, simulated, msgspec.to_builtins(PROFILE))
    out, plot = tmp_path / "telegrams.csv", tmp_path / "run.svg"
    result = asked("demodulate", path, "--out", out, "--plot", plot)
    assert result.exit_code == 0, result.stderr
    assert plot.read_bytes().startswith(b"<?xml")
    out.unlink()
    refused = asked("demodulate", path, "--out", out, "--plot", tmp_path / "run.pdf")
    assert (refused.exit_code, out.exists()) == (2, False)
    assert "neither .png nor .svg" in refused.stderr


def test_trained_coefficients_are_used_and_counted(tmp_path: Path, simulated: NDArray[np.float64]) -> None:
    path, store = recorded(tmp_path, simulated, msgspec.to_builtins(PROFILE)), tmp_path / "store.json"
    for version in (1, 2):
        result = asked("train", path, "--circuit", "T12", "--store", store, "--weather", "dry", "--json")
        assert result.exit_code == 0, result.stderr
        assert json.loads(result.stdout)["version"] == version
    kept = json.loads(store.read_text())["sets"]
    assert [(one["circuit"], one["weather"], one["version"]) for one in kept] == [("T12", "dry", 2)]
    used = asked("demodulate", path, "--circuit", "T12", "--store", store, "--out", tmp_path / "t.csv", "--json")
    assert json.loads(used.stdout)["stored_version"] == 2
    other = asked("demodulate", path, "--circuit", "T13", "--store", store, "--out", tmp_path / "t.csv", "--json")
    assert json.loads(other.stdout)["stored_version"] is None
    assert "no coefficients are stored for circuit T13" in other.stderr


def test_a_coded_recording_gives_carrier_and_code(tmp_path: Path) -> None:
    samples = 0.1 * keyed(2001.4, 21.3, 11.0, 8000.0, 24_000)
    path = recorded(tmp_path, samples, {"scheme": "fsk"}, 8000)
    table = tmp_path / "circuits.toml"
    table.write_text('[track_circuit.code_table]\ncodes = [{hz = 20.2}, {hz = 21.3, meaning = "slow"}]\n')
    result = asked("demodulate", path, "--out", tmp_path / "t.csv", "--config", table, "--json")
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)
    assert (told["carrier_hz"], told["code_hz"], told["meaning"]) == (2001.4, 21.3, "slow")
    row = rows_of(tmp_path / "t.csv")[0]
    assert (row["state"], row["payload_hex"], row["code_hz"], row["meaning"]) == ("good", "4e2e00d5", "21.30", "slow")


def test_wav_needs_a_circuit_with_a_profile(tmp_path: Path) -> None:
    path = tmp_path / "run.wav"
    samples = np.rint(3000.0 * keyed(2001.4, 21.3, 11.0, 8000.0, 24_000)).astype("<i2").tobytes()
    header = b"RIFF\0\0\0\0WAVEfmt \x10\0\0\0\1\0\1\0" + (8000).to_bytes(4, "little") + (16_000).to_bytes(4, "little")
    path.write_bytes(header + b"\2\0\x10\0data" + len(samples).to_bytes(4, "little") + samples)
    refused = asked("demodulate", path, "--out", tmp_path / "t.csv")
    assert refused.exit_code == 2
    assert "brings no profile" in refused.stderr
    table = tmp_path / "circuits.toml"
    table.write_text('[[track_circuit.circuits]]\nname = "K3"\nprofile = {scheme = "fsk"}\n')
    result = asked("demodulate", path, "--circuit", "K3", "--config", table, "--out", tmp_path / "t.csv")
    assert result.exit_code == 0, result.stderr
    assert "code 21.3 Hz" in result.stdout
    unknown = asked("demodulate", path, "--circuit", "K4", "--config", table, "--out", tmp_path / "t.csv")
    assert (unknown.exit_code, "there are: K3" in unknown.stderr) == (2, True)


@pytest.mark.parametrize("profile", [msgspec.to_builtins(PROFILE), {"scheme": "fsk"}])
def test_silence_is_failure_with_empty_tables(tmp_path: Path, profile: dict[str, Any]) -> None:
    path = recorded(tmp_path, np.zeros(3 * RATE_HZ), profile)
    result = asked("demodulate", path, "--out", tmp_path / "t.csv", "--bits", tmp_path / "b.csv")
    assert result.exit_code == 1
    assert "run.sigmf-meta: no " in result.stderr
    assert all(row["state"] == "no_signal" for row in rows_of(tmp_path / "t.csv"))
    assert rows_of(tmp_path / "b.csv") == []


def test_nothing_is_learned_from_silence(tmp_path: Path) -> None:
    path = recorded(tmp_path, np.zeros(RATE_HZ), msgspec.to_builtins(PROFILE))
    result = asked("train", path, "--circuit", "T12", "--store", tmp_path / "store.json")
    assert result.exit_code == 1
    assert not (tmp_path / "store.json").exists()


def test_what_cannot_be_meant_is_exit_2_and_what_fails_exit_1(tmp_path: Path) -> None:
    assert asked("demodulate", tmp_path / "none.sigmf-meta", "--out", tmp_path / "t.csv").exit_code == 1
    assert asked("demodulate", tmp_path / "none.sigmf-meta").exit_code == 2
    path = recorded(tmp_path, np.zeros(RATE_HZ), {"scheme": "morse"})
    result = asked("demodulate", path, "--out", tmp_path / "t.csv")
    assert (result.exit_code, "scheme" in result.stderr) == (1, True)
    path = recorded(tmp_path, np.zeros(RATE_HZ), msgspec.to_builtins(PROFILE))
    assert asked("demodulate", path, "--receiver", "best", "--out", tmp_path / "t.csv").exit_code == 2
    table = tmp_path / "circuits.toml"
    table.write_text("[track_circuit]\ncircuits = 3\n")
    refused = asked("demodulate", path, "--config", table, "--out", tmp_path / "t.csv")
    assert (refused.exit_code, "track_circuit.circuits" in refused.stderr) == (2, True)


def test_a_cut_recording_is_told_and_used(tmp_path: Path, simulated: NDArray[np.float64]) -> None:
    path = recorded(tmp_path, simulated, msgspec.to_builtins(PROFILE))
    content = (tmp_path / "run.sigmf-data").read_bytes()
    (tmp_path / "run.sigmf-data").write_bytes(content[: len(content) // 2 - 1])
    result = asked("demodulate", path, "--out", tmp_path / "t.csv")
    assert result.exit_code == 0
    assert "cut within a sample" in result.stderr
    assert len(rows_of(tmp_path / "t.csv")) >= 3


@pytest.mark.parametrize(
    ("spoil", "words"), [("clipped", "are clipped"), ("constant", "stands on the samples"), ("mute", "silence")]
)
def test_what_is_wrong_with_samples_is_told_and_lived_with(
    tmp_path: Path, simulated: NDArray[np.float64], spoil: str, words: str
) -> None:
    """Clipping at a third of the peaks; a constant six times the signal; a first piece without any."""
    samples = simulated / np.abs(simulated).max()
    if spoil == "clipped":
        samples = np.clip(3.0 * samples, -1.0, 1.0)
    elif spoil == "constant":
        samples = 0.1 * samples + 0.6
    else:
        samples = np.concatenate([np.zeros(31 * RATE_HZ), samples])
    path = recorded(tmp_path, samples, msgspec.to_builtins(PROFILE))
    result = asked("demodulate", path, "--out", tmp_path / "t.csv", "--json")
    assert result.exit_code == 0, result.stderr
    assert words in result.stderr
    assert json.loads(result.stdout)["states"]["good"] >= 9
    assert "bad_crc" not in json.loads(result.stdout)["states"]


def test_other_channels_and_gaps_in_a_recording(tmp_path: Path, simulated: NDArray[np.float64]) -> None:
    path = recorded(tmp_path, simulated, msgspec.to_builtins(PROFILE))
    meta = json.loads(path.read_text())
    half = len(simulated) // 2
    meta["captures"] = [{"core:sample_start": 0}, {"core:sample_start": half, "core:global_index": half + 90_000}]
    path.write_text(json.dumps(meta))
    result = asked("demodulate", path, "--out", tmp_path / "t.csv", "--bits", tmp_path / "b.csv")
    assert result.exit_code == 0, result.stderr
    assert "1 gaps" in result.stderr
    symbols = np.array([int(row["symbol"]) for row in rows_of(tmp_path / "b.csv")])
    # Numbers rise; where the pilot's own number differs from what time says, whole periods of 1023 stand between.
    assert (np.diff(symbols) >= 1).all()


@pytest.mark.parametrize("order", [16, 64])
def test_cdma_qam_gives_bits_and_telegrams_and_begins_with_what_was_trained(tmp_path: Path, order: int) -> None:
    profile = msgspec.structs.replace(
        Profile(scheme="cdma-qam", pulse="root-raised-cosine"), qam_order=order, qam_blocks=25, framing=Framing()
    )
    framing = Framing()
    told = np.concatenate([telegram_bits(7, number, b"\xa5\x5a", framing) for number in range(60)])
    bits = told[: len(told) // profile.bits_per_block * profile.bits_per_block]
    sent = 0.2 * modulate_cdma_qam(bits, profile, float(RATE_HZ))
    path = recorded(tmp_path, np.concatenate([np.zeros(2000), sent, np.zeros(2000)]), msgspec.to_builtins(profile))
    store = tmp_path / "s.json"
    trained = asked("train", path, "--circuit", "T12", "--store", store, "--weather", "wet", "--json")
    assert trained.exit_code == 0, trained.stderr
    assert (json.loads(trained.stdout)["receiver"], json.loads(trained.stdout)["taps"]) == ("dfe", 20)
    tables = ("--out", tmp_path / "t.csv", "--bits", tmp_path / "b.csv")
    arguments = ("--circuit", "T12", "--store", store, "--json", *tables)
    result = asked("demodulate", path, *arguments)
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["stored_version"] == 1
    found = [int(row["bit"]) for row in rows_of(tmp_path / "b.csv")]
    assert found[: len(bits)] == bits.tolist()
    whole = len(bits) // 101
    states = [row["state"] for row in rows_of(tmp_path / "t.csv")[:whole]]
    assert states == ["unconfirmed"] + ["good"] * (whole - 1)
    ffe = asked("demodulate", path, "--receiver", "least-squares", *arguments)
    assert "belong to receiver dfe" in ffe.stderr
    assert ffe.exit_code == 0


def test_coded_circuits_have_nothing_to_train(tmp_path: Path) -> None:
    path = recorded(tmp_path, np.zeros(RATE_HZ), {"scheme": "fsk"})
    refused = asked("train", path, "--circuit", "T12", "--store", tmp_path / "s.json")
    assert (refused.exit_code, "no equaliser" in refused.stderr) == (2, True)
