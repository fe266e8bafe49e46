"""Further signals of a satellite: what they add to a correction."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from schemas.gnss import Epoch
from services.gnss_correction.other_signals import LARGEST_M, SignalAverages, centred
from services.gnss_correction.pipeline import block_of
from services.gnss_reference.reference_correction import ReferenceStation, StationSettings
from tests.unit.gnss_correction.made_up_sky import START_S
from tests.unit.gnss_correction.test_differential import BASE_DEG, SKY, answer, base, informed, off_m, rover

REFLECTED_M = 6.0


def with_second(epoch: Epoch, delay_m: float, reflected: str = "") -> Epoch:
    """The epoch with a second signal everywhere: the receiver's delay, air, and the first signal of one reflected."""
    air_m = np.array([3.0 * np.cos(int(name[1:])) for name in epoch.satellites])
    first_m = epoch.pseudorange_m + np.array([REFLECTED_M * (name == reflected) for name in epoch.satellites])
    return msgspec.structs.replace(
        epoch,
        satellites=epoch.satellites * 2,
        signals=epoch.signals + tuple("5Q" for _ in epoch.signals),
        pseudorange_m=np.concatenate([first_m, epoch.pseudorange_m + air_m + delay_m]),
        carrier_phase_cycles=np.tile(epoch.carrier_phase_cycles, 2),
        doppler_hz=np.tile(epoch.doppler_hz, 2),
        cn0_dbhz=np.tile(epoch.cn0_dbhz, 2),
        lock_lost=np.tile(epoch.lock_lost, 2),
    )


def test_medians_go_and_outliers_are_left_out() -> None:
    found = centred({(1, "5Q"): 4.0, (2, "5Q"): 5.0, (3, "5Q"): 5.5, (4, "5Q"): 5.0 + 2 * LARGEST_M, (201, "5Q"): 1.0})
    assert found == {(1, "5Q"): -1.25, (2, "5Q"): -0.25, (3, "5Q"): 0.25}


def test_averages_follow_without_gaps() -> None:
    averages = SignalAverages(100.0)
    values = [averages.take(float(k), {(1, "5Q"): float(k % 2)})[1, "5Q"] for k in range(20)]
    assert values[-1] == pytest.approx(0.5, abs=0.1), "half of the values are one"
    assert averages.take(25.0, {(1, "5Q"): 7.0}) == {(1, "5Q"): 7.0}


def test_a_reflection_on_one_signal_counts_half() -> None:
    station = ReferenceStation("W1", BASE_DEG, StationSettings(smooth_s=0.0))
    for one in SKY:
        station.add(one)
    (both,) = station.block(block_of(with_second(base(START_S), 30.0)))
    victim = max(both.satellites, key=lambda one: one.elevation_rad).satellite
    errors_m = []
    for corrections in (
        both,
        msgspec.structs.replace(
            both, satellites=tuple(msgspec.structs.replace(one, others=()) for one in both.satellites)
        ),
    ):
        correction = informed()
        assert correction.correct_by(corrections) == ""
        fix, _ = answer(correction, with_second(rover(START_S), -12.0, victim))
        errors_m.append(off_m(fix))
    # The solution is linear in the pseudoranges, up to the weights' and directions' change over metres.
    assert errors_m[0] == pytest.approx(errors_m[1] / 2.0, rel=0.05)
    assert errors_m[1] > 0.5
