"""Windows of probability: moved, spread, parted and joined without losing any."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.gnss_correction.line_coasting import Coasting
from services.gnss_correction.line_likelihood import SPEED, VAR_SPEED
from services.gnss_correction.line_windows import Window, even, leap, move, tail_bound_m, tidy


def bell(centre_m: float, sigma_m: float, speed_mps: float = 0.0) -> Window:
    start = round(centre_m - 60.0)
    window = even(float(start), 121)
    window.mass = np.exp(-0.5 * ((window.places_m - centre_m) / sigma_m) ** 2)
    window.mass /= window.mass.sum()
    window.states[:, SPEED], window.states[:, VAR_SPEED] = speed_mps, 0.01
    return window


def moments(window: Window) -> tuple[float, float]:
    share = window.mass / window.mass.sum()
    mean = float(share @ window.places_m)
    return mean, float(share @ (window.places_m - mean) ** 2)


@given(st.floats(-40.0, 40.0), st.floats(0.05, 3.0))
def test_a_step_moves_by_the_speed_and_loses_nothing(speed_mps: float, dt_s: float) -> None:
    before = bell(500.0, 5.0, speed_mps)
    after = move(before, dt_s, 0.1, 0.1, 0.1)
    assert after.total == pytest.approx(1.0, abs=1e-9)
    # The tail beyond 12 standard deviations is all that can go missing.
    assert moments(after)[0] == pytest.approx(500.0 + speed_mps * dt_s, abs=1e-6)
    assert moments(after)[1] > moments(before)[1]


def test_small_steps_spread_exactly_by_their_variance() -> None:
    window = bell(500.0, 5.0, 15.0)
    spread = moments(window)[1]
    for _ in range(50):
        window.states[:, VAR_SPEED] = 0.01
        window = move(window, 0.2, 0.0, 0.0, 0.0)
    # Per step 0.01 m²/s² over a second's correlation, and 0.0025 m²/s of its own: moving adds nothing.
    assert moments(window)[1] == pytest.approx(spread + 50 * (0.01 * 0.2 + 0.0025 * 0.2), rel=1e-3)


def test_a_leap_adds_its_variance() -> None:
    before = bell(500.0, 5.0, 15.0)
    after = leap(before, 250.0, 10.0, 4.0, 900.0)
    assert moments(after)[0] == pytest.approx(750.0, abs=0.01)
    assert moments(after)[1] == pytest.approx(moments(before)[1] + 900.0, rel=0.01)
    assert after.speed_mps == pytest.approx(10.0)


def test_windows_part_at_gaps_and_join_where_they_overlap() -> None:
    apart = tidy([bell(500.0, 3.0), bell(900.0, 3.0)], 2000.0)
    assert len(apart) == 2
    assert sum(one.total for one in apart) == pytest.approx(1.0)
    together = tidy([bell(500.0, 3.0), bell(510.0, 3.0)], 2000.0)
    assert len(together) == 1
    assert moments(together[0])[0] == pytest.approx(505.0, abs=0.1)
    two = bell(500.0, 1.5)
    two.mass[:30] += np.exp(-0.5 * ((two.places_m[:30] - 450.0) / 1.5) ** 2)
    assert len(tidy([two], 2000.0)) == 2


def test_directions_of_running_stay_apart() -> None:
    assert len(tidy([bell(500.0, 3.0, 10.0), bell(505.0, 3.0, -10.0)], 2000.0)) == 2


def test_nothing_runs_far_off_the_end() -> None:
    assert tidy([bell(2100.0, 3.0)], 2000.0) == []
    assert tidy([], 2000.0) == []


def test_the_tail_is_where_the_probability_ends() -> None:
    windows = tidy([bell(500.0, 10.0)], 2000.0)
    # Two-sided 1e-3 of a normal distribution lies beyond 3.29 standard deviations; cells are 1 m.
    assert tail_bound_m(windows, 500.0, 1e-3) == pytest.approx(32.9, abs=1.1)
    far = bell(1500.0, 1.0)
    far.mass *= 1e-5
    both = tidy([bell(500.0, 10.0), far], 2000.0)
    assert tail_bound_m(both, 500.0, 1e-3) < 40.0
    assert tail_bound_m(both, 500.0, 1e-7) > 990.0


def test_coasting_grows_uncertain_as_a_random_walk_of_speed() -> None:
    fine, coarse = Coasting(20.0, 0.04), Coasting(20.0, 0.04)
    coarse.go(10.0, 1.0)
    for _ in range(100):
        fine.go(0.1, 1.0)
    assert coarse.distance_m == pytest.approx(200.0)
    assert coarse.sigma_m == pytest.approx(np.sqrt(0.04 * 100.0 + 1000.0 / 3.0))
    assert fine.sigma_m == pytest.approx(coarse.sigma_m, rel=1e-9)
