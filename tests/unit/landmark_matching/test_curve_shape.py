"""Shapes of curves: Table 1, mirrored directions, averages and their crossings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.line import Curve, Landmark
from services.landmark_matching.curve_shape import (
    CurveShape,
    ShapeError,
    angle_rad,
    crossings,
    mean_curvature,
    shape_of_curve,
    shape_of_landmark,
)

TABLE_1 = Landmark(
    id="C1",
    direction="up",
    hand="left",
    radius_m=300.0,
    entry_straight_start_m=827.0,
    entry_straight_end_m=847.0,
    entry_lower_limit_m=881.0,
    exit_lower_limit_m=953.0,
    exit_straight_start_m=987.0,
    exit_straight_end_m=1007.0,
)
SHAPES = st.builds(
    lambda start, first, arc, last, radius, hand: CurveShape(
        start, start + first, start + first + arc, start + first + arc + last, hand / radius
    ),
    st.floats(-5000.0, 5000.0),
    st.floats(0.0, 90.0),
    st.floats(40.0, 400.0),
    st.floats(0.0, 90.0),
    st.floats(150.0, 900.0),
    st.sampled_from([-1.0, 1.0]),
)


def test_the_paper_s_table_implies_transitions_of_42_5_m() -> None:
    shape = shape_of_landmark(TABLE_1)
    assert (shape.start_m, shape.arc_start_m, shape.arc_end_m, shape.end_m) == (847.0, 889.5, 944.5, 987.0)
    assert shape.curvature_per_m == pytest.approx(1.0 / 300.0)


@pytest.mark.parametrize("field", ["entry_lower_limit_m", "exit_straight_end_m"])
def test_rows_out_of_order_are_refused_by_name(field: str) -> None:
    rows = {name: getattr(TABLE_1, name) for name in TABLE_1.__struct_fields__} | {field: 840.0}
    with pytest.raises(ShapeError, match="C1: its places are not in the order"):
        shape_of_landmark(Landmark(**rows))


def test_rows_that_leave_no_arc_are_refused() -> None:
    rows = {name: getattr(TABLE_1, name) for name in TABLE_1.__struct_fields__}
    with pytest.raises(ShapeError, match="no arc"):
        shape_of_landmark(Landmark(**(rows | {"exit_lower_limit_m": 882.0, "exit_straight_start_m": 960.0})))


def test_a_curve_seen_from_the_other_side_turns_the_other_way() -> None:
    curve = Curve(start_axis_m=100.0, end_axis_m=300.0, transition_in_m=40.0, transition_out_m=60.0, radius_m=400.0)
    up, down = shape_of_curve(curve, "up"), shape_of_curve(curve, "down")
    assert up.curvature_per_m == -down.curvature_per_m > 0.0
    assert (down.start_m, down.arc_start_m, down.arc_end_m, down.end_m) == (-300.0, -240.0, -140.0, -100.0)


@given(SHAPES)
def test_the_whole_curve_turns_by_arc_and_half_of_each_transition(shape: CurveShape) -> None:
    lengths = shape.arc_start_m - shape.start_m, shape.arc_end_m - shape.arc_start_m, shape.end_m - shape.arc_end_m
    wanted = shape.curvature_per_m * (0.5 * lengths[0] + lengths[1] + 0.5 * lengths[2])
    assert float(angle_rad(shape, shape.end_m + 1000.0)) == pytest.approx(wanted, rel=1e-9)
    assert float(angle_rad(shape, shape.start_m)) == 0.0


@given(SHAPES, st.floats(5.0, 39.0), st.floats(0.8, 1.2))
def test_crossings_lie_where_the_average_has_the_level(shape: CurveShape, window_m: float, scale: float) -> None:
    level = 0.75 * scale * abs(shape.curvature_per_m)
    found = crossings(shape, level, (window_m, window_m), scale)
    assert found is not None
    for crossing in found:
        size = scale * abs(float(mean_curvature(shape, crossing.u_m, window_m)))
        # the average bends over its window; between two places 0.5 m apart the chord errs by less than this
        assert size == pytest.approx(level, rel=0.02)


@given(SHAPES)
def test_a_vanishing_window_crosses_where_the_transition_does(shape: CurveShape) -> None:
    found = crossings(shape, 0.8 * abs(shape.curvature_per_m), (0.2, 0.2))
    assert found is not None
    entry_m = shape.start_m + 0.8 * (shape.arc_start_m - shape.start_m)
    exit_m = shape.end_m - 0.8 * (shape.end_m - shape.arc_end_m)
    # a step of the grid, where there is no transition
    assert found[0].u_m == pytest.approx(entry_m, abs=0.5)
    assert found[1].u_m == pytest.approx(exit_m, abs=0.5)


def test_a_window_longer_than_the_curve_never_reaches_the_level() -> None:
    shape = CurveShape(0.0, 20.0, 40.0, 60.0, 1.0 / 300.0)
    assert crossings(shape, 0.8 / 300.0, (80.0, 80.0)) is None


def test_an_average_is_the_mean_of_the_curvature() -> None:
    shape = shape_of_landmark(TABLE_1)
    u = np.linspace(880.0, 920.0, 40_001)
    knots = [shape.start_m, shape.arc_start_m, shape.arc_end_m, shape.end_m]
    curvature = np.interp(u, knots, [0.0, 1.0 / 300.0, 1.0 / 300.0, 0.0])
    assert float(mean_curvature(shape, 900.0, 40.0)) == pytest.approx(float(curvature.mean()), rel=1e-4)
