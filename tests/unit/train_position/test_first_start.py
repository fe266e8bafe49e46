"""The first start of all, under way: with a wheel that adheres, and with one that slips since before."""

from __future__ import annotations

import copy

import pytest

from benchmarks.position import known_start
from benchmarks.whole_train import Chain, judge_of
from schemas.position import FaultKind
from services.odometry_fusion.live_odometry import LiveOdometry
from tests.unit.train_position.made_up import Run, events_of, run_with
from tests.unit.train_position.test_faults import require_true, scenario

BEFORE_S = 0.8
SPEED_MPS = 12.0
BY_THEN_S = 40.0
"""An ordinary start is to be valid, with satellites, and one in a slip of six seconds, too."""


@pytest.fixture(scope="module")
def under_way() -> Chain:
    """A train at SPEED_MPS that still gains speed; every test takes a copy on."""
    chain = Chain(scenario(), 3, [])
    chain.run(60.0, until=lambda now: now.speed_mps >= SPEED_MPS)
    return chain


@pytest.mark.parametrize(
    ("kind", "slip_mps", "for_s"),
    [("slide", 0.0, 0.0), ("slide", 4.0, 6.0), ("slide", 11.0, 6.0), ("spin", 5.0, 6.0)],
)
def test_it_is_held_degraded_until_the_wheel_has_been_calm_and_valid_soon_after(
    under_way: Chain, kind: FaultKind, slip_mps: float, for_s: float
) -> None:
    chain = copy.deepcopy(under_way)
    if slip_mps:
        chain.simulation.faults.switch(kind, now_s=chain.simulation.now_s, magnitude=slip_mps, seconds=BEFORE_S + for_s)
    chain.run(BEFORE_S)
    found = judge_of("satellites", facing="up", balises=False, fixes=False)
    chain.judges, chain.live = [found], LiveOdometry(chain.odometry, "T1", 2, None)
    for _ in range(round(BY_THEN_S)):
        # Satellites once a second, to 5 m.
        chain.run(1.0)
        chain.tell(known_start(chain, chain.truth[-1].axis_m))
    require_true(chain, found)
    known = [one for one in found.positions if one.axis_m is not None]
    valid = [one for one in known if one.status == "valid"]
    assert known[-1].status == "valid"
    assert (valid[0].t_ns - found.positions[0].t_ns) / 1e9 > 20.0 + for_s - 1.0
    doubted = [one for one in known if one.t_ns < valid[0].t_ns]
    assert all("has not been seen to adhere" in one.reason for one in doubted)
    # A hundred metres per second at most since the newest of them.
    assert max((one.bound_ahead_m or 0.0) + (one.bound_behind_m or 0.0) for one in doubted) < 250.0


def blind(run: Run, seconds: float, counted_mps: float) -> None:
    """The odometry has begun under way, and vouches for nothing."""
    for _ in range(round(seconds * 10)):
        run.go(0.1, silent=True)
        run.distance_m += counted_mps * 0.1
        run.way_m += counted_mps * 0.1
        said = run.odometry(speed_mps=counted_mps, speed_bound_mps=100.0, standstill=False, status="degraded")
        run.heard += run.keeper.on_odometry(said)
        run.provisional_m += 10.0
        run.require_true()


def test_an_odometry_that_vouches_for_nothing_is_left_aside_and_the_train_goes_on_with_its_wheels() -> None:
    run = run_with()
    run.keeper.held.reach.sense = 1
    run.speed_mps = 20.0
    blind(run, 0.2, 4.0)
    run.hear(run.front_end(0.0, 5.0))
    blind(run, 10.0, 4.0)
    assert "began under way" in run.position.reason
    assert run.status() == "degraded"
    least_m, greatest_m = run.margin_m()
    # It is between standing and 100 m/s, and not behind where it was, but for the fix's bound.
    assert run.front_m - 200.0 - 5.0 - 1.0 <= least_m
    assert greatest_m <= run.front_m + 800.0 + 5.0 + 1.0


def test_it_is_believed_once_it_knows_its_speed_and_has_been_calm() -> None:
    run = run_with()
    run.keeper.held.reach.sense = 1
    run.speed_mps = 20.0
    blind(run, 0.2, 20.0)
    run.hear(run.front_end(0.0, 5.0))
    blind(run, 25.0, 20.0)
    assert "began under way" in run.position.reason
    run.provisional_m = 0.0
    run.go(0.2)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.2)
    assert run.status() == "valid"
    assert any("believed again" in one for one in events_of(run, "change"))
    run.require_true()


def test_it_is_believed_at_once_where_it_begins_anew_at_rest() -> None:
    run = run_with()
    run.keeper.held.reach.sense = 1
    blind(run, 5.0, 4.0)
    run.origin, run.distance_m, run.way_m, run.provisional_m = "o2", 0.0, 0.0, 0.0
    run.go(0.2)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.2)
    assert run.status() == "valid"


def test_an_odometry_that_knows_its_speed_is_believed_from_its_first_word_on() -> None:
    run = run_with()
    run.speed_mps = 20.0
    run.go(0.5)
    run.hear(run.front_end(0.0, 5.0))
    assert "not believed" not in run.position.reason
