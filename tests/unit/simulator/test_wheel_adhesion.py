from __future__ import annotations

import numpy as np
import pytest

from services.simulator.motion_settings import (
    IDLE_AXLE,
    Adhesion,
    Driving,
    Episode,
    MotionSettings,
    SlipKind,
)
from services.simulator.motion_simulator import MotionSamples, MotionSimulator
from services.simulator.motion_state import NO_COMMAND, STEP_S, Command
from tests.unit.simulator.motion_tracks import IDEAL, uniform_track

BRISK = Driving(dwell_s=(2.0, 2.0), power_share=(1.0, 1.0))


def run(adhesion: Adhesion, seconds: float = 300.0, seed: int = 1, command: Command = NO_COMMAND) -> MotionSamples:
    settings = MotionSettings(imu=IDEAL.imu, adhesion=adhesion, driving=BRISK)
    return MotionSimulator(uniform_track(), settings, np.random.default_rng(seed)).advance(
        round(seconds / STEP_S), command
    )


def rim_mps(samples: MotionSamples) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.asarray(np.gradient(samples.wheel_way_m, STEP_S))


def test_a_dry_wheel_creeps_by_a_few_per_mille_in_the_direction_of_effort() -> None:
    samples = run(Adhesion())
    assert not np.any(samples.slip)
    fast = samples.speed_mps > 5.0
    creep = (rim_mps(samples) / np.maximum(samples.speed_mps, 1.0) - 1.0) * 1e3
    pulling, braking = fast & (samples.effort_mps2 > 0.3), fast & (samples.effort_mps2 < -0.3)
    assert 0.5 < creep[pulling].mean() < 8.0
    assert -8.0 < creep[braking].mean() < -0.5
    assert np.abs(creep[fast]).max() < 15.0
    twice = run(Adhesion(micro_slip=2.0))
    lost, lost_twice = ((s.wheel_way_m - s.distance_m)[6000] for s in (samples, twice))
    assert lost_twice == pytest.approx(2.0 * lost, rel=1e-6)


@pytest.mark.parametrize("kind", ["cycling", "controlled", "locked", "creeping", "breaking_away"])
def test_a_slide_turns_the_wheel_too_slowly_and_ends(kind: SlipKind) -> None:
    # Power from 2 s, limit of 20 m/s reached at about 30 s; the first stop is braked for at about 90 s.
    free = run(Adhesion())
    braking = float(np.flatnonzero((free.effort_mps2 < -0.4) & (free.t_s > 20.0))[0]) * STEP_S + 1.5
    samples = run(Adhesion(episodes=(Episode(kind=kind, at_s=braking, duration_s=6.0, adhesion=0.4, slip=0.2),)))
    slipping = samples.slip == -1
    assert np.any(slipping)
    assert not np.any(samples.slip == 1)
    start, end = samples.t_s[slipping][[0, -1]]
    assert braking - 0.1 <= start <= braking + 1.0
    # The episode lasts 6 s; until adhesion is back some seconds may pass (ramp out 2.5 s, wheel spun up again).
    assert 4.0 < end - start < 15.0
    lost_m = (samples.wheel_way_m - samples.distance_m)[slipping]
    assert lost_m[-1] - lost_m[0] < -1.0
    after = (samples.t_s > end + 1.0) & (samples.t_s < end + 5.0) & (samples.speed_mps > 1.0)
    assert np.abs(rim_mps(samples)[after] / samples.speed_mps[after] - 1.0).max() < 0.015
    slow = rim_mps(samples)[slipping].min()
    if kind == "locked":
        assert slow < 0.5
    if kind == "controlled":
        # Settles at 20 %, plus or minus its unrest of 15 % of that times three.
        assert 0.5 < (rim_mps(samples)[slipping] / samples.speed_mps[slipping]).min() < 0.9


