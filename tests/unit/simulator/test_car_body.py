from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.simulator.car_body import PITCH_RADPS, feel, suspend
from services.simulator.motion_settings import MotionSettings
from services.simulator.motion_state import STEP_S, fresh_state, vehicle_constants
from services.simulator.train_dynamics import GRAVITY

VEHICLE = vehicle_constants(MotionSettings())


def felt(
    speed: float = 0.0,
    acceleration: float = 0.0,
    *,
    curvature: float = 0.0,
    slope: float = 0.0,
    roll: float = 0.0,
    bend: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    state = fresh_state()
    state["speed_mps"], state["acceleration_mps2"] = speed, acceleration
    out = np.zeros(6)
    feel(state, np.array([curvature, slope, roll]), np.array(bend), out)
    return out


def test_at_rest_on_a_gradient_gravity_shows_along_the_body() -> None:
    out = felt(slope=0.035)
    assert out[:3] == pytest.approx([GRAVITY * 0.035, 0.0, GRAVITY * np.sqrt(1 - 0.035**2)])
    assert out[3:] == pytest.approx([0.0, 0.0, 0.0], abs=1e-15)


def test_a_left_curve_at_its_equilibrium_speed_pushes_nobody_sideways() -> None:
    # Textbook: tan(cant angle) = v² / (g R); the right rail is high, so the body rolls to the left (negative).
    radius, cant = 400.0, np.arcsin(0.09 / 1.132)
    speed = np.sqrt(GRAVITY * radius * np.tan(cant))
    out = felt(speed, curvature=1 / radius, roll=-cant)
    assert out[1] == pytest.approx(0.0, abs=1e-12)
    assert out[2] == pytest.approx(GRAVITY / np.cos(cant))
    # The turn about the vertical shows on z and, because of the cant, on y (Iwata et al., equation 5).
    turn = speed / radius
    assert out[4:] == pytest.approx([-turn * np.sin(cant), turn * np.cos(cant)])


def test_a_flat_left_curve_accelerates_to_the_left() -> None:
    out = felt(20.0, curvature=1 / 300.0)
    assert out[1] == pytest.approx(400.0 / 300.0)
    assert out[5] == pytest.approx(20.0 / 300.0)


def test_a_sag_lifts_the_nose_which_is_a_negative_rate_about_the_left() -> None:
    # A vertical curve of 3000 m at 25 m/s: pitch rate v/R, vertical acceleration v²/R.
    out = felt(25.0, bend=(0.0, 1 / 3000.0, 0.0))
    assert out[4] == pytest.approx(-25.0 / 3000.0)
    assert out[2] - GRAVITY == pytest.approx(625.0 / 3000.0)


def test_specific_force_is_acceleration_minus_gravity_in_every_attitude() -> None:
    # Without motion along a curve the vector's length is that of (a, g) whatever the roll.
    out = felt(0.0, 0.8, roll=0.1)
    assert np.hypot(out[1], out[2]) == pytest.approx(GRAVITY)
    assert out[0] == pytest.approx(0.8)


@given(
    speed=st.floats(0.0, 40.0),
    curvature=st.floats(-0.004, 0.004),
    roll=st.floats(-0.12, 0.12),
    slope=st.floats(-0.04, 0.04),
)
def test_pitch_rate_is_found_again_from_pitch_and_yaw_rates(
    speed: float, curvature: float, roll: float, slope: float
) -> None:
    bend = 1 / 3000.0
    out = felt(speed, curvature=curvature, roll=roll, slope=slope, bend=(0.0, bend, 0.0))
    # Iwata et al., equation (5), with the pitch rate counting upwards; exact up to cos(roll).
    upwards = -out[4] * np.cos(roll) + out[5] * np.sin(roll)
    assert upwards == pytest.approx(speed * bend, abs=1e-12)


@given(speed=st.floats(0.0, 40.0), curvature=st.floats(-0.004, 0.004), roll=st.floats(-0.12, 0.12))
def test_the_mirrored_curve_feels_mirrored(speed: float, curvature: float, roll: float) -> None:
    one, other = felt(speed, curvature=curvature, roll=roll), felt(speed, curvature=-curvature, roll=-roll)
    assert other == pytest.approx(one * np.array([1, -1, 1, -1, 1, -1]), abs=1e-12)


def test_the_body_settles_where_acceleration_and_cant_deficiency_push_it() -> None:
    state = fresh_state()
    state["speed_mps"], state["acceleration_mps2"] = 20.0, 0.5
    row, still = np.array([1 / 400.0, 0.0, 0.0]), np.zeros(2)
    for _ in range(round(15.0 / STEP_S)):
        suspend(state, row, 1.0, still, VEHICLE)
    # After 15 s the oscillation has died to exp(-0.25 * 2 pi * 0.8 * 15) = 7e-9 of its start.
    assert state["pitch_rad"][0] == pytest.approx(0.5 * VEHICLE.pitch_per_mps2, rel=1e-6)
    assert state["roll_rad"][0] == pytest.approx(VEHICLE.roll_flexibility * 1.0 / GRAVITY, rel=1e-6)


def test_the_track_shakes_the_body_by_as_much_as_stated() -> None:
    state = fresh_state()
    state["speed_mps"] = 20.0
    noise = np.random.default_rng(1).standard_normal((200_000, 2))
    rates, angles = np.empty(len(noise)), np.empty(len(noise))
    for k, draws in enumerate(noise):
        suspend(state, np.zeros(3), 1.0, draws, VEHICLE)
        rates[k], angles[k] = state["pitch_radps"][0], state["pitch_rad"][0]
    # 2000 s of a resonance of 0.9 s: 1000 independent values give the deviation to 3 %; the step of 10 ms adds
    # some per cent more.
    assert rates.std() == pytest.approx(0.0025, rel=0.12)
    crossings = np.count_nonzero(np.diff(np.sign(angles))) / 2 / (len(angles) * STEP_S)
    assert crossings == pytest.approx(PITCH_RADPS / (2 * np.pi), rel=0.1)
