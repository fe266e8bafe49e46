from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.radio_anomaly.settings import Settings
from services.radio_anomaly.steps import WindowMemory, find_steps, window_sums
from services.radio_anomaly.window_test import CHUNK, Correlation, PassTest, Residuals, chunks, whole_sum


def residuals_of(count: int, seed: int, *, gap: bool = False) -> Residuals:
    generator = np.random.default_rng(seed)
    sections = np.arange(count, dtype=np.int64)
    if gap:
        sections[count // 2 :] += 30
    variance = generator.uniform(1.0, 9.0, count)
    residual = np.clip(generator.normal(0.0, 1.0, count), -2.0, 2.0) * np.sqrt(variance)
    return Residuals(sections, residual, generator.uniform(0.1, 2.0, count), variance, np.full(count, 10.0))


@given(st.integers(2, 30), st.integers(0, 1000))
def test_running_sums_are_the_generalised_least_squares_estimate(count: int, seed: int) -> None:
    residuals = residuals_of(count, seed, gap=seed % 2 == 1)
    shares = Correlation(whole=0.1, near=0.3, reach=2.0)
    apart = np.abs(residuals.sections[:, None] - residuals.sections[None, :])
    shape, mean_shape = 0.1 + 0.3 * np.exp(-apart / 2.0), 0.8 * np.exp(-apart / 10.0)
    np.fill_diagonal(shape, 1.0)
    np.fill_diagonal(mean_shape, 1.0)
    passing, mean_error = np.sqrt(residuals.variance), np.sqrt(residuals.mean_variance)
    inverse = np.linalg.inv(shape * np.outer(passing, passing) + mean_shape * np.outer(mean_error, mean_error))
    for one in PassTest(residuals, shares).windows((1, 3, 5)):
        marked = ((residuals.sections >= one.start) & (residuals.sections < one.start + one.length)).astype(float)
        # Sums of the same products in another order.
        assert one.pull == pytest.approx(marked @ inverse @ residuals.residual, rel=1e-7, abs=1e-9)
        assert one.information == pytest.approx(marked @ inverse @ marked, rel=1e-7)
        assert one.observed == marked.sum()
        assert one.learned_passes == pytest.approx(residuals.passes[marked > 0.0].mean())
        weights = inverse @ marked / one.information
        mean_covariance = mean_shape * np.outer(mean_error, mean_error)
        assert one.lasting_variance == pytest.approx(weights @ mean_covariance @ weights, rel=1e-6, abs=1e-12)


def test_the_error_of_the_learned_means_lasts_over_all_of_a_pass_in_pieces() -> None:
    count = CHUNK + 100
    residuals = Residuals(np.arange(count), np.ones(count), np.full(count, 0.5), np.full(count, 4.0), np.ones(count))
    alone = Correlation(whole=0.0, near=0.0)
    whole = whole_sum([PassTest(part, alone) for part in chunks(residuals)])
    part = PassTest(residuals, alone).windows((10,))
    assert whole is not None
    assert 0.0 < whole.lasting_variance < 1.0 / whole.information
    # Errors of means fade over ten sections, so that they average out over five hundred but not over ten.
    assert next(part).lasting_variance > 5.0 * whole.lasting_variance


def test_the_score_of_independent_sections_is_the_mean_over_its_error() -> None:
    residuals = Residuals(np.arange(4), np.full(4, 2.0), np.zeros(4), np.full(4, 4.0), np.full(4, 10.0))
    one = PassTest(residuals, Correlation(whole=0.0, near=0.0)).window(0, 4)
    assert one is not None
    assert one.pull / one.information == pytest.approx(2.0)
    assert one.pull / np.sqrt(one.information) == pytest.approx(2.0), "2 dB over 2 dB / √4"


def test_a_share_of_the_whole_pass_weakens_a_change_of_the_whole_pass() -> None:
    residuals = Residuals(np.arange(50), np.full(50, 2.0), np.zeros(50), np.full(50, 4.0), np.full(50, 10.0))
    alone = whole_sum([PassTest(residuals, Correlation(whole=0.0, near=0.0))])
    shared = whole_sum([PassTest(residuals, Correlation(whole=0.2, near=0.0))])
    assert alone is not None
    assert shared is not None
    assert alone.pull / np.sqrt(alone.information) == pytest.approx(np.sqrt(50.0))
    # Variance of the mean: 4 (0.2 + 0.8 / 50).
    assert shared.pull / np.sqrt(shared.information) == pytest.approx(2.0 / np.sqrt(4.0 * (0.2 + 0.8 / 50.0)))


def test_one_wild_section_says_no_more_than_its_cut() -> None:
    wild = np.zeros(20)
    wild[10] = 100.0
    residuals = Residuals(np.arange(20), wild, np.zeros(20), np.ones(20), np.full(20, 10.0))
    one = PassTest(residuals, Correlation(whole=0.0, near=0.0)).window(10, 1)
    assert one is not None
    assert one.pull == pytest.approx(5.0)
    at_site = PassTest(
        Residuals(np.zeros(1, np.int64), np.array([100.0]), np.zeros(1), np.ones(1), np.full(1, 10.0)),
        Correlation(),
        site=True,
    ).window(0, 1)
    assert at_site is not None
    assert at_site.pull == pytest.approx(100.0)


def test_a_long_pass_comes_in_pieces() -> None:
    parts = list(chunks(residuals_of(2 * CHUNK + 7, 1)))
    assert [len(one.sections) for one in parts] == [CHUNK, CHUNK, 7]


@pytest.mark.parametrize(
    ("sections", "passes", "confirmed"),
    [(5, 4.0, True), (4, 4.0, False), (5, 2.0, False)],
    ids=["wide and well known", "narrow", "hardly learned"],
)
def test_one_pass_is_enough_sooner_over_many_well_known_sections(
    sections: int, passes: float, *, confirmed: bool
) -> None:
    told = Settings(windows=(sections,))
    score = (told.certain_wide_score + told.certain_score) / 2.0
    # The score of n independent sections off by r with a deviation of 4 dB each is r √n / 4.
    off = np.full(sections, score * 4.0 / np.sqrt(sections))
    known = np.full(sections, passes)
    residuals = Residuals(np.arange(sections), off, np.zeros(sections), np.full(sections, 16.0), known)
    tests = [PassTest(residuals, Correlation(whole=0.0, near=0.0))]
    (found,) = find_steps(("power", "R01", "1"), window_sums(tests, told), residuals, WindowMemory(), told)
    assert found.length == sections
    assert found.score == pytest.approx(score)
    assert found.confirmed is confirmed
