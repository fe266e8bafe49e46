"""The paper's method over whole made-up runs: slips met, bounds held, faults survived, files and live alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.odometry_fusion.methods import begin, run_log
from services.odometry_fusion.motion_log import DEGRADED, LOST, VALID, Floats, MotionLog, MotionRows, columns_of
from services.odometry_fusion.paper_settings import PaperSettings, PitchCorrection
from services.odometry_fusion.settings import Config

G = 9.80665
STEP_S = 0.01
CONFIG = Config(method="paper")


def run_of(
    *, gradient: float = 0.0, turn: float = 0.0, slip_mps: float = 0.0, late_s: float = 0.3, ramp_s: float = 60.0
) -> tuple[MotionLog, Floats, Floats]:
    """A run of 150 s with its true times and distances: 10 s at rest, up to 18 m/s, on, to rest again.

    From `ramp_s` on the track rises by `gradient` and turns by `turn` [1/m] with 0.08 rad of cant; from 70 s to 78 s
    the wheel slides by up to `slip_mps` (spins where it is negative).
    """
    t_s = np.arange(0.0, 150.0, STEP_S)
    forward_mps2 = np.interp(t_s, [10, 11, 39, 40, 100, 101, 123, 125], [0, 0.62, 0.62, 0, 0, -0.73, -0.73, 0])
    speed_mps = np.maximum(np.cumsum(forward_mps2) * STEP_S, 0.0)
    speed_mps[t_s > 120.0] = np.maximum(speed_mps[t_s > 120.0], 0.0)
    forward_mps2 = np.gradient(speed_mps, STEP_S)
    distance_m = np.cumsum(speed_mps) * STEP_S
    ramp = np.clip((t_s - ramp_s) / 5.0, 0.0, 1.0)
    pitch, roll = gradient * ramp, -np.sign(turn) * 0.08 * ramp
    yaw = turn * ramp * speed_mps
    pitch_rate = np.gradient(pitch, STEP_S) - yaw * np.sin(roll)
    rng = np.random.default_rng(1)
    imu = np.column_stack([
        forward_mps2 + G * np.sin(pitch),
        speed_mps * yaw + G * np.sin(roll),
        np.full(len(t_s), G),
        np.gradient(roll, STEP_S),
        -pitch_rate,
        yaw,
    ])  # fmt: skip
    imu += rng.normal(0.0, 1.0, imu.shape) * np.array([0.05] * 3 + [0.0008] * 3) + np.array([0.01] * 3 + [2e-4] * 3)
    slip = slip_mps * np.interp(t_s, [70, 73, 76, 78], [0, 1, 1, 0])
    turned_m = np.cumsum(np.where(speed_mps > 0.0, np.maximum(speed_mps - slip, 0.0), 0.0)) * STEP_S
    late = round(late_s / STEP_S)
    imu = np.vstack([np.repeat(imu[:1], late, axis=0), imu[: len(imu) - late]])
    at = slice(9, None, 10)
    pulses = np.floor(turned_m[at] / (np.pi * 0.816 / 90.0)).astype(np.int64)
    return MotionLog(t_s, imu, t_s[at], pulses, 90.0, 0.816, late_s, 35.0), t_s, distance_m


def errors_of(rows: MotionRows, t_s: Floats, distance_m: Floats) -> Floats:
    true_m = np.interp(rows.t_s, t_s, distance_m)
    error_m: Floats = rows.distance_m - rows.distance_m[0] - (true_m - true_m[0])
    return error_m


def paper(log: MotionLog, **changes: object) -> MotionRows:
    settings_ = PaperSettings(**changes)  # type: ignore[arg-type]  # tests name settings
    return run_log(log, Config(method="paper", paper=settings_))


@pytest.mark.parametrize("slip_mps", [4.0, -4.0])
@pytest.mark.parametrize(("gradient", "turn"), [(0.0, 0.0), (0.03, 0.0025), (-0.03, -0.0025)])
def test_a_slip_on_gradient_and_curve_is_corrected(slip_mps: float, gradient: float, turn: float) -> None:
    log, t_s, distance_m = run_of(gradient=gradient, turn=turn, slip_mps=slip_mps)
    rows = run_log(log, CONFIG)
    # 8 s of slip cost the wheel 22 m; the gyros are good to 0.01 °/s here, which is 0.1 m in ten seconds, the start
    # point's acceleration to 0.03 m/s², which is 2 m.
    assert abs(errors_of(rows, t_s, distance_m)[-1]) < 3.0
    assert (np.abs(errors_of(rows, t_s, distance_m)) <= rows.bound_m).all()
    sign = -1 if slip_mps > 0.0 else 1
    assert [(one.phase, one.slip) for one in rows.episodes] == [("began", sign), ("ended", sign)]
    assert set(rows.slip[(rows.t_s > 73.0) & (rows.t_s < 77.0)].tolist()) == {sign}
    assert not rows.slip[(rows.t_s < 70.0) | (rows.t_s > 86.0)].any()


@pytest.mark.parametrize("wrong", ["none", "constant"])
def test_without_its_correction_the_pitch_fails_in_a_curve_on_a_gradient(wrong: PitchCorrection) -> None:
    log, t_s, distance_m = run_of(gradient=0.03, turn=0.006, slip_mps=5.0, ramp_s=68.0)
    right = abs(errors_of(paper(log), t_s, distance_m)[-1])
    worse = abs(errors_of(paper(log, pitch_correction=wrong), t_s, distance_m)[-1])
    # The slip begins within the transition into the gradient, where the start point shows half of its change.
    assert right < 4.0
    # ωz sin ψ = 0.0086 rad/s tilts by 5° in ten seconds; a gradient of 30 ‰ that is missed costs 0.3 m/s².
    assert worse > right + 5.0


def test_equation_12_changes_little() -> None:
    log, t_s, distance_m = run_of(gradient=0.02, turn=0.003, slip_mps=5.0)
    found = [errors_of(paper(log, pitch_correction=one), t_s, distance_m)[-1] for one in ("yaw", "yaw_and_roll")]
    # Its term is of second order: ωx sin ψ is at most 0.0013 rad/s for the five seconds of a transition.
    assert abs(found[0] - found[1]) < 3.0


def test_several_start_points_survive_a_slip_that_creeps_in() -> None:
    log, t_s, distance_m = run_of()
    slip = 4.0 * np.interp(log.tacho_t_s, [72, 82, 84], [0, 1, 0])
    pulses = log.pulses - np.floor(np.cumsum(slip) * 0.1 / (np.pi * 0.816 / 90.0)).astype(np.int64)
    creeping = replace(log, pulses=pulses)
    several, one = paper(creeping), paper(creeping, start_points=1)
    # It builds up by 0.4 m/s², below Ta: only its end is seen, when every late start point lies in the slip.
    assert abs(errors_of(several, t_s, distance_m)[-1]) < 5.0
    assert abs(errors_of(one, t_s, distance_m)[-1]) > 20.0
    assert (np.abs(errors_of(several, t_s, distance_m)) <= several.bound_m).all()


def test_re_adhesion_that_is_not_found_demands_a_stop() -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0)
    stuck = np.where(log.tacho_t_s < 70.0, log.pulses, log.pulses[np.searchsorted(log.tacho_t_s, 70.0)])
    rows = paper(replace(log, pulses=stuck), longest_correction_s=10.0)
    lost = [one for one in rows.episodes if one.phase == "not_found"]
    assert len(lost) == 1
    assert lost[0].stop_demanded
    late = (rows.t_s > lost[0].t_s) & ~rows.standstill
    assert (rows.status[late] >= DEGRADED).all()
    assert (np.abs(errors_of(rows, t_s, distance_m)) <= rows.bound_m).all()


def without(log: MotionLog, first_s: float, last_s: float, *, imu: bool, tacho: bool) -> MotionLog:
    kept = (log.imu_t_s < first_s) | (log.imu_t_s > last_s) | (not imu)
    counted = (log.tacho_t_s < first_s) | (log.tacho_t_s > last_s) | (not tacho)
    return replace(
        log,
        imu_t_s=log.imu_t_s[kept],
        imu=log.imu[kept],
        tacho_t_s=log.tacho_t_s[counted],
        pulses=log.pulses[counted],
    )


def swapped(log: MotionLog, order: list[int], signs: list[float]) -> MotionLog:
    places = [*order, *(3 + one for one in order)]
    return replace(log, imu=np.ascontiguousarray(log.imu[:, places] * np.array(signs * 2)))


def stopped(log: MotionLog, first_s: float) -> MotionLog:
    return replace(log, pulses=np.minimum(log.pulses, log.pulses[np.searchsorted(log.tacho_t_s, first_s)]))


def reset(log: MotionLog) -> MotionLog:
    begun = log.tacho_t_s >= 80.0
    return replace(log, pulses=np.where(begun, log.pulses - log.pulses[np.flatnonzero(begun)[0]], log.pulses))


def frozen(log: MotionLog) -> MotionLog:
    imu = log.imu.copy()
    still = (log.imu_t_s > 80.0) & (log.imu_t_s < 95.0)
    imu[still] = imu[np.flatnonzero(still)[0]]
    return replace(log, imu=imu)


FAULTS: dict[str, tuple[Callable[[MotionLog], MotionLog], int]] = {
    "inertial sensor away": (lambda log: without(log, 85.0, 95.0, imu=True, tacho=False), DEGRADED),
    "pulses away": (lambda log: without(log, 85.0, 95.0, imu=False, tacho=True), DEGRADED),
    "both away": (lambda log: without(log, 85.0, 95.0, imu=True, tacho=True), LOST),
    "inertial sensor frozen": (frozen, DEGRADED),
    "x and y swapped": (lambda log: swapped(log, [1, 0, 2], [1.0, 1.0, 1.0]), DEGRADED),
    "mounted backwards": (lambda log: swapped(log, [0, 1, 2], [-1.0, -1.0, 1.0]), DEGRADED),
    "mounted upside down": (lambda log: swapped(log, [0, 1, 2], [1.0, -1.0, -1.0]), DEGRADED),
    "counter stops under way": (lambda log: stopped(log, 80.0), DEGRADED),
    "counter begins anew": (reset, VALID),
    "counter of 16 bits": (lambda log: replace(log, pulses=(log.pulses + 65_000) % 65_536), VALID),
    "not a number": (lambda log: replace(log, imu=np.where(log.imu_t_s[:, None] % 1.0 < 0.05, np.nan, log.imu)), VALID),
    "struck by lightning": (
        lambda log: replace(log, imu=np.where(log.imu_t_s[:, None] % 7.0 < 0.02, 1e9, log.imu)),
        VALID,
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_told_and_the_bound_holds(fault: str) -> None:
    log, t_s, distance_m = run_of(gradient=0.01)
    break_it, worst = FAULTS[fault]
    rows = run_log(break_it(log), CONFIG)
    assert len(rows) == 1500
    for name in ("t_s", "distance_m", "way_m", "speed_mps", "speed_bound_mps", "bound_m", "excess_m", "provisional_m"):
        assert np.isfinite(columns_of(rows)[name].astype(np.float64)).all(), name
    assert rows.status.max() == worst
    assert all(rows.reasons[code] for code in set(rows.reason[rows.status > VALID].tolist()))
    assert (np.diff(rows.excess_m) >= 0.0).all()
    error_m = np.abs(errors_of(rows, t_s, distance_m))
    # A sensor mounted wrongly shows it at the first departure; the seconds in which it did not yet are excused.
    judged = rows.t_s > (20.0 if "swapped" in fault or "backwards" in fault else 0.0)
    assert (error_m <= rows.bound_m)[judged].all()


@settings(max_examples=12, deadline=None)  # every example is a whole run
@given(st.lists(st.floats(0.05, 149.0), min_size=1, max_size=12), st.sampled_from(["paper", "wheel"]))
def test_rows_do_not_depend_on_how_samples_are_cut(cuts: list[float], method: str) -> None:
    log, _, _ = run_of(gradient=0.01, slip_mps=4.0)
    config = Config(method=method)  # type: ignore[arg-type]  # one of the two above
    whole = run_log(log, config)
    step = begin(log.vehicle, config)
    parts: list[MotionRows] = []
    ends = [*sorted(set(cuts)), log.end_s]
    for first_s, last_s in zip([-1.0, *ends[:-1]], ends, strict=True):
        imu = (log.imu_t_s > first_s) & (log.imu_t_s <= last_s)
        tacho = (log.tacho_t_s > first_s) & (log.tacho_t_s <= last_s)
        parts.append(step.advance(last_s, log.imu_t_s[imu], log.imu[imu], log.tacho_t_s[tacho], log.pulses[tacho]))
    for name, column in columns_of(whole).items():
        joined = np.concatenate([columns_of(part)[name] for part in parts])
        # The same operations in the same order: the same bits.
        assert np.array_equal(column, joined, equal_nan=True), name
    assert whole.episodes == tuple(one for part in parts for one in part.episodes)


@settings(max_examples=8, deadline=None)  # every example is a whole run
@given(st.floats(20.0, 140.0))
def test_a_row_knows_nothing_of_later_samples(cut_s: float) -> None:
    log, _, _ = run_of(slip_mps=4.0)
    whole = run_log(log, CONFIG)
    imu, tacho = log.imu_t_s <= cut_s, log.tacho_t_s <= cut_s
    early = run_log(
        replace(
            log,
            imu_t_s=log.imu_t_s[imu],
            imu=log.imu[imu],
            tacho_t_s=log.tacho_t_s[tacho],
            pulses=log.pulses[tacho],
        ),
        CONFIG,
    )
    shared = min(len(early), int((whole.t_s <= cut_s - 0.1).sum()))
    assert shared > 100
    assert np.array_equal(early.distance_m[:shared], whole.distance_m[:shared])
    assert np.array_equal(early.bound_m[:shared], whole.bound_m[:shared])


def test_biases_are_learned_at_rest_and_remembered() -> None:
    log, _, _ = run_of()
    step = begin(log.vehicle, CONFIG)
    assert step.remembered() is None
    rows = step.advance(log.end_s, log.imu_t_s, log.imu, log.tacho_t_s, log.pulses)
    known = step.remembered()
    assert known is not None
    # 2e-4 rad/s was put in; 20 s of 0.0008 rad/s noise leave 2e-5.
    assert known.yaw_bias_radps == pytest.approx(2e-4, abs=6e-5)
    assert known.pitch_bias_radps == pytest.approx(2e-4, abs=6e-5)
    assert rows.standstill[(rows.t_s > 4.0) & (rows.t_s < 9.0)].all()
    assert rows.since_standstill_s[rows.t_s < 9.0][-1] == 0.0


def backwards(log: MotionLog) -> MotionLog:
    """The same run in the other direction: what points forward and about the axes across and along is negated."""
    return replace(log, pulses=-log.pulses, imu=log.imu * np.array([-1.0, 1.0, 1.0, -1.0, 1.0, 1.0]))


def test_running_backwards_is_told_by_a_counter_that_can() -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0)
    rows = run_log(backwards(log), CONFIG)
    error_m = errors_of(rows, t_s, -distance_m)
    assert (np.abs(error_m) <= rows.bound_m).all()
    assert abs(error_m[-1]) < 3.0
    assert rows.status.max() == VALID
    assert rows.way_m[-1] == pytest.approx(distance_m[-1], abs=10.0)  # the wheel's speed sums up its slip, too


def test_the_curvature_is_that_of_the_track_with_its_own_distance() -> None:
    log, t_s, distance_m = run_of(turn=-0.0025)
    rows = run_log(log, CONFIG)
    inside = (rows.t_s > 75.0) & (rows.t_s < 98.0)
    # 0.0008 rad/s of noise over 200 samples and 18 m/s leave 3e-6 1/m.
    assert rows.curvature_per_m[inside] == pytest.approx(-0.0025, abs=3e-5)
    lag_m = rows.distance_m[inside] - rows.curvature_distance_m[inside]
    assert lag_m == pytest.approx(18.0 * 1.3, abs=0.5)  # half of 2 s and the sensor's 0.3 s, at 18 m/s
    assert np.isnan(rows.curvature_per_m[rows.t_s < 12.0]).all()
    assert np.abs(errors_of(rows, t_s, distance_m)).max() < 3.0


def test_the_wheel_alone_owns_up_to_what_a_slip_costs() -> None:
    log, t_s, distance_m = run_of(slip_mps=4.0)
    rows = run_log(log, Config(method="wheel"))
    error_m = errors_of(rows, t_s, distance_m)
    assert error_m[-1] == pytest.approx(-22.0, abs=1.5)  # 4 m/s for 5.5 s, to a pulse or two and 0.1 s
    assert (np.abs(error_m) <= rows.bound_m).all()
