from __future__ import annotations

import numpy as np
import pytest

from services.simulator.breakaway import lasts_s, slip_of
from services.simulator.slip_episodes import AT_TIME, BREAKING_AWAY, EpisodeRow


def row_of(duration_s: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """2 s of micro-slip up to 0.2 m/s, then 1 m/s² up and 2 m/s² down, 1 s of fading from 0.1 m/s."""
    return np.array(
        EpisodeRow(
            AT_TIME, 0.0, 1.0, BREAKING_AWAY, duration_s, 0.5, 0.2, 0.0, 0.0, 0.5, 2.0, 0.1,
            build_up_s=2.0, micro_mps=0.2, rise_mps2=1.0, fall_mps2=2.0, swing=0.4, swing_hz=0.7, tail_mps=0.1,
            tail_s=1.0,
        )
    )  # fmt: skip


def test_a_short_slip_turns_before_its_peak() -> None:
    row = row_of(2.0)
    # (p - 0.2)/1 + (p - 0.1)/2 = 2: p = 1.5 m/s, 1.3 s after it breaks away.
    assert slip_of(3.3, 20.0, row) == pytest.approx(1.5)
    assert slip_of(1.0, 20.0, row) == pytest.approx(0.1)
    assert slip_of(2.5, 20.0, row) == pytest.approx(0.7)
    assert slip_of(3.8, 20.0, row) == pytest.approx(0.5)
    assert slip_of(4.5, 20.0, row) == pytest.approx(0.025)
    assert lasts_s(row) == pytest.approx(5.0)
    assert slip_of(5.0, 20.0, row) == 0.0


def test_a_long_slip_is_held_and_swings() -> None:
    row = row_of(12.0)
    t_s = np.arange(0.0, 15.0, 0.01)
    slip_mps = np.array([slip_of(float(one), 20.0, row) for one in t_s])
    # A fifth of 20 m/s: up within 3.8 s, down within 1.95 s; 6.25 s between hold four swings down to 60 %.
    held = (t_s > 2.0 + 3.8) & (t_s < 14.0 - 1.95)
    assert slip_mps.max() == pytest.approx(4.0)
    assert slip_mps[held].min() == pytest.approx(2.4, abs=1e-3)
    assert np.sum((slip_mps[held][1:-1] < 2.5) & (np.diff(slip_mps[held], 2) > 0)) > 0
    lows = held[1:-1] & (slip_mps[1:-1] < slip_mps[:-2]) & (slip_mps[1:-1] <= slip_mps[2:])
    assert lows.sum() == 4
    # No jumps: the fastest of all is the swing, 0.8 m/s · 2π · 0.64 Hz.
    assert np.abs(np.diff(slip_mps)).max() < 0.01 * 0.8 * 2.0 * np.pi * 0.65


def test_a_slow_train_s_wheel_keeps_turning() -> None:
    assert max(slip_of(0.1 * k, 2.0, row_of(6.0)) for k in range(90)) == pytest.approx(1.0)
    assert max(slip_of(0.1 * k, 1.0, row_of(6.0)) for k in range(90)) == pytest.approx(0.8)
