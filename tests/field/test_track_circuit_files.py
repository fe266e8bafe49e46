"""The recordings made for this project: bits and codes through the command line, as SigMF and as WAV."""

from __future__ import annotations

import csv
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from services.track_circuit.command import app

FOLDER = Path(os.environ.get("KIROTEI_FIELD_DATA", "/nonexistent")) / "track_circuit"
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="KIROTEI_FIELD_DATA names no folder with track_circuit")
SPREAD, CODED = "syn_sscdma_12k_N16", "syn_zpw2000_1701.4_16.9"


def demodulated(folder: Path, recording: Path, *more: str) -> tuple[list[dict[str, str]], list[dict[str, str]], str]:
    out, bits = folder / "t.csv", folder / "b.csv"
    result = CliRunner().invoke(
        app, ["demodulate", str(recording), "--out", str(out), "--bits", str(bits), "--json", *more]
    )
    assert result.exit_code == 0, result.stderr
    tables = []
    for path in (out, bits):
        with path.open(encoding="utf-8", newline="") as file:
            tables.append(list(csv.DictReader(file)))
    return tables[0], tables[1], result.stdout


def wrong_bits(rows: list[dict[str, str]]) -> tuple[int, int]:
    """How many bits differ from the truth, and of how many."""
    meta = json.loads((FOLDER / f"{SPREAD}.sigmf-meta").read_text("utf-8"))["global"]
    truth = np.array(list(meta["trackcircuit:truth"]["data_bits"])).astype(int)
    pairs = [(int(row["symbol"]), int(row["bit"])) for row in rows]
    return sum(truth[symbol] != bit for symbol, bit in pairs if symbol < len(truth)), len(pairs)


def test_every_bit_of_the_spread_spectrum_recording(tmp_path: Path) -> None:
    telegrams, bits, _ = demodulated(tmp_path, FOLDER / f"{SPREAD}.sigmf-meta")
    assert telegrams == []
    assert wrong_bits(bits) == (0, 3000)


def test_a_recording_that_starts_anywhere_gives_the_same_bits(tmp_path: Path) -> None:
    meta = json.loads((FOLDER / f"{SPREAD}.sigmf-meta").read_text("utf-8"))
    meta["global"].pop("core:sha512")
    content = (FOLDER / f"{SPREAD}.sigmf-data").read_bytes()
    (tmp_path / "cut.sigmf-meta").write_text(json.dumps(meta))
    (tmp_path / "cut.sigmf-data").write_bytes(content[2 * 77_777 :])
    _, bits, _ = demodulated(tmp_path, tmp_path / "cut.sigmf-meta")
    wrong, count = wrong_bits(bits)
    assert wrong == 0
    # 77,777 samples are 486.1 symbols.
    assert count >= 2510


def test_carrier_and_code_of_the_coded_recording(tmp_path: Path) -> None:
    rows, bits, told = demodulated(tmp_path, FOLDER / f"{CODED}.sigmf-meta")
    assert bits == []
    assert {(row["state"], row["carrier_hz"], row["code_hz"]) for row in rows} == {("good", "1701.40", "16.90")}
    result = json.loads(told)
    assert (result["carrier_hz"], result["code_hz"]) == (1701.4, 16.9)
    assert result["margin_db"] > 20.0


def test_wav_and_sigmf_say_the_same(tmp_path: Path) -> None:
    shutil.copy(FOLDER / f"{CODED}.wav", tmp_path / "one.wav")
    table = tmp_path / "circuits.toml"
    table.write_text('[[track_circuit.circuits]]\nname = "K1"\nprofile = {scheme = "fsk"}\n')
    rows, _, _ = demodulated(tmp_path, tmp_path / "one.wav", "--circuit", "K1", "--config", str(table))
    assert {(row["state"], row["carrier_hz"], row["code_hz"]) for row in rows} == {("good", "1701.40", "16.90")}
