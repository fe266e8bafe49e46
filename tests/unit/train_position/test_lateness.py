"""Odometry that comes late: the position goes on to now by physics, and says so."""

from __future__ import annotations

import pytest

from services.train_position.lateness import Lateness
from tests.unit.train_position.made_up import Run, run_with

USUAL_S = 0.6
HOST_S = 5_000.0
"""The host's clock counts from somewhere else."""


def hear(run: Run, seconds: float, late_s: float, acceleration_mps2: float = 0.0) -> list[int]:
    """Run on while messages come so much later than usual; times that were published."""
    found: list[int] = []
    for _ in range(round(seconds * 10)):
        run.go(0.1, acceleration_mps2, silent=True)
        heard_s = run.t_ns / 1e9 - HOST_S + USUAL_S + late_s
        run.heard += run.keeper.on_message(run.odometry(), heard_s=heard_s)
        found.append(run.position.t_ns)
    return found


def test_lag_is_reckoned_from_what_is_usual() -> None:
    lateness = Lateness()
    # By hand: lags of 0.6, 0.5, 3.5 and 0.5 s.
    found = [lateness.of(round(t_s * 1e9), t_s + lag_s) for t_s, lag_s in ((1, 0.6), (2, 0.5), (3, 3.5), (7, 0.5))]
    assert found == pytest.approx([0.0, 0.0, 3.0, 0.0])


def test_a_clock_that_drifts_is_followed() -> None:
    lateness = Lateness()
    # 100 ppm over an hour: 0.36 s, of which no more than two windows of ten minutes are seen.
    found = [lateness.of(round(t_s * 1e9), t_s * 1.0001) for t_s in range(0, 3_600, 10)]
    assert max(found) < 0.13


def test_late_odometry_is_carried_on_to_now() -> None:
    run = run_with()
    hear(run, 20.0, 0.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    hear(run, 10.0, 0.0)
    assert run.status() == "valid"
    bound_m, known_m = run.position.bound_ahead_m or 0.0, run.position.axis_m or 0.0
    (*_, said_ns) = hear(run, 0.1, 5.0)
    assert said_ns == run.t_ns + 5_000_000_000
    assert run.status() == "degraded"
    assert "5.0 s late" in run.position.reason
    assert run.position.speed_bound_mps == pytest.approx(0.3 + 5.0 * 1.5)
    # 20 m/s for 5.1 s; 0.3 m/s and 1.5 m/s² of doubt for 5 s (2 % of 2 m in the step itself).
    assert run.position.axis_m == pytest.approx(known_m + 102.0, abs=0.1)
    assert run.position.bound_ahead_m == pytest.approx(bound_m + 0.3 * 5.0 + 1.5 * 25.0 / 2.0, abs=0.1)
    hear(run, 0.1, 0.0)
    assert run.status() == "valid"
    assert run.position.bound_ahead_m == pytest.approx(bound_m, abs=0.2)


def test_what_was_missed_is_published_for_now_while_old_messages_come() -> None:
    run = run_with()
    hear(run, 20.0, 0.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    hear(run, 1.0, 0.0)
    # Silent for 5 s, then all that was held up comes with 5 s of delay.
    now_ns = run.t_ns
    for k in range(1, 51):
        run.heard += run.keeper.on_time(now_ns + k * 100_000_000)
    for said_ns, heard_ns in zip(hear(run, 8.0, 5.0), range(80), strict=True):
        assert said_ns == now_ns + 5_000_000_000 + (heard_ns + 1) * 100_000_000
    assert run.status() == "degraded"
    hear(run, 1.0, 0.0)
    assert run.status() == "valid"
    run.require_true()
