from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.simulator.correlator import Composite, composite


def one_reflection(
    amplitude: float, delay_chips: float, phase_cycles: float, spacing: float, *, direct: float = 1.0, rate: float = 0.0
) -> Composite:
    return composite(
        np.array([[direct, amplitude]]),
        np.array([[0.0, delay_chips]]),
        np.array([[0.0, phase_cycles]]),
        np.array([[0.0, rate]]),
        spacing_chips=spacing,
        averaging_s=0.1,
    )


@pytest.mark.parametrize(
    ("delay", "phase", "spacing", "error"),
    [
        (0.02, 0.0, 0.2, 0.5 * 0.02 / 1.5),  # near, in phase: a d / (1 + a)
        (0.02, 0.5, 0.2, -0.5 * 0.02 / 0.5),  # near, against: -a d / (1 - a)
        (0.4, 0.0, 0.2, 0.05),  # beyond: a s / 2
        (0.4, 0.5, 0.2, -0.05),
        (1.2, 0.0, 0.2, 0.0),  # more than a chip and half the spacing: nothing
        (0.6, 0.0, 1.0, 0.5 * 0.6 / 1.5),  # a wide correlator is near for longer
    ],
)
def test_one_reflection_gives_the_envelope(delay: float, phase: float, spacing: float, error: float) -> None:
    assert one_reflection(0.5, delay, phase, spacing).code_error_chips[0] == pytest.approx(error, abs=1e-12)


def test_without_reflections_nothing_is_wrong() -> None:
    clean = one_reflection(0.0, 0.0, 0.0, 0.2)
    assert clean.code_error_chips[0] == pytest.approx(0.0, abs=1e-15)
    assert (clean.carrier_excess_cycles[0], clean.amplitude[0]) == (0.0, 1.0)


def test_a_reflection_alone_is_tracked_where_it_is() -> None:
    alone = one_reflection(0.4, 0.13, 7.3, 0.2, direct=0.0, rate=3.0)
    assert alone.code_error_chips[0] == pytest.approx(0.13)
    assert alone.carrier_excess_cycles[0] == pytest.approx(7.3)
    assert alone.carrier_rate_hz[0] == pytest.approx(3.0)
    assert alone.amplitude[0] == pytest.approx(0.4)


def test_a_quarter_cycle_turns_the_carrier_by_the_angle_of_the_sum() -> None:
    turned = one_reflection(0.5, 1e-6, 0.25, 0.2)
    assert turned.carrier_excess_cycles[0] == pytest.approx(np.arctan(0.5) / (2 * np.pi), abs=1e-6)
    assert turned.amplitude[0] == pytest.approx(np.hypot(1.0, 0.5), abs=1e-6)


def test_what_turns_fast_is_averaged_away() -> None:
    # Ten whole turns within the averaging time of 0.1 s.
    assert one_reflection(0.5, 0.1, 0.0, 0.2, rate=100.0).code_error_chips[0] == pytest.approx(0.0, abs=1e-12)


def test_carrier_rate_is_how_fast_the_carrier_turns() -> None:
    step_s, rate = 1e-6, 0.7
    here, later = (one_reflection(0.5, 1e-9, phase, 0.2, rate=rate) for phase in (0.2, 0.2 + rate * step_s))
    change = (later.carrier_excess_cycles[0] - here.carrier_excess_cycles[0]) / step_s
    # A forward difference over a millionth of a second: 1e-6 of curvature, 1e-10 of rounding.
    assert here.carrier_rate_hz[0] == pytest.approx(change, abs=1e-5)


@given(
    amplitude=st.floats(0.05, 0.9),
    delay=st.floats(0.0, 1.5),
    phase=st.floats(0.0, 1.0),
    spacing=st.floats(0.05, 1.0),
)
def test_a_weaker_reflection_pulls_no_farther_than_the_envelope(
    amplitude: float, delay: float, phase: float, spacing: float
) -> None:
    error = abs(one_reflection(amplitude, delay, phase, spacing).code_error_chips[0])
    assert error <= amplitude * spacing / 2 / (1 - amplitude) + 1e-12


@given(amplitude=st.floats(0.05, 0.9), delay=st.floats(0.0, 1.2), phase=st.floats(0.0, 1.0))
def test_a_reflection_alone_never_shortens(amplitude: float, delay: float, phase: float) -> None:
    assert one_reflection(amplitude, delay, phase, 0.2, direct=0.0).code_error_chips[0] == pytest.approx(delay)
