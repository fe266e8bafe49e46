"""How many bits receivers need: error rates of frozen coefficients after so many bits, without counting errors.

A linear receiver's output is a known sum of symbols plus Gaussian noise of known power, so that its error rate is the
mean of Gaussian tails over a long random pattern: exact, where counting would take hours.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.track_circuit_channel import PROFILE, RATE_HZ, Rail, half_chip_noise, half_chips, send, tail
from services.track_circuit.channel_estimate import LEAD, TAPS
from services.track_circuit.equaliser import HALF_CHIP_TAPS, STRIDE, LinearReceiver, despread
from services.track_circuit.least_squares import least_squares, windows
from services.track_circuit.modulate import antipodal, passband, shaped, spread
from services.track_circuit.qam import bits_per_symbol, qam_bits, qam_points
from services.track_circuit.qam_equaliser import LEAD as QAM_LEAD
from services.track_circuit.qam_equaliser import equalise, train
from services.track_circuit.receiver import Burst, StoredTaps
from services.track_circuit.signal_front_end import FrontEnd
from services.track_circuit.walsh import code

SYMBOLS = 700
SNR_DB = 10.0
STORED_SNR_DB = 20.0
TRIALS = 8
BITS = (2, 4, 8, 12, 16, 24, 32, 48, 64, 96, 128, 256)
WANTED = 1.6e-4
SEED = 20261122


@dataclass(frozen=True, slots=True)
class Curve:
    """Mean error rate of a receiver by the bits that it had."""

    receiver: str
    error_rates: dict[int, float]
    square_errors: dict[int, float]
    """Mean square error of the symbols, which are ±1."""

    @property
    def bits_needed(self) -> int | None:
        """First number of bits with an error rate of at most WANTED, and of all greater ones."""
        good = None
        for bits in sorted(self.error_rates, reverse=True):
            if self.error_rates[bits] > WANTED:
                break
            good = bits
        return good


class Scene:
    """A wet circuit, received, and what was stored on it when dry."""

    def __init__(self, quality: float, snr_db: float = SNR_DB) -> None:
        """Send the same pattern over both."""
        self.snr_db = snr_db
        generator = np.random.default_rng([SEED, int(quality)])
        self.bits = generator.integers(0, 2, SYMBOLS).astype(np.int8)
        self.symbols = antipodal(self.bits)
        self.pilots = np.resize(PROFILE.pilots(), SYMBOLS)
        self.code1 = code(PROFILE.code_length, PROFILE.ch1_row)
        self.chips = spread(self.pilots, code(PROFILE.code_length, PROFILE.ch2_row)) + spread(self.symbols, self.code1)
        self.clean = half_chips(send(self.bits, Rail(quality)).samples, SYMBOLS)
        dry = half_chips(send(self.bits, Rail(quality, ballast_s_per_km=0.01)).samples, SYMBOLS)
        dry = dry + half_chip_noise(len(dry), STORED_SNR_DB, generator)
        taps = least_squares(dry, self.chips.astype(np.complex128), HALF_CHIP_TAPS, STRIDE)
        self.stored = StoredTaps("nlms", taps)
        noise = half_chip_noise(100_000, snr_db, generator)
        self.noise_power = float(np.mean(np.abs(noise) ** 2))

    def errors(self, taps: NDArray[np.complex128]) -> tuple[float, float]:
        """Error rate and mean square error of frozen coefficients."""
        count = SYMBOLS * PROFILE.code_length
        output = despread(windows(self.clean, count, len(taps), STRIDE) @ taps, self.code1)
        combined = np.zeros(STRIDE * (len(self.code1) - 1) + len(taps), np.complex128)
        for k, chip in enumerate(self.code1):
            combined[STRIDE * k : STRIDE * k + len(taps)] += chip / len(self.code1) * taps
        noise_power = self.noise_power * float(np.sum(np.abs(combined) ** 2))
        sigma = math.sqrt(0.5 * noise_power) + 1e-30
        inner = (self.symbols * output.real)[2:-2] / sigma
        distance = float(np.mean(np.abs(output - self.symbols)[2:-2] ** 2))
        return float(np.mean([tail(float(x)) for x in inner])), distance + noise_power

    def burst(self, bits: int, generator: np.random.Generator) -> tuple[Burst, complex]:
        """`bits` symbols from a random place on with noise and a random carrier phase, and that phase."""
        length = PROFILE.code_length
        at = int(generator.integers(2, SYMBOLS - bits - 4))
        turn = complex(np.exp(2j * np.pi * generator.random()))
        part = self.clean[2 * at * length : 2 * ((at + bits) * length + LEAD + TAPS)]
        noisy = (part + half_chip_noise(len(part), self.snr_db, generator)) * turn
        return Burst(noisy, self.pilots[at : at + bits]), turn


def curve(scene: Scene, name: str, make: Callable[[], LinearReceiver], trials: int) -> Curve:
    """Errors of a receiver over BITS, each the mean over `trials`."""
    rates, squares = {}, {}
    for bits in BITS:
        rates[bits], squares[bits] = trained(scene, make, bits, trials)
    return Curve(name, rates, squares)


def trained(scene: Scene, make: Callable[[], LinearReceiver], bits: int, trials: int) -> tuple[float, float]:
    """Mean error rate and mean square error of a receiver after so many bits."""
    generator = np.random.default_rng([SEED, bits])
    found = []
    for _ in range(trials):
        burst, turn = scene.burst(bits, generator)
        found.append(scene.errors(make().receive(burst).taps * turn))
    rate, square = np.mean(found, axis=0)
    return float(rate), float(square)


def receivers(scene: Scene) -> dict[str, Callable[[], LinearReceiver]]:
    """Warm and cold receivers, each made anew."""
    return {
        "warm NLMS 0.05, stored when dry": lambda: LinearReceiver(PROFILE, "nlms", scene.stored),
        "RLS from zero": lambda: LinearReceiver(PROFILE, "rls"),
        "least squares": lambda: LinearReceiver(PROFILE, "least-squares"),
        "NLMS 0.5 from zero": lambda: LinearReceiver(PROFILE, "nlms"),
        "LMS from zero (Arai et al.)": lambda: LinearReceiver(PROFILE, "lms"),
    }


def curves(trials: int) -> list[Curve]:
    """Warm and cold receivers on the wet circuit with tuned units of quality 4 at 10 dB."""
    scene = Scene(4.0)
    return [curve(scene, name, make, trials) for name, make in receivers(scene).items()]


QAM_SYMBOLS = 4000
QAM_TRAINING = 16
STORED_TRAINING = 1000


def qam_error_rate(order: int, snr_db: float, quality: float, rounds: int, *, feedback: int) -> tuple[int, int]:
    """Wrong bits and bits of warm-started QAM after QAM_TRAINING known symbols; counted, on a wet circuit."""
    generator = np.random.default_rng([SEED, order, feedback])
    each = bits_per_symbol(order)
    bits = generator.integers(0, 2, QAM_SYMBOLS * each).astype(np.int8)
    symbols = qam_points(bits, order)
    wet, dry = (_qam_half_symbols(symbols, Rail(quality, ballast_s_per_km=s), each) for s in (0.1, 0.01))
    learned = dry + half_chip_noise(len(dry), 25.0, generator)
    stored = train(learned, symbols[:STORED_TRAINING], feedback=feedback)
    wrong = total = 0
    for _ in range(rounds):
        noisy = (wet + half_chip_noise(len(wet), snr_db, generator)) * np.exp(2j * np.pi * generator.random())
        taps = train(noisy, symbols[:QAM_TRAINING], stored, feedback=feedback)
        count = QAM_SYMBOLS - QAM_TRAINING - 16
        points = equalise(noisy[2 * QAM_TRAINING :], taps, order, count, symbols[:QAM_TRAINING][::-1])
        sent = bits[QAM_TRAINING * each : (QAM_TRAINING + count) * each]
        wrong += int(np.count_nonzero(qam_bits(points, order) != sent))
        total += len(sent)
    return wrong, total


def _qam_half_symbols(symbols: NDArray[np.complex128], rail: Rail, bits_each: int) -> NDArray[np.complex128]:
    """Symbols behind a rail at two samples each and unit energy per bit, beginning as the equaliser wants it."""
    baseband = rail.through(shaped(symbols, PROFILE, RATE_HZ))
    energy = float(np.sum(np.abs(baseband) ** 2)) / 2.0 / (len(symbols) * bits_each)
    samples = np.concatenate([passband(baseband / math.sqrt(energy), PROFILE.carrier_hz, RATE_HZ), np.zeros(1000)])
    step = RATE_HZ / (2.0 * PROFILE.chip_rate_hz)
    front_end = FrontEnd(RATE_HZ, PROFILE.chip_rate_hz)
    start = 2.0 * step * (1 - QAM_LEAD)
    return front_end.baseband(samples, start, step, 2 * (len(symbols) + QAM_LEAD + 8), PROFILE.carrier_hz, 0.0)
