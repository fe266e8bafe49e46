"""Waveforms before and behind the equaliser, and the pictures made of a recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from services.simulator.track_circuit_scene import SimulatedCircuit
from services.simulator.track_circuit_settings import TrackCircuitSettings
from services.track_circuit.cdma_qam import modulate_cdma_qam
from services.track_circuit.circuit_reception import Received, receive_recording
from services.track_circuit.circuit_samples import Recording, Stretch
from services.track_circuit.fsk import keyed
from services.track_circuit.modulate import antipodal, chips, modulate
from services.track_circuit.profile import Framing, Profile
from services.track_circuit.rail import Rail
from services.track_circuit.receiver_demodulation import demodulate
from services.track_circuit.reception_plot import draw_reception, save_picture
from services.track_circuit.telegram import telegram_bits
from services.track_circuit.traction_noise import TractionSettings
from services.track_circuit.waveform import SHOWN_SYMBOLS, TRAINED_SYMBOLS, one_tap, waveform

RATE_HZ = 48_000.0


def recording_of(samples: np.typing.NDArray[np.float64]) -> Recording:
    stretch = Stretch(begin=0, end=len(samples), first_sample=0, t_ns=0)
    return Recording("/somewhere/run.sigmf-meta", RATE_HZ, samples, 1.0, (stretch,))


@pytest.fixture(scope="module")
def simulated() -> Recording:
    """Two seconds of telegrams through narrow tuned units, with little noise."""
    circuit = SimulatedCircuit(
        TrackCircuitSettings(rail=Rail(tuned_q=4.0), noise=TractionSettings(white_rms=1e-3), clock_ppm=30.0)
    )
    blocks = [circuit.step(0) for _ in range(20)]
    return recording_of(np.concatenate([np.asarray(block.samples, np.float64) for block in blocks if block]))


def test_one_tap_finds_gain_and_place() -> None:
    sent = np.where(np.random.default_rng(1).random(200) < 0.5, -1.0, 1.0)
    heard = np.zeros(2 * 200 + 16, np.complex128)
    heard[5 : 5 + 400 : 2] = 0.3j * sent
    np.testing.assert_allclose(one_tap(heard, sent), sent, atol=1e-12)


@pytest.mark.parametrize("receiver", ["mlse", "lms", "nlms"])
def test_the_equaliser_brings_received_chips_to_the_sent_ones(simulated: Recording, receiver: str) -> None:
    profile = Profile(framing=Framing())
    samples = np.asarray(simulated.samples, np.float64)
    found = demodulate(samples, RATE_HZ, profile, receiver)
    wave = waveform(samples, RATE_HZ, profile, found)
    assert wave is not None
    assert len(wave.sent) == len(wave.after) == SHOWN_SYMBOLS * profile.code_length
    # Tuned units of quality 4 leave about -10 dB without a filter; each filter does better on clean samples.
    assert -13.0 < wave.before_db < -7.0
    assert wave.after_db < wave.before_db - 1.0
    assert wave.equaliser == ("least-squares" if receiver == "mlse" else receiver)
    # Chips are those that the sender put on the rail at that time.
    symbol = round(wave.sample / RATE_HZ * profile.symbol_rate_hz)
    bits = np.concatenate([telegram_bits(1, k, b"\xa5\x5a", Framing()) for k in range(8)])
    part = chips(bits[symbol : symbol + SHOWN_SYMBOLS], profile, symbol)
    np.testing.assert_array_equal(wave.sent, part.real)


def test_a_few_symbols_give_no_waveform() -> None:
    profile = Profile()
    bits = np.random.default_rng(2).integers(0, 2, TRAINED_SYMBOLS - 10).astype(np.int8)
    assert set(antipodal(bits)) == {-1.0, 1.0}
    samples = 0.1 * modulate(bits, profile, RATE_HZ)
    assert waveform(samples, RATE_HZ, profile, demodulate(samples, RATE_HZ, profile)) is None


def test_the_same_recording_gives_the_same_picture(tmp_path: Path, simulated: Recording) -> None:
    profile = Profile(framing=Framing())
    received = receive_recording(simulated, profile, circuit="TC1")
    pictures = []
    for name in ("first.svg", "second.svg"):
        save_picture(tmp_path / name, draw_reception(received, simulated, profile))
        pictures.append((tmp_path / name).read_bytes())
    assert pictures[0] == pictures[1]
    assert b"somewhere" not in pictures[0]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first.svg", "second.svg"]


def test_a_coded_recording_is_drawn_and_an_empty_one_refused(tmp_path: Path) -> None:
    profile = Profile(scheme="fsk")
    read = recording_of(0.1 * keyed(2001.4, 21.3, 11.0, RATE_HZ, 4 * round(RATE_HZ)))
    received = receive_recording(read, profile, circuit="K1")
    save_picture(tmp_path / "code.png", draw_reception(received, read, profile))
    assert (tmp_path / "code.png").read_bytes()[:4] == b"\x89PNG"
    with pytest.raises(ValueError, match="nothing was received"):
        draw_reception(Received(), read, profile)
    with pytest.raises(ValueError, match=r"\.png or \.svg"):
        save_picture(tmp_path / "code.pdf", draw_reception(received, read, profile))


def test_a_constellation_of_cdma_qam_is_drawn(tmp_path: Path) -> None:
    profile = Profile(scheme="cdma-qam", pulse="root-raised-cosine")
    bits = np.random.default_rng(3).integers(0, 2, 8 * profile.bits_per_block).astype(np.int8)
    read = recording_of(0.2 * modulate_cdma_qam(bits, profile, RATE_HZ))
    received = receive_recording(read, profile, circuit="T1")
    save_picture(tmp_path / "points.svg", draw_reception(received, read, profile))
    assert b"constellation" in (tmp_path / "points.svg").read_bytes()


def test_a_recording_with_a_gap_is_drawn(tmp_path: Path, simulated: Recording) -> None:
    samples = np.asarray(simulated.samples, np.float64)
    half = len(samples) // 2
    stretches = (Stretch(0, half, 0, 0), Stretch(half, len(samples), half + 5000, 0))
    gapped = replace(simulated, stretches=stretches)
    profile = msgspec.structs.replace(Profile(), framing=Framing())
    received = receive_recording(gapped, profile, circuit="TC1", receiver="nlms")
    save_picture(tmp_path / "gap.svg", draw_reception(received, gapped, profile))
    assert (tmp_path / "gap.svg").stat().st_size > 10_000
