"""Alignments: curvature, cant, gradient and heading agree with each other and with closed forms; branches join on."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.line import Branch, ChainagePoint, Curve, Gradient, Line, SpeedLimit, Surroundings
from services.line.alignment import Alignment, alignment_of, routes
from services.line.built_in_file import built_in_line
from services.line.profile import cant_profile, curvature_profile, gradient_profile

DEMO = built_in_line("demo")
MAIN = alignment_of(DEMO)
ONTO = alignment_of(DEMO, "akaiwa")


def straight_line(**fields: object) -> Line:
    """2 km due north from the equator, without heights."""
    axis = tuple((10.0, 0.0001 * k, 0.0) for k in range(181))
    return msgspec.structs.replace(Line(id="x", name="x", axis=axis), **fields)


def curve(**fields: float) -> Curve:
    known = Curve(
        start_axis_m=100.0, end_axis_m=400.0, transition_in_m=50.0, transition_out_m=80.0, radius_m=-400.0, cant_mm=90.0
    )
    return msgspec.structs.replace(known, **fields)


def test_curvature_is_linear_in_clothoids_and_constant_in_the_arc() -> None:
    bend = curvature_profile([curve()])
    assert bend.at([99.0, 125.0, 150.0, 250.0, 320.0, 360.0, 401.0]) == pytest.approx(
        [0.0, -1 / 800, -1 / 400, -1 / 400, -1 / 400, -1 / 800, 0.0]
    )


def test_cant_is_positive_with_the_right_rail_high() -> None:
    right_hand = curve()
    assert cant_profile([right_hand]).at([125.0, 250.0]) == pytest.approx([-0.045, -0.09])
    assert cant_profile([curve(radius_m=400.0)]).at(250.0) == pytest.approx(0.09)
    against = msgspec.structs.replace(right_hand, high_rail="right")
    assert cant_profile([against]).at(250.0) == pytest.approx(0.09)


def test_cant_tilts_the_track_over_the_distance_of_its_rails() -> None:
    alignment = alignment_of(straight_line(curves=(curve(radius_m=400.0, cant_mm=113.2),)))
    # 1067 mm of gauge and 65 mm of rail head.
    assert float(alignment.cant_rad(250.0)) == pytest.approx(math.asin(0.1132 / 1.132))


def test_a_curve_without_transitions_steps() -> None:
    bend = curvature_profile([curve(transition_in_m=0.0, transition_out_m=0.0, radius_m=200.0)])
    assert bend.at([99.99, 100.01, 399.99, 400.01]) == pytest.approx([0.0, 1 / 200, 1 / 200, 0.0])


def test_vertical_curves_keep_the_height_of_the_kink() -> None:
    gradients = [Gradient(axis_m=0.0, permille=10.0), Gradient(axis_m=500.0, permille=-30.0, vertical_radius_m=2000.0)]
    profile = gradient_profile(gradients)
    assert profile.at([459.0, 480.0, 500.0, 541.0]) == pytest.approx([10.0, 0.0, -10.0, -30.0])
    along = np.arange(0.0, 1000.5, 0.5)
    rise_m = float(np.trapezoid(profile.at(along), along)) / 1000.0
    assert rise_m == pytest.approx(0.01 * 500.0 - 0.03 * 500.0, abs=1e-6)


def test_vertical_curves_never_overlap() -> None:
    gradients = [Gradient(axis_m=100.0 * k, permille=30.0 * (-1) ** k, vertical_radius_m=50_000.0) for k in range(5)]
    profile = gradient_profile(gradients)
    assert (np.diff(profile.axis_m) >= 0.0).all()
    assert profile.at([150.0, 250.0]) == pytest.approx([-30.0, 30.0], abs=1e-3)


@given(st.floats(0.0, MAIN.length_m), st.floats(0.0, 400.0))
def test_heading_turns_as_curvature_says(start_m: float, long_m: float) -> None:
    end_m = min(start_m + long_m, MAIN.length_m)
    along = np.linspace(start_m, end_m, 801)
    turned = float(np.trapezoid(MAIN.curvature_per_m(along), along))
    ends = MAIN.heading.at([start_m, end_m])
    # Headings are those of chords of 5 to 10 m, 5 m / (2 R 300 m) from the tangent; a chain of curves on the
    # ellipsoid turns against north by 0.1 mrad/km besides.
    assert float(ends[0] - ends[1]) == pytest.approx(turned, abs=0.012)


def test_positions_climb_as_gradients_say() -> None:
    along = np.arange(0.0, MAIN.length_m, 1.0)
    height = MAIN.position(along)[2]
    slope = MAIN.gradient_permille(along) / 1000.0
    climbed = np.concatenate([[0.0], np.cumsum((slope[1:] + slope[:-1]) / 2.0 / np.hypot(1.0, slope[1:]))])
    # Millimetres of rounded vertices, and 1 m steps across the ends of vertical curves.
    assert np.abs(height - height[0] - climbed).max() < 0.02


def test_places_are_true_metres_apart() -> None:
    along = np.arange(0.0, MAIN.length_m, 5.0)
    apart = np.linalg.norm(np.diff(MAIN.axis.at(along), axis=0), axis=1)
    # A corner between chords of 5 m at R 300 m shortens a step across it by 0.2 mm.
    assert np.abs(apart - 5.0).max() < 5e-4


def test_the_lowest_of_overlapping_limits_holds() -> None:
    limits = (
        SpeedLimit(start_axis_m=0.0, end_axis_m=1000.0, limit_mps=25.0),
        SpeedLimit(start_axis_m=400.0, end_axis_m=600.0, limit_mps=15.0),
    )
    alignment = alignment_of(straight_line(speed_limits=limits))
    assert alignment.speed_limit_mps([399.0, 500.0, 601.0, 1500.0]).tolist() == [25.0, 15.0, 25.0, math.inf]


def test_surroundings_are_found_by_place_and_by_kind() -> None:
    tunnel = Surroundings(kind="tunnel", start_axis_m=100.0, end_axis_m=200.0)
    alignment = alignment_of(straight_line(surroundings=(tunnel,)))
    assert alignment.surroundings(150.0) == (tunnel,)
    assert alignment.surroundings(250.0) == ()
    assert alignment.inside("tunnel", [99.0, 150.0, 201.0]).tolist() == [False, True, False]
    assert not alignment.inside("canyon", [150.0]).any()


def test_functions_of_place_keep_the_shape_asked_for() -> None:
    wanted = np.array([[100.0, 200.0, 300.0], [1.0, 2.0, 3.0]])
    for function in (
        MAIN.curvature_per_m,
        MAIN.gradient_permille,
        MAIN.cant_rad,
        MAIN.heading_rad,
        MAIN.speed_limit_mps,
    ):
        assert function(wanted).shape == (2, 3)
        assert function(5.0).shape == ()
    assert MAIN.position(wanted)[0].shape == (2, 3)


def test_without_stated_gradients_heights_give_them() -> None:
    axis = tuple((10.0, 0.0001 * k, 0.2211 * k) for k in range(181))
    alignment = alignment_of(Line(id="x", name="x", axis=axis))
    # 0.2211 m on 11.057 m of meridian; the axis counts the slope's length.
    assert float(alignment.gradient_permille(1000.0)) == pytest.approx(19.99, abs=0.02)


def test_a_branch_goes_on_from_its_junction() -> None:
    leaves_m = DEMO.branches[0].leaves_axis_m
    assert ONTO.junction_axis_m == leaves_m
    before = np.linspace(0.0, leaves_m - 5.0, 50)
    assert ONTO.axis.at(before) == pytest.approx(MAIN.axis.at(before))
    assert ONTO.curvature_per_m(before) == pytest.approx(MAIN.curvature_per_m(before))
    assert ONTO.gradient_permille(before) == pytest.approx(MAIN.gradient_permille(before))
    step = np.linalg.norm(np.diff(ONTO.axis.ecef_m, axis=0), axis=1)
    assert np.abs(step - np.diff(ONTO.axis.axis_m)).max() < 2e-3
    assert float(ONTO.curvature_per_m(leaves_m + 10.0)) == pytest.approx(1 / 250)
    assert float(MAIN.curvature_per_m(leaves_m + 10.0)) == 0.0


def test_kilometrage_of_a_branch_breaks_at_its_junction() -> None:
    leaves_m = DEMO.branches[0].leaves_axis_m
    assert float(ONTO.chainage.at(leaves_m - 100.0)) == pytest.approx(float(MAIN.chainage.at(leaves_m - 100.0)))
    assert float(ONTO.chainage.at(leaves_m)) == pytest.approx(0.0, abs=0.01)


def test_kilometrage_goes_on_where_a_branch_states_none() -> None:
    axis = tuple((10.0 + 0.0001 * k, 0.009, 0.0) for k in range(50))
    line = straight_line(
        chainage=(ChainagePoint(axis_m=0.0, chainage_m=9000.0), ChainagePoint(axis_m=1990.0, chainage_m=7010.0)),
        branches=(Branch(id="b", name="b", leaves_axis_m=995.2, side="right", axis=axis),),
    )
    onto = alignment_of(line, "b")
    assert onto.chainage.at([995.2, 1095.2]) == pytest.approx([8004.8, 7904.8])


def test_a_train_on_a_branch_meets_the_landmarks_of_its_way() -> None:
    leaves_m = DEMO.branches[0].leaves_axis_m
    assert {one.branch for one in ONTO.landmarks} == {"", "akaiwa"}
    assert all(
        one.exit_straight_end_m <= leaves_m for one in ONTO.landmarks if not one.branch and one.direction == "up"
    )
    assert not [one for one in MAIN.landmarks if one.branch]


def test_an_unknown_branch_is_named_with_those_there_are() -> None:
    assert routes(DEMO) == ("", "akaiwa")
    with pytest.raises(KeyError, match="no branch 'nowhere'; it has: akaiwa"):
        alignment_of(DEMO, "nowhere")


def test_alignments_are_made_of_whatever_decodes() -> None:
    odd = straight_line(
        curves=(curve(), curve(start_axis_m=50.0, end_axis_m=900.0), curve(start_axis_m=1500.0, end_axis_m=1400.0)),
        gradients=(Gradient(axis_m=900.0, permille=5.0), Gradient(axis_m=100.0, permille=-5.0)),
    )
    alignment: Alignment = alignment_of(odd)
    along = np.linspace(0.0, 2000.0, 500)
    assert np.isfinite(alignment.curvature_per_m(along)).all()
    assert np.isfinite(alignment.gradient_permille(along)).all()
