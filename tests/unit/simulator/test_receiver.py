from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.simulator.paths import DIRECT, Paths
from services.simulator.receiver import (
    CHIP_M,
    WAVELENGTH_M,
    Measured,
    ReceiverChannels,
    carrier_noise_cycles,
    code_noise_m,
    doppler_noise_hz,
)
from services.simulator.receiver_clock import ReceiverClock
from services.simulator.scenario import Receiver
from services.simulator.sky import Arrivals

QUIET = Receiver(noise_scale=0.0, cn0_satellite_sigma_db=0.0)
HIGH = np.deg2rad(60.0)
BOTH = np.arange(2)


def sky(elevation_rad: float = HIGH) -> Arrivals:
    ones = np.ones(2)
    return Arrivals(
        towards=np.zeros((2, 3)),
        elevation_rad=elevation_rad * ones,
        azimuth_rad=0 * ones,
        code_m=2.2e7 * ones,
        carrier_m=2.2e7 * ones,
        rate_mps=100.0 * ones,
    )


def paths(*columns: tuple[float, float, float, int]) -> Paths:
    """The same paths (amplitude, excess, its rate, facade) for two satellites."""
    amplitude, excess_m, rate_mps, facade = (np.tile(row, (2, 1)) for row in np.array(columns).T)
    return Paths(amplitude, excess_m, rate_mps, facade.astype(np.int64))


OPEN = paths((1.0, 0.0, 0.0, DIRECT))
BLOCKED = paths((0.0, 0.0, 0.0, DIRECT))


def reflected(excess_m: float, rate_mps: float = 0.0, facade: int = 3) -> Paths:
    return paths((0.0, 0.0, 0.0, DIRECT), (0.5, excess_m, rate_mps, facade))


class Bench:
    """A receiver that is fed paths epoch by epoch."""

    def __init__(self, receiver: Receiver = QUIET) -> None:
        self.generator = np.random.default_rng(1)
        self.channels = ReceiverChannels(receiver, 2, self.generator)
        self.interval_s = receiver.interval_s
        self.epoch = 0

    def measure(self, there: Paths, elevation_rad: float = HIGH) -> Measured:
        now_s = self.epoch * self.interval_s
        self.epoch += 1
        return self.channels.measure(now_s, BOTH, sky(elevation_rad), there, (0.0, 0.0), self.generator)


def test_cn0_rises_with_elevation() -> None:
    elevations = np.deg2rad(np.linspace(5.0, 90.0, 40))
    cn0 = [Bench().measure(OPEN, e).cn0_dbhz[0] for e in elevations]
    assert (np.diff(cn0) > 0).all()
    assert cn0[-1] == pytest.approx(QUIET.cn0_zenith_dbhz)


def test_an_open_sky_is_measured_without_error() -> None:
    measured = Bench().measure(OPEN)
    assert measured.pseudorange_m == pytest.approx(2.2e7)
    assert measured.doppler_hz == pytest.approx(-100.0 / WAVELENGTH_M)
    assert measured.carrier_phase_cycles % 1 == pytest.approx(2.2e7 / WAVELENGTH_M % 1, abs=1e-6)
    assert measured.lock_lost.tolist() == [1, 1]


def test_a_reflection_alone_is_weaker_and_comes_in_by_the_loops_time_constant() -> None:
    bench = Bench()
    free = bench.measure(OPEN)
    hidden = [bench.measure(reflected(30.0)) for _ in range(60)]
    errors = [h.code_error_m[0] for h in hidden]
    step = 1 - np.exp(-4 * QUIET.code_loop_bandwidth_hz * QUIET.interval_s)
    assert errors[0] == pytest.approx(30.0 * step)
    assert errors[-1] == pytest.approx(30.0, abs=1e-3)  # twelve time constants
    assert (np.diff(errors) > 0).all()
    assert hidden[0].cn0_dbhz[0] == pytest.approx(free.cn0_dbhz[0] + 20 * np.log10(0.5))
    assert [int(h.lock_lost[0]) for h in hidden[:3]] == [1, 0, 0]


@given(st.lists(st.tuples(st.floats(0.0, 280.0), st.booleans()), min_size=1, max_size=20))
def test_signals_that_are_only_reflected_never_come_early(course: list[tuple[float, bool]]) -> None:
    bench = Bench()
    for excess_m, blocked in course:
        measured = bench.measure(BLOCKED if blocked else reflected(excess_m))
        assert (measured.code_error_m >= -1e-9).all()


def test_what_is_blocked_is_lost_and_comes_back_after_the_reacquisition_time() -> None:
    bench = Bench()
    assert len(bench.measure(OPEN).satellite) == 2
    assert len(bench.measure(BLOCKED).satellite) == 0
    assert [len(bench.measure(OPEN).satellite) for _ in range(4)] == [0, 0, 0, 2]  # 0.6 s
    assert bench.measure(OPEN).lock_lost.tolist() == [0, 0]