@pytest.mark.parametrize("kind", ["cycling", "controlled"])
def test_a_spin_turns_the_wheel_too_fast_and_ends(kind: SlipKind) -> None:
    samples = run(Adhesion(episodes=(Episode(kind=kind, at_s=8.0, duration_s=5.0, adhesion=0.4),)))
    assert np.any(samples.slip == 1)
    assert not np.any(samples.slip == -1)
    assert (samples.wheel_way_m - samples.distance_m)[samples.slip == 1][-1] > 1.0
    assert samples.slip[-1] == 0


def away(seed: int = 1, at_s: float = 8.0, *, length: float = 1.0, speed: float = 1.0) -> MotionSamples:
    """A wheel that breaks away while nothing else parts it from the train."""
    episode = Episode(kind="breaking_away", at_s=at_s, duration_s=8.0, slip=0.25)
    adhesion = Adhesion(micro_slip=0.0, episodes=(episode,), build_up=length, build_up_speed=speed)
    return run(adhesion, seed=seed)


def test_a_wheel_breaks_away_out_of_micro_slip_and_comes_back() -> None:
    for seed in range(4):
        samples = away(seed)
        off_mps = rim_mps(samples) - samples.speed_mps
        slipping = np.flatnonzero(samples.slip)
        assert set(samples.slip[slipping].tolist()) == {1}
        assert np.all(np.diff(slipping) == 1)
        # 8 s, and 0.3 to 2.5 s before and 0.3 to 1.5 s after.
        assert 8.6 < len(slipping) * STEP_S < 12.1
        assert np.abs(np.delete(off_mps, slipping)[100:]).max() < 0.02
        onset_mps = float(samples.speed_mps[slipping[0]])
        away_mps = off_mps[slipping]
        assert away_mps.max() <= max(0.25 * onset_mps, 1.0) + 0.02
        assert away_mps.max() > 0.9
        # Never faster than the rise of 2.5 m/s² at most, the fall, or a swing of half of 0.25·v at 0.9 Hz.
        assert np.abs(np.diff(away_mps) / STEP_S).max() < max(2.6, 0.25 * 0.25 * onset_mps * 2.0 * np.pi * 0.95 * 1.5)
        first = away_mps[: round(0.25 / STEP_S)]
        assert first.max() < 0.35


def test_micro_slip_before_a_wheel_breaks_away_may_be_longer_and_faster() -> None:
    usual, longer, faster = away(2), away(2, length=3.0), away(2, speed=3.0)

    def builds_up(samples: MotionSamples) -> tuple[float, float]:
        """Length of the micro-slip [s] and its speed after half of the usual length [m/s]."""
        off_mps = (rim_mps(samples) - samples.speed_mps)[np.flatnonzero(samples.slip)]
        return float(np.flatnonzero(off_mps > 0.4)[0]) * STEP_S, float(off_mps[: round(0.3 / STEP_S)].max())

    plain = builds_up(usual)
    assert len(np.flatnonzero(longer.slip)) > len(np.flatnonzero(usual.slip)) + round(1.2 / STEP_S)
    assert builds_up(longer)[0] > plain[0] + 0.6
    assert builds_up(longer)[1] < 0.6 * plain[1]
    assert builds_up(faster)[1] == pytest.approx(3.0 * plain[1], rel=0.1)
    assert len(np.flatnonzero(faster.slip)) == len(np.flatnonzero(usual.slip))


def test_a_wheel_breaks_away_from_under_the_brakes_and_never_turns_backwards() -> None:
    free = run(Adhesion())
    braking = float(np.flatnonzero((free.effort_mps2 < -0.4) & (free.t_s > 20.0))[0]) * STEP_S + 1.5
    for at_s in (braking, braking + 22.0):
        samples = away(1, at_s)
        assert -1 in samples.slip
        assert 1 not in samples.slip
        assert np.all(np.diff(samples.wheel_way_m) >= 0.0)
        assert samples.slip[-1] == 0


def test_less_adhesion_slows_the_train_less() -> None:
    free = run(Adhesion())
    braking = float(np.flatnonzero((free.effort_mps2 < -0.4) & (free.t_s > 20.0))[0]) * STEP_S + 1.5
    slippery = [
        run(Adhesion(episodes=(Episode(kind="cycling", at_s=braking, duration_s=8.0, adhesion=0.2),)), seed=seed)
        for seed in range(5)
    ]
    at = round((braking + 6.0) / STEP_S)
    assert all(samples.speed_mps[at] > free.speed_mps[at] for samples in slippery)


