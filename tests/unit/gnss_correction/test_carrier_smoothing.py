"""The Hatch filter against its closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.gnss_correction.carrier_smoothing import CarrierSmoother
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.solver_arrays import ROW, Float64s

FAR_M, RATE_MPS = 2.2e7, 300.0


def smoothed(
    errors_m: list[float],
    *,
    smooth_s: float = 1e6,
    interval_s: float = 0.2,
    cycles_m: list[float] | None = None,
    lost: dict[int, float] | None = None,
    doppler: bool = True,
    blocks: int = 1,
) -> Float64s:
    """Errors of smoothed pseudoranges of a satellite that recedes steadily; `cycles_m` is added to its carrier."""
    count = len(errors_m)
    t_s = np.arange(count, dtype=np.float64) * interval_s
    rows = np.zeros(count, ROW)
    rows["satellite"], rows["rejection"] = 7, int(Rejection.USABLE)
    true_m = FAR_M + RATE_MPS * t_s
    rows["pseudorange_m"] = true_m + errors_m
    rows["carrier_m"] = true_m + 5.0 + np.array(cycles_m or [0.0] * count)
    rows["range_rate_mps"] = RATE_MPS if doppler else math.nan
    for k, indicator in (lost or {}).items():
        rows["lock_lost"][k] = indicator
    smoother = CarrierSmoother(smooth_s)
    for part in np.array_split(np.arange(count), blocks):
        some = rows[part]
        smoother.smooth(np.arange(len(part) + 1), np.asarray(t_s[part], np.float64), some)
        rows[part] = some
    return np.asarray(rows["pseudorange_m"] - true_m)


# Pseudoranges of 2e7 m keep 4e-9 m; sums of some dozens of them are good to a micrometre.
EXACT_M = 1e-6


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=40))
def test_without_a_time_limit_it_is_the_mean_so_far(errors_m: list[float]) -> None:
    expected = np.cumsum(errors_m) / np.arange(1, len(errors_m) + 1)
    np.testing.assert_allclose(smoothed(errors_m), expected, atol=EXACT_M)


@given(st.floats(-10.0, 10.0), st.integers(1, 50))
def test_a_constant_bias_stays(bias_m: float, count: int) -> None:
    np.testing.assert_allclose(smoothed([bias_m] * count, smooth_s=1.0), bias_m, atol=EXACT_M)


def test_with_a_time_constant_an_impulse_decays_geometrically() -> None:
    found = smoothed([0.0] * 10 + [1.0] + [0.0] * 5, smooth_s=1.0)
    np.testing.assert_allclose(found[10:], 0.2 * 0.8 ** np.arange(6), atol=EXACT_M)


def test_a_time_constant_below_the_interval_smooths_nothing() -> None:
    errors_m = [1.0, -2.0, 0.5, 3.0]
    np.testing.assert_allclose(smoothed(errors_m, smooth_s=0.1), errors_m, atol=EXACT_M)


@pytest.mark.parametrize("doppler", [True, False])
def test_a_slip_begins_anew(doppler: bool) -> None:  # noqa: FBT001 - a parameter of the test
    errors_m = [1.0, -1.0, 1.0, -1.0, 2.0, 0.0]
    # Without Doppler only the pseudorange tells, which takes a slip beyond multipath.
    found = smoothed(errors_m, cycles_m=[0.0] * 4 + [100.0] * 2, doppler=doppler)
    np.testing.assert_allclose(found[3:], [0.0, 2.0, 1.0], atol=EXACT_M)


def test_a_slip_of_three_cycles_is_seen_by_doppler() -> None:
    found = smoothed([1.0, 1.0, 1.0, 4.0], cycles_m=[0.0] * 3 + [3 * 0.1903])
    assert found[3] == pytest.approx(4.0, abs=EXACT_M)


def test_the_receivers_loss_of_lock_begins_anew_and_its_half_cycles_do_not() -> None:
    errors_m = [1.0, 1.0, 1.0, 4.0]
    assert smoothed(errors_m, lost={3: 1.0})[3] == pytest.approx(4.0, abs=EXACT_M)
    assert smoothed(errors_m, lost={3: 2.0})[3] == pytest.approx(1.75, abs=EXACT_M)


def test_a_gap_begins_anew() -> None:
    assert smoothed([1.0, 1.0, 4.0], interval_s=2.0)[2] == pytest.approx(4.0, abs=EXACT_M)


@pytest.mark.parametrize("at", [0, 3])
def test_without_a_carrier_the_pseudorange_stays(at: int) -> None:
    errors_m = [1.0, -1.0, 1.0, -1.0, 2.0]
    found = smoothed(errors_m, cycles_m=[math.nan if k == at else 0.0 for k in range(5)])
    assert found[at] == pytest.approx(errors_m[at], abs=EXACT_M)
    assert np.isfinite(found).all()


@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=20), st.integers(2, 5))
def test_blocks_change_nothing(errors_m: list[float], parts: int) -> None:
    np.testing.assert_array_equal(smoothed(errors_m), smoothed(errors_m, blocks=parts))


def test_noise_falls_with_the_root_of_the_count() -> None:
    generator = np.random.default_rng(3)
    ends = [smoothed(list(generator.standard_normal(100)))[-1] for _ in range(200)]
    # One in ten of the noise; 200 draws know a standard deviation to 5 %, three of these are allowed.
    assert np.std(ends) == pytest.approx(0.1, rel=0.15)