def test_signals_below_the_threshold_are_lost() -> None:
    deaf = msgspec.structs.replace(QUIET, tracking_threshold_dbhz=48.0)
    assert len(Bench(deaf).measure(OPEN, np.deg2rad(10.0)).satellite) == 0


def test_doppler_and_carrier_follow_the_reflection_while_it_is_tracked() -> None:
    bench, rate = Bench(), 0.3
    bench.measure(reflected(20.0, rate))
    first, second = (bench.measure(reflected(20.0 + i * rate * 0.2, rate)) for i in (1, 2))
    assert first.doppler_hz[0] == pytest.approx(-(100.0 + rate) / WAVELENGTH_M)
    moved = second.carrier_phase_cycles[0] - first.carrier_phase_cycles[0]
    assert moved == pytest.approx(rate * 0.2 / WAVELENGTH_M, abs=1e-6)  # 1e8 cycles are rounded at 1e-8
    assert second.code_error_m[0] - first.code_error_m[0] == pytest.approx(rate * 0.2, abs=1e-9)


def test_a_path_of_another_frequency_has_to_be_acquired_anew() -> None:
    bench = Bench()
    bench.measure(OPEN)
    # 33 m/s are 173 Hz; the frequency loop pulls in 25 Hz.
    found = [bench.measure(reflected(100.0, -33.0)) for _ in range(4)]
    assert [len(f.satellite) for f in found] == [0, 0, 0, 2]
    assert found[3].code_error_m[0] == pytest.approx(100.0)


def test_code_noise_is_what_the_theory_says_and_lasts_as_long_as_the_loop_remembers() -> None:
    receiver = msgspec.structs.replace(QUIET, noise_scale=1.0)
    bench = Bench(receiver)
    errors = np.array([bench.measure(OPEN).code_error_m for _ in range(3000)])
    cn0 = Bench().measure(OPEN).cn0_dbhz
    sigma = code_noise_m(cn0, receiver.correlator_spacing_chips, receiver.code_loop_bandwidth_hz, 0.02)[0]
    # 6000 draws correlated over five epochs leave 2.1 % of spread, here three and a half times that.
    assert errors.std() == pytest.approx(sigma, rel=0.075)
    memory = np.exp(-4 * receiver.code_loop_bandwidth_hz * receiver.interval_s)
    assert (errors[1:] * errors[:-1]).mean() / errors.var() == pytest.approx(memory, abs=0.05)


def test_noise_figures_at_a_usual_strength() -> None:
    cn0 = np.array([45.0])
    ratio = 10**4.5
    # Squaring losses are below 1 % at 45 dB-Hz.
    assert code_noise_m(cn0, 0.2, 1.0, 0.02)[0] == pytest.approx(CHIP_M * np.sqrt(0.1 / ratio), rel=0.01)
    assert carrier_noise_cycles(cn0, 15.0, 0.02)[0] == pytest.approx(np.sqrt(15 / ratio) / (2 * np.pi), rel=0.01)
    assert doppler_noise_hz(cn0, 8.0, 0.02)[0] == pytest.approx(np.sqrt(32 / ratio) / (0.04 * np.pi), rel=0.01)


def test_one_satellites_fate_does_not_change_anothers_noise() -> None:
    loud = msgspec.structs.replace(QUIET, noise_scale=1.0)
    alone, both = Bench(loud), Bench(loud)
    one_blocked = Paths(
        *(
            np.array([a[0], b[0]])
            for a, b in zip(
                (OPEN.amplitude, OPEN.excess_m, OPEN.excess_rate_mps, OPEN.facade),
                (BLOCKED.amplitude, BLOCKED.excess_m, BLOCKED.excess_rate_mps, BLOCKED.facade),
                strict=True,
            )
        )
    )
    for _ in range(5):
        here, there = alone.measure(one_blocked), both.measure(OPEN)
        assert here.pseudorange_m[0] == there.pseudorange_m[0]


def test_the_clock_is_set_by_whole_steps_and_its_drift_goes_on() -> None:
    clock = ReceiverClock(bias_s=4.0e-4, drift=1e-5, walk=0.0, step_s=1e-3)
    biases = []
    for _ in range(40):
        clock.advance(1.0, 0.0)
        biases.append(clock.bias_s)
    steps = np.diff(biases) - 1e-5
    assert np.abs(biases).max() <= 5.1e-4
    assert steps[np.abs(steps) > 1e-9] == pytest.approx([-1e-3])
    free = ReceiverClock(bias_s=4.0e-4, drift=1e-5, walk=0.0, step_s=0.0)
    free.advance(1e4, 0.0)
    assert free.bias_s == pytest.approx(0.1004)