def test_an_episode_at_a_place_comes_each_time_the_train_passes() -> None:
    settings = MotionSettings(
        imu=IDEAL.imu,
        adhesion=Adhesion(episodes=(Episode(kind="controlled", at_axis_m=1150.0, duration_s=4.0),)),
        driving=BRISK,
    )
    track = uniform_track(length_m=2000, stops_m=(1000.0, 1900.0))
    simulator = MotionSimulator(track, settings, np.random.default_rng(1), places={1150.0: 1150.0})
    samples = simulator.advance(60_000)
    began = np.flatnonzero((samples.slip[1:] != 0) & (samples.slip[:-1] == 0)) + 1
    places = np.where(samples.trip[began] % 2 == 0, samples.way_m[began], 2000.0 - samples.way_m[began])
    assert len(began) >= 2
    # Looked for every 0.1 s; without effort at the place it begins with the next effort, within the episode.
    assert np.all(np.abs(places - 1150.0) < 60.0)


def test_creep_that_has_grown_beyond_two_percent_is_called_a_slip() -> None:
    usual, doubled, sixfold = (run(Adhesion(micro_slip=share)) for share in (1.0, 2.0, 6.0))
    assert not np.any(usual.slip)
    assert not np.any(doubled.slip)
    off_mps = rim_mps(sixfold) - sixfold.speed_mps
    # Outside the first steps of an onset, which the label sees one step late.
    told, much = sixfold.slip != 0, np.abs(off_mps) > np.maximum(0.3, 0.02 * sixfold.speed_mps)
    assert np.any(told)
    assert np.mean(told[much]) > 0.99
    assert np.abs(off_mps[told]).min() > 0.14
    assert np.all(np.sign(off_mps[told]) == sixfold.slip[told])


def test_random_slips_are_mostly_shorter_than_ten_seconds_and_of_both_signs() -> None:
    durations, signs = [], set()
    for seed in range(6):
        samples = run(Adhesion(random_gap_s=20.0, shortest_gap_s=10.0), 1500.0, seed)
        edges = np.flatnonzero(np.diff(np.r_[0, (samples.slip != 0).astype(int), 0]))
        durations += list((edges[1::2] - edges[::2]) * STEP_S)
        signs |= set(samples.slip.tolist())
    assert signs == {-1, 0, 1}
    assert len(durations) > 60
    # Iwata et al., 3.1.4: about 90 % of slips last 10 s or less.
    assert np.mean(np.array(durations) <= 10.0) > 0.8
    assert max(durations) < 30.0


def test_an_idle_axle_neither_slides_nor_creeps() -> None:
    settings = MotionSettings(vehicle=IDLE_AXLE, imu=IDEAL.imu, adhesion=Adhesion(random_gap_s=20.0), driving=BRISK)
    samples = MotionSimulator(uniform_track(), settings, np.random.default_rng(1)).advance(40_000)
    # Only the unrest of rolling remains: 0.3 per mille, without a direction.
    assert abs(samples.wheel_way_m[-1] / samples.distance_m[-1] - 1.0) < 2e-4


def test_a_forced_slide_holds_the_rim_below_the_train() -> None:
    settings = MotionSettings(imu=IDEAL.imu, driving=BRISK)
    simulator = MotionSimulator(uniform_track(), settings, np.random.default_rng(1))
    simulator.advance(4000)
    samples = simulator.advance(500, Command(-3.0, 0.0))
    assert set(samples.slip.tolist()) == {-1}
    # Time constant 0.4 s: settled after 4 s.
    assert rim_mps(samples)[-10:-1] - samples.speed_mps[-10:-1] == pytest.approx(-3.0, abs=0.02)
    # Let go, the rim is within 0.15 m/s of the train after 0.45 s (time constant 0.15 s).
    assert set(simulator.advance(300).slip[50:].tolist()) == {0}
