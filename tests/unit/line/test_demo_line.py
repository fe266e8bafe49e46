"""The demo line: what it must have, its vertices on the designed curves, and its landmarks."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from schemas.line import Line
from services.line.alignment import alignment_of
from services.line.built_in_file import built_in_line, built_in_names
from services.line.design import Element, LineDesign
from services.line.landmarks import landmarks_of
from services.line.line_building import curve_limit_mps, line_of
from services.line.line_check import problems_of
from services.line.line_json_file import line_text

DEMO = built_in_line("demo")
MAIN = alignment_of(DEMO)


def design(*elements: Element) -> LineDesign:
    return LineDesign(
        id="t",
        name="t",
        version="1",
        start_lat_deg=35.0,
        start_lon_deg=134.0,
        start_h_m=100.0,
        start_heading_deg=30.0,
        landmark_accuracy_m=1.0,
        highest_speed_mps=25.0,
        elements=elements,
    )


TABLE_1 = (
    Element(straight_m=847.0),
    Element(radius_m=300.0, arc_m=55.0, transition_m=42.5, cant_mm=90.0),
    Element(straight_m=400.0),
)


def test_it_has_all_that_a_railway_has() -> None:
    assert 24_000.0 < MAIN.length_m < 27_000.0
    assert len([one for one in DEMO.landmarks if one.direction == "up" and not one.branch]) >= 14
    assert max(one.permille for one in DEMO.gradients) == 35.0
    assert min(one.permille for one in DEMO.gradients) == -35.0
    tunnels = [one.end_axis_m - one.start_axis_m for one in DEMO.surroundings if one.kind == "tunnel"]
    assert max(tunnels) == pytest.approx(1200.0, abs=1.0)
    assert {"canyon", "cutting"} <= {one.kind for one in DEMO.surroundings}
    assert all(one.name_ja for one in DEMO.stations)
    assert len(DEMO.stations) == 8
    radios = np.array([one.axis_m for one in DEMO.radio_sites])
    assert np.diff(radios) == pytest.approx(2000.0, abs=1.0)
    assert 3_500.0 < alignment_of(DEMO, "akaiwa").length_m - DEMO.branches[0].leaves_axis_m < 4_500.0
    assert np.isfinite(MAIN.speed_limit_mps(np.arange(0.0, MAIN.length_m))).all()
    assert len(DEMO.chainage) - len({one.axis_m for one in DEMO.chainage}) == 2


def test_its_check_finds_nothing() -> None:
    assert problems_of(DEMO) == ()


def test_it_has_twins_that_a_single_curve_cannot_tell() -> None:
    twins = [one for one in DEMO.curves if 4000.0 < one.start_axis_m < 5000.0]
    assert [one.radius_m for one in twins] == [400.0, 405.0]
    assert twins[1].start_axis_m - twins[0].start_axis_m < 500.0


def test_building_it_twice_gives_the_same_bytes() -> None:
    assert line_text(built_in_line.__wrapped__("demo")) == line_text(DEMO)


def test_its_file_reads_back_as_it_was() -> None:
    assert msgspec.json.decode(line_text(DEMO), type=Line) == DEMO


def test_an_unknown_name_is_refused_with_those_there_are() -> None:
    assert "demo" in built_in_names()
    with pytest.raises(KeyError, match=r"these do: .*demo"):
        built_in_line("nowhere")


def test_vertices_of_an_arc_lie_on_its_circle() -> None:
    alignment = alignment_of(line_of(design(Element(radius_m=300.0, arc_m=400.0))))
    points = alignment.axis.plane_m
    # The circle through first, middle and last vertex.
    a, b, c = points[0], points[len(points) // 2], points[-1]
    matrix = 2.0 * np.array([b - a, c - a])
    centre = np.linalg.solve(matrix, [b @ b - a @ a, c @ c - a @ a])
    # Coordinates are rounded to 0.1 mm.
    assert np.hypot(*(points - centre).T) == pytest.approx(300.0, abs=1e-3)
    assert centre[0] < 0.0  # a heading of 30 degrees, turning left


def test_a_straight_is_one_on_the_ellipsoid() -> None:
    alignment = alignment_of(line_of(design(Element(straight_m=20_000.0))))
    across = alignment.axis.plane_m @ np.array([np.cos(np.radians(30.0)), -np.sin(np.radians(30.0))])
    # A geodesic is straight in the plane tangent at its start to below a millimetre over 20 km.
    assert np.abs(across).max() < 5e-3
    assert alignment.length_m == pytest.approx(20_000.0, abs=1e-3)


def test_a_clothoid_ends_where_its_series_does() -> None:
    elements = (Element(radius_m=300.0, arc_m=1.0, transition_m=100.0), Element(straight_m=10.0))
    made = line_of(msgspec.structs.replace(design(*elements), start_heading_deg=90.0))
    alignment = alignment_of(made)
    end = [float(np.interp(100.0, alignment.axis.axis_m, alignment.axis.plane_m[:, k])) for k in range(2)]
    # x = L - L³/(40 R²) + L⁵/(3456 R⁴), y = L²/(6 R) - L⁴/(336 R³); chords of 5 m are up to 0.1 mm each too short.
    assert end[0] == pytest.approx(100.0 - 100.0**3 / (40 * 300.0**2) + 100.0**5 / (3456 * 300.0**4), abs=3e-3)
    assert end[1] == pytest.approx(100.0**2 / 1800.0 - 100.0**4 / (336 * 300.0**3), abs=3e-3)


def test_speed_limits_balance_a_curve() -> None:
    limit = curve_limit_mps(300.0, 90.0, 1.067)
    assert limit * 3.6 == pytest.approx(70.0)
    # 140 mm of cant and deficiency over 1067 mm hold v²/(gR) at the speed itself, which is below one step more.
    assert limit**2 / (9.80665 * 300.0) <= 0.140 / 1.067 < (limit + 5 / 3.6) ** 2 / (9.80665 * 300.0)


def test_table_1_of_iwata_comes_out_for_both_directions() -> None:
    up, down = landmarks_of(alignment_of(line_of(design(*TABLE_1))), accuracy_m=1.0)
    rows = (
        "entry_straight_start_m",
        "entry_straight_end_m",
        "entry_lower_limit_m",
        "exit_lower_limit_m",
        "exit_straight_start_m",
        "exit_straight_end_m",
    )
    table = [827.0, 847.0, 881.0, 953.0, 987.0, 1007.0]
    # Chords shorten a curve of 140 m by below a centimetre.
    assert [getattr(up, name) for name in rows] == pytest.approx(table, abs=0.01)
    assert [getattr(down, name) for name in rows] == pytest.approx(table[::-1], abs=0.01)
    assert (up.hand, up.radius_m, down.hand) == ("left", 300.0, "right")


@pytest.mark.parametrize(
    "elements",
    [
        pytest.param(
            (
                Element(straight_m=100.0),
                Element(radius_m=300.0, arc_m=100.0, transition_m=50.0),
                Element(radius_m=-300.0, arc_m=100.0, transition_m=50.0),
                Element(straight_m=100.0),
            ),
            id="S-curve without a straight between",
        ),
        pytest.param((Element(radius_m=300.0, arc_m=100.0, transition_m=50.0),), id="no straights"),
        pytest.param(
            (Element(straight_m=99.0), Element(radius_m=1500.0, arc_m=300.0), Element(straight_m=99.0)), id="too flat"
        ),
        pytest.param(
            (Element(straight_m=99.0), Element(radius_m=300.0, arc_m=30.0), Element(straight_m=99.0)), id="too short"
        ),
    ],
)
def test_curves_that_cannot_be_diagnosed_are_no_landmarks(elements: tuple[Element, ...]) -> None:
    assert landmarks_of(alignment_of(line_of(design(*elements)))) == ()


def test_landmarks_cross_the_lower_limit_where_they_say() -> None:
    alignments = {"": MAIN, "akaiwa": alignment_of(DEMO, "akaiwa")}
    for one in DEMO.landmarks:
        bend = np.abs(alignments[one.branch].curvature_per_m([one.entry_lower_limit_m, one.exit_lower_limit_m]))
        # Places are rounded to a millimetre of a transition of 40 m or more.
        assert bend * one.radius_m == pytest.approx(0.8, abs=1e-3)


def test_elements_are_straight_or_curved() -> None:
    for wrong in ({}, {"straight_m": 10.0, "radius_m": 300.0}, {"radius_m": 0.0}):
        with pytest.raises(ValueError, match="either straight_m or a radius_m"):
            Element(**wrong)
