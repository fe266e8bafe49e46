"""The robust filter: a plain Kalman filter where it must be one, and what it does with all that goes wrong."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.gnss import Epoch, Fix, Ionosphere
from services.gnss_correction import robust_prediction, robust_update
from services.gnss_correction.clock_jump import MILLISECOND_M
from services.gnss_correction.fix_messages import fixes_of
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.robust_noise import measurement_weight, urban_doppler_variance_m2ps2
from services.gnss_correction.robust_state import CLOCK, DRIFT, SIZE, VELOCITY, Memory, no_memory
from services.gnss_correction.settings import Config
from services.gnss_correction.solve_file import blocks
from services.gnss_receiver.observations import observations_of
from services.numerics.geodesy import ecef_from_geodetic, enu_about
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, START_S, constellation, measured

GPS = constellation()
NO_IONOSPHERE = Ionosphere(t_ns=0, alpha=(0.0, 0.0, 0.0, 0.0), beta=(0.0, 0.0, 0.0, 0.0))


def correction(config: Config | None = None) -> Correction:
    made = Correction(config or Config(), ("robust",))
    for one in GPS:
        made.add(one)
    return made


def standing(epochs: int, first: int = 0) -> list[Epoch]:
    """A standing receiver at 5 Hz whose clock drifts."""
    return [measured(GPS, START_S + 0.2 * k, clocks_m={"G": 20_000.0 + 6.0 * k}) for k in range(first, first + epochs)]


def shifted(epoch: Epoch, by_m: float, satellites: slice | int = slice(None)) -> Epoch:
    pseudorange = epoch.pseudorange_m.copy()
    pseudorange[satellites] += by_m
    return msgspec.structs.replace(epoch, pseudorange_m=pseudorange)


def emptied(epoch: Epoch) -> Epoch:
    """An epoch in a tunnel."""
    nothing = np.empty(0)
    return msgspec.structs.replace(
        epoch,
        satellites=(),
        signals=(),
        pseudorange_m=nothing,
        carrier_phase_cycles=nothing,
        doppler_hz=nothing,
        cn0_dbhz=nothing,
        lock_lost=np.empty(0, np.uint8),
    )


def solved(epochs: list[Epoch], config: Config | None = None) -> list[Fix]:
    made = correction(config)
    return [fixes_of(made.epoch(epoch), "robust")[0] for epoch in epochs]


def off_by_m(fix: Fix) -> float:
    """Horizontally."""
    place = enu_about(PLACE_DEG, fix.lat_deg or 0.0, fix.lon_deg or 0.0, fix.h_m or 0.0)
    return float(np.hypot(place[0], place[1]))


def bound_of(fix: Fix) -> float:
    assert fix.bound_m is not None
    return fix.bound_m


def any_covariance(generator: np.random.Generator) -> np.ndarray:
    root = generator.standard_normal((SIZE, SIZE))
    return root @ root.T + np.eye(SIZE)


def state_of(covariance: np.ndarray, generator: np.random.Generator) -> Memory:
    memory = no_memory()
    memory.covariance[:] = covariance
    memory.state[:] = generator.standard_normal(SIZE)
    memory.level[:] = np.eye(3)
    return memory


def test_prediction_is_the_one_of_the_textbook() -> None:
    generator = np.random.default_rng(1)
    memory = state_of(any_covariance(generator), generator)
    dt_s, density = 0.7, 1.3
    transition = np.eye(SIZE)
    transition[:3, VELOCITY:DRIFT] = dt_s * np.eye(3)
    transition[CLOCK:, DRIFT] = dt_s
    horizontal = density**2 * np.diag([1.0, 1.0, robust_prediction.CLIMB_SHARE**2])
    noise = np.zeros((SIZE, SIZE))
    noise[:3, :3] = horizontal * dt_s**3 / 3.0
    noise[:3, VELOCITY:DRIFT] = noise[VELOCITY:DRIFT, :3] = horizontal * dt_s**2 / 2.0
    noise[VELOCITY:DRIFT, VELOCITY:DRIFT] = horizontal * dt_s
    noise[DRIFT, DRIFT] = robust_prediction.DRIFT_NOISE_MPS**2 * dt_s
    noise[CLOCK:, CLOCK:] = robust_prediction.CLOCK_SIGMA_M**2
    noise[CLOCK:, CLOCK:] += np.eye(SIZE - CLOCK) * robust_prediction.OFFSET_NOISE_M**2 * dt_s
    state, covariance = transition @ memory.state, transition @ memory.covariance @ transition.T + noise
    robust_prediction.predict(memory, dt_s, density)
    # Rounding only.
    assert memory.state == pytest.approx(state, rel=1e-12)
    assert memory.covariance == pytest.approx(covariance, rel=1e-9, abs=1e-9)


def test_with_weights_at_one_an_update_is_that_of_the_kalman_filter() -> None:
    generator = np.random.default_rng(2)
    memory = state_of(any_covariance(generator), generator)
    prior, before = memory.state.copy(), memory.covariance.copy()
    made = correction().epoch(standing(1)[0])
    rows = made.solutions["robust"].rows[:6].copy()
    rows["rejection"] = 0
    rows["modelled_m"] = 0.0
    rows["range_rate_mps"] = np.nan
    rows["variance_m2"] = generator.uniform(1.0, 4.0, 6)
    partials = np.zeros((6, SIZE))
    partials[:, :3] = -np.stack([rows["line_x"], rows["line_y"], rows["line_z"]], axis=1)
    partials[:, CLOCK] = 1.0
    noise = np.diag(rows["variance_m2"])
    rows["pseudorange_m"] = prior[CLOCK] + generator.uniform(-0.5, 0.5, 6)
    innovation = rows["pseudorange_m"] - prior[CLOCK]
    gain = before @ partials.T @ np.linalg.inv(partials @ before @ partials.T + noise)
    memory.predicted[:] = prior
    assert robust_update.invert(memory.covariance, memory.normal, memory.information, memory.column)
    # No time passes, so that nothing is told of the climb; the convex weights are 1 for such small residuals.
    robust_update._take_prediction(memory, 0.0)
    for i in range(6):
        rows["residual_m"][i] = innovation[i]
        assert measurement_weight(innovation[i] ** 2 / rows["variance_m2"][i], robust=False) == 1.0
        robust_update._take_code(rows[i], 1.0 / rows["variance_m2"][i], memory)
    step = np.linalg.solve(memory.normal, memory.right)
    # Information and covariance form agree up to rounding in the inversions.
    assert step == pytest.approx(gain @ innovation, rel=1e-7, abs=1e-9)
    assert np.linalg.inv(memory.normal) == pytest.approx((np.eye(SIZE) - gain @ partials) @ before, rel=1e-6, abs=1e-8)


def test_weights_are_those_of_student_and_huber() -> None:
    assert measurement_weight(0.0, robust=True) == pytest.approx(1.25)
    assert measurement_weight(1.0, robust=True) == pytest.approx(1.0)
    assert measurement_weight(96.0, robust=True) == pytest.approx(0.05)
    assert measurement_weight(9.0, robust=False) == pytest.approx(0.5)


@given(st.floats(10.0, 60.0), st.floats(0.1, 10.0), st.floats(30.0, 55.0))
def test_a_weaker_signal_is_believed_less(strength_dbhz: float, weaker_db: float, strongest_dbhz: float) -> None:
    near, far = (
        urban_doppler_variance_m2ps2(one, strongest_dbhz) for one in (strength_dbhz, strength_dbhz - weaker_db)
    )
    assert far >= near


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_the_covariance_stays_symmetric_and_positive(seed: int) -> None:
    generator = np.random.default_rng(seed)
    made = correction()
    for epoch in standing(6):
        late = generator.standard_t(2, len(epoch.satellites)) * 20.0
        kept = generator.random(len(epoch.satellites)) < 0.6
        pseudorange = np.where(kept, epoch.pseudorange_m + late, np.nan)
        made.epoch(msgspec.structs.replace(epoch, pseudorange_m=pseudorange))
        covariance = made._robust._memory.covariance
        # A prediction without an update is symmetric up to rounding.
        assert covariance == pytest.approx(covariance.T, rel=1e-12, abs=1e-12)
        # Of a matrix with elements to 1e4 an eigenvalue of zero comes out as some 1e-9.
        assert np.linalg.eigvalsh(covariance).min() > -1e-6


def test_a_clean_drive_is_followed_within_its_bound() -> None:
    fixes = solved(standing(60))
    assert {fix.status for fix in fixes} == {"fix"}
    # The made-up sky is free of noise: what is left is numerical.
    assert max(off_by_m(fix) for fix in fixes) < 0.05
    assert all(bound_of(fix) > off_by_m(fix) for fix in fixes)
    assert bound_of(fixes[-1]) < bound_of(fixes[0])


def test_a_jump_of_a_millisecond_changes_nothing() -> None:
    smooth = standing(30)
    jumped = smooth[:15] + [
        # The same clock stamps the epochs.
        msgspec.structs.replace(shifted(epoch, MILLISECOND_M), tow_s=epoch.tow_s + 1e-3)
        for epoch in smooth[15:]
    ]
    for plain, other in zip(solved(smooth), solved(jumped), strict=True):
        # A millimetre: the state is carried to a stamp that lies a millisecond later.
        assert other.lat_deg == pytest.approx(plain.lat_deg, abs=1e-8)
        assert other.lon_deg == pytest.approx(plain.lon_deg, abs=1e-8)
        assert (other.status, other.reason) == ("fix", "")


def test_a_step_of_the_clock_that_is_no_millisecond_is_told() -> None:
    smooth = standing(20)
    fixes = solved(smooth[:10] + [shifted(epoch, 2_000.0) for epoch in smooth[10:]])
    assert "receiver clock stepped by +20" in fixes[10].reason
    assert fixes[9].reason == fixes[11].reason == ""
    assert off_by_m(fixes[-1]) < 0.1


@pytest.mark.parametrize("late_m", [100.0, 1_000.0, 100_000.0])
def test_one_satellite_that_is_late_moves_the_fix_little(late_m: float) -> None:
    smooth = standing(40)
    for satellite in range(len(smooth[0].satellites)):
        fixes = solved(smooth[:10] + [shifted(epoch, late_m, satellite) for epoch in smooth[10:]])
        # Its residual is tens of standard deviations: its weight falls with the square.
        assert max(off_by_m(fix) for fix in fixes) < 3.0
        assert all(off_by_m(fix) < bound_of(fix) for fix in fixes)
        assert fixes[-1].satellites_used == len(smooth[0].satellites) - 1


def test_two_satellites_that_are_late_are_both_left_out() -> None:
    smooth = standing(40)
    fixes = solved(smooth[:10] + [shifted(shifted(epoch, 80.0, 0), 150.0, 3) for epoch in smooth[10:]])
    assert max(off_by_m(fix) for fix in fixes) < 5.0
    assert fixes[-1].satellites_used == len(smooth[0].satellites) - 2


def test_in_a_tunnel_the_bound_grows_and_the_answer_is_predicted() -> None:
    epochs = standing(120)
    fixes = solved(epochs[:20] + [emptied(epoch) for epoch in epochs[20:]])
    inside = fixes[20:]
    assert {fix.status for fix in inside} == {"predicted"}
    assert all(fix.reason.startswith("predicted: 0 usable satellites") for fix in inside)
    bounds = [bound_of(fix) for fix in inside]
    assert bounds == sorted(bounds)
    # Twenty seconds of a vehicle that may brake or start: sqrt(20³/3) = 52 m times 2.5 times the factor.
    assert 400.0 < bounds[-1] < 800.0


@pytest.mark.parametrize("tunnel_s", [10.0, 60.0, 600.0])
@pytest.mark.parametrize("receiver", ["sends empty epochs", "is silent"])
def test_after_a_tunnel_the_first_epoch_is_a_fix(tunnel_s: float, receiver: str) -> None:
    after = round(tunnel_s * 5.0)
    inside = [emptied(epoch) for epoch in standing(after, 20)] if receiver == "sends empty epochs" else []
    fixes = solved(standing(20) + inside + standing(60, 20 + after))
    back = fixes[-60:]
    assert {fix.status for fix in back} == {"fix"}
    assert max(off_by_m(fix) for fix in back) < 0.1
    assert bound_of(back[0]) > bound_of(back[-1])


def test_before_the_first_solution_there_is_none() -> None:
    epochs = standing(3)
    fixes = solved([emptied(epochs[0]), emptied(epochs[1]), epochs[2]])
    assert [(fix.status, fix.bound_m is None) for fix in fixes] == [("none", True), ("none", True), ("fix", False)]
    assert "usable of 0 satellites" in fixes[0].reason


def test_a_consistent_move_against_doppler_is_told_and_covered() -> None:
    """All pseudoranges as a kilometre further north, as a repeater or a spoofer would have them."""
    lat_rad, lon_rad = np.radians(PLACE_DEG[0] + 1.0 / 111.0), np.radians(PLACE_DEG[1])
    north_m = np.array(ecef_from_geodetic(lat_rad, lon_rad, PLACE_DEG[2]))
    here = standing(20)
    there = [
        measured(GPS, START_S + 0.2 * k, clocks_m={"G": 20_000.0 + 6.0 * k}, place_m=north_m) for k in range(20, 120)
    ]
    fixes = solved(here + there)
    assert max(off_by_m(fix) for fix in fixes[20:30]) < 20.0
    told = [fix for fix in fixes if "moved by" in fix.reason]
    assert told
    first = fixes.index(told[0])
    # Some seconds of doubt, at 5 Hz.
    assert 20 < first < 60
    assert "against Doppler" in told[0].reason
    assert bound_of(told[0]) > off_by_m(told[0]) > 900.0


def test_blocks_and_single_epochs_agree_to_the_bit() -> None:
    epochs = standing(30)
    epochs[12:15] = [emptied(epoch) for epoch in epochs[12:15]]
    epochs[20] = shifted(epochs[20], 60.0, 2)
    made = correction()
    whole = [fix for block in blocks(observations_of(epochs)) for fix in fixes_of(made.block(block), "robust")]
    assert whole == solved(epochs)


def test_epochs_that_step_back_are_refused_until_time_really_did() -> None:
    epochs = standing(40)
    fixes = solved([*epochs[10:20], epochs[5], *epochs[20:30], *epochs[:8]])
    assert fixes[10].status == "none"
    assert "steps back" in fixes[10].reason
    assert [fix.status for fix in fixes[11:21]] == ["fix"] * 10
    assert fixes[-1].status == "fix"
    assert off_by_m(fixes[-1]) < 0.1


def test_with_a_broadcast_ionosphere_the_bound_is_tighter() -> None:
    without = correction()
    informed = correction()
    informed.add(NO_IONOSPHERE)
    (epoch,) = standing(1)
    (loose,), (tight,) = (fixes_of(one.epoch(epoch), "robust") for one in (without, informed))
    assert bound_of(tight) < bound_of(loose)
