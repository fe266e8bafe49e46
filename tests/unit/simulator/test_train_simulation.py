from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from schemas.gnss import Ephemeris, Fix, Ionosphere
from schemas.gnss_time import NS, WEEK_S
from services.gnss_receiver.observations import Observations, observations_of
from services.simulator.line_scene import Foliage
from services.simulator.scenario_file import alignment_for
from services.simulator.train_scenario import TrainScenario, train_scenario_from_toml
from services.simulator.train_simulation import Tick, TrainSimulation

Solve = Callable[[Observations, Sequence[Ephemeris], Ionosphere], list[Fix]]
START_NS = (2412 * WEEK_S + 190_800) * NS
QUIET = """
name = "quiet"
line = "demo"
[driving]
dwell_s = [1.0, 1.0]
[sky]
systems = "G"
signal_in_space_sigma_m = 0.0
ionosphere_scale = 1.0
[receiver]
noise_scale = 0.0
clock_jump_s = 0.0
"""


def simulation(text: str, start_ns: int = START_NS) -> TrainSimulation:
    scenario: TrainScenario = train_scenario_from_toml(text)
    loaded = alignment_for(scenario)
    return TrainSimulation(scenario, loaded.alignment if loaded else None, start_ns, np.random.default_rng(5))


def take(text: str, count: int) -> list[Tick]:
    one = simulation(text)
    return [one.step() for _ in range(count)]


def test_the_solver_finds_the_moving_train_on_the_line(solve: Solve) -> None:
    one = simulation(QUIET + "[gnss]\n")
    ticks = [one.step() for _ in range(400)]
    instants = [tick.instant for tick in ticks if tick.instant is not None]
    assert one.receiver is not None
    fixes = solve(
        observations_of(instant.epoch for instant in instants),
        one.receiver.sky.ephemerides(START_NS),
        one.receiver.sky.ionosphere(START_NS),
    )
    for fix, instant in zip(fixes, instants, strict=True):
        # A millimetre, as for a receiver alone (test_simulation.py); 1e-8 deg are 1.1 mm.
        assert fix.lat_deg == pytest.approx(instant.truth.lat_deg, abs=1e-8)
        assert fix.lon_deg == pytest.approx(instant.truth.lon_deg, abs=1.2e-8)
        assert fix.h_m == pytest.approx(instant.truth.h_m, abs=3e-3)
    assert ticks[-1].samples.speed_mps[-1] > 10.0


def test_velocity_of_the_antenna_is_the_change_of_its_place() -> None:
    instants = [tick.instant for tick in take(QUIET + "[gnss]\n", 400) if tick.instant is not None]
    for before, after in zip(instants[150:-1:10], instants[151::10], strict=False):
        north_m = (after.truth.lat_deg - before.truth.lat_deg) * 110_930.0
        # 0.2 s apart; the metre per degree is right to 1e-4 here, the axis is a polyline of some metres a piece.
        mean_mps = (after.truth.vn_mps + before.truth.vn_mps) / 2
        assert north_m / 0.2 == pytest.approx(mean_mps, abs=0.03)


def test_in_a_tunnel_nothing_is_received_and_under_trees_less() -> None:
    one = simulation('name="a"\nline="demo"\n[journey]\nstart_axis_m = 4600.0\n[driving]\ndwell_s=[1.0,1.0]\n[gnss]\n')
    ticks = [one.step() for _ in range(1300)]
    seen: dict[str, list[float]] = {}
    for tick in ticks:
        if tick.instant is not None and tick.truth is not None:
            power = tick.instant.epoch.cn0_dbhz
            seen.setdefault(tick.instant.truth.surroundings, []).append(len(power))
            if tick.instant.truth.surroundings == "forest" and len(power):
                seen.setdefault("power in the forest", []).append(float(np.mean(power)))
            if tick.instant.truth.surroundings == "open" and len(power):
                seen.setdefault("power outside", []).append(float(np.mean(power)))
    assert max(seen["tunnel"]) == 0
    assert np.mean(seen["open"]) > 10
    # Crowns take 3 dB in the zenith and 11 at the horizon.
    assert np.mean(seen["power in the forest"]) < np.mean(seen["power outside"]) - 2.0


def test_a_train_on_the_branch_meets_the_branch() -> None:
    text = 'name="a"\nline="demo"\n[journey]\nbranch="akaiwa"\nstart_axis_m=13450.0\n[driving]\ndwell_s=[1.0,1.0]\n'
    ticks = take(text, 900)
    truths = [tick.truth for tick in ticks if tick.truth is not None]
    assert {truth.branch for truth in truths} == {"", "akaiwa"}
    on = [truth for truth in truths if truth.branch]
    assert min(truth.axis_m for truth in on) > 13_608.0
    # The branch has a kilometrage of its own that begins at the junction.
    assert on[0].chainage_m < 30.0
    assert max(abs(truth.curvature_per_m) for truth in on) == pytest.approx(1 / 250.0, rel=0.02)


def test_running_down_the_place_falls_and_curves_change_hands() -> None:
    text = 'name="a"\nline="demo"\n[journey]\ndirection="down"\nstart_axis_m=1400.0\n[driving]\ndwell_s=[1.0,1.0]\n'
    ticks = take(text, 900)
    axis = np.array([tick.truth.axis_m for tick in ticks if tick.truth is not None])
    assert axis[-1] < axis[0] - 500.0
    felt, stated = np.zeros(len(ticks)), np.zeros(len(ticks))
    for k, tick in enumerate(ticks):
        if len(tick.sensors.imu) and tick.truth is not None and tick.truth.speed_mps > 5.0:
            felt[k] = tick.sensors.imu[:, 5].mean() / tick.truth.speed_mps
            stated[k] = tick.truth.curvature_per_m
    # The line file counts curvature towards rising axis_m; this train sees it the other way round.
    curved = np.abs(stated) > 2e-3
    assert np.count_nonzero(curved) > 50
    assert np.corrcoef(felt[curved], stated[curved])[0, 1] < -0.9 or np.all(felt[curved] * stated[curved] < 0)


def test_ticks_can_be_skipped_without_a_break_in_the_motion() -> None:
    whole, broken = simulation(QUIET), simulation(QUIET)
    for _ in range(300):
        last = whole.step()
    broken.skip(299)
    again = broken.step()
    assert again.gps_ns == last.gps_ns
    assert np.array_equal(again.samples.imu, last.samples.imu)
    assert again.truth == last.truth


def test_shadows_of_trees_last_for_metres() -> None:
    trees, generator = Foliage(200), np.random.default_rng(1)
    level = np.zeros(200)
    first = trees.loss_db(0.0, level, generator)
    near = trees.loss_db(0.5, level, generator)
    far = trees.loss_db(200.0, level, generator)
    assert np.corrcoef(first, near)[0, 1] > 0.7
    assert abs(np.corrcoef(first, far)[0, 1]) < 0.3
    # 11 dB towards the horizon, less than a third of that overhead.
    assert far.mean() == pytest.approx(11.0, abs=1.0)
    assert trees.loss_db(900.0, np.full(200, np.pi / 2), generator).mean() < 5.0
