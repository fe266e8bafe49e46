from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.simulator.paths import DIRECT, paths_to
from services.simulator.surroundings import Box, Surroundings

ANTENNA = np.array([0.0, 0.0, 4.0])
STILL = np.zeros(3)
WALL_M = 10.0
"""The facade of `wall` runs along the north side of the antenna, this far away, facing it."""


def wall(height_m: float = 30.0, length_m: float = 100.0, x_m: float = 0.0) -> Box:
    return Box(x_m, WALL_M + 5.0, 0.0, length_m, 10.0, 0.0, height_m, 0.5)


def towards(azimuth_deg: float, elevation_deg: float) -> NDArray[np.float64]:
    azimuth, elevation = np.deg2rad([azimuth_deg, elevation_deg])
    return np.array([[np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)]])


def hidden(boxes: list[Box], direction: NDArray[np.float64], origin: NDArray[np.float64] = ANTENNA) -> bool:
    scene = Surroundings(boxes)
    return bool(scene.hidden(scene.near(origin), origin[None, :], direction, np.array([np.inf]))[0])


def test_a_wall_hides_what_is_below_its_edge() -> None:
    edge_deg = np.rad2deg(np.arctan2(30.0 - 4.0, WALL_M))
    assert hidden([wall()], towards(0.0, edge_deg - 0.01))
    assert not hidden([wall()], towards(0.0, edge_deg + 0.01))
    assert not hidden([wall()], towards(180.0, 5.0))


def test_a_wall_ends_at_its_corners() -> None:
    corner_deg = np.rad2deg(np.arctan2(50.0, WALL_M))
    assert hidden([wall()], towards(corner_deg - 0.01, 5.0))
    assert not hidden([wall(height_m=20.0, length_m=100.0)], towards(np.rad2deg(np.arctan2(51.0, WALL_M)) + 8.0, 5.0))


def test_a_deck_hides_the_zenith_and_not_the_horizon() -> None:
    deck = Box(0.0, 0.0, 0.0, 20.0, 30.0, 7.0, 8.0, 0.0)
    assert hidden([deck], towards(90.0, 85.0))
    # Its underside is 3 m above the antenna and ends 10 m ahead, 16.7 degrees up.
    assert not hidden([deck], towards(90.0, 16.0))
    assert hidden([deck], towards(90.0, 18.0))


def test_boxes_far_away_are_left_out() -> None:
    far = Surroundings([wall(x_m=1000.0)])
    assert len(far.near(ANTENNA)) == 0
    paths = paths_to(far, ANTENNA, STILL, towards(0.0, 10.0))
    assert paths.reception() == ["line_of_sight"]


@pytest.mark.parametrize(("azimuth_deg", "elevation_deg"), [(180.0, 30.0), (200.0, 45.0), (150.0, 10.0)])
def test_the_mirror_image_gives_the_excess_path(azimuth_deg: float, elevation_deg: float) -> None:
    paths = paths_to(Surroundings([wall()]), ANTENNA, STILL, towards(azimuth_deg, elevation_deg))
    facing = np.deg2rad(azimuth_deg - 180.0)
    excess = 2 * WALL_M * np.cos(np.deg2rad(elevation_deg)) * np.cos(facing)
    assert paths.reception() == ["multipath"]
    assert paths.excess_m[0, 1] == pytest.approx(excess, rel=1e-12)
    assert paths.amplitude[0].tolist() == [1.0, 0.5, 0.0, 0.0, 0.0]
    assert paths.facade[0, 0] == DIRECT
    assert paths.facade[0, 1] != DIRECT


def test_a_facade_mirrors_only_where_it_stands() -> None:
    scene = Surroundings([wall(height_m=12.0)])
    # The reflection point lies at 4 m + 10 m tan(elevation): on the facade below 38.7 degrees.
    assert paths_to(scene, ANTENNA, STILL, towards(180.0, 38.0)).reception() == ["multipath"]
    assert paths_to(scene, ANTENNA, STILL, towards(180.0, 39.0)).reception() == ["line_of_sight"]


def test_between_two_walls_one_hides_and_the_other_mirrors() -> None:
    south = Box(0.0, -15.0, 0.0, 100.0, 10.0, 0.0, 15.0, 0.4)
    scene = Surroundings([wall(), south])
    # From the south at 40 degrees the southern wall (11 m above the antenna, 10 m away) hides the satellite and
    # the northern one would show it from 12.4 m up, where the wall opposite no longer reaches.
    assert paths_to(scene, ANTENNA, STILL, towards(180.0, 40.0)).reception() == ["reflected_only"]
    assert paths_to(scene, ANTENNA, STILL, towards(180.0, 10.0)).reception() == ["blocked"]


def test_excess_changes_as_the_antenna_moves() -> None:
    scene, direction = Surroundings([wall()]), towards(190.0, 35.0)
    velocity, step_s = np.array([3.0, 5.0, 0.0]), 1e-3
    here = paths_to(scene, ANTENNA, velocity, direction)
    later = paths_to(scene, ANTENNA + velocity * step_s, velocity, direction)
    change = (later.excess_m[0, 1] - here.excess_m[0, 1]) / step_s
    # The excess is linear in the antenna's place; the quotient loses nine digits to the step.
    assert here.excess_rate_mps[0, 1] == pytest.approx(change, abs=1e-9)
    assert change < 0


@given(
    azimuth=st.floats(0.0, 360.0),
    elevation=st.floats(5.0, 85.0),
    heading=st.floats(0.0, 3.0),
    height=st.floats(6.0, 60.0),
)
def test_reflections_are_longer_ways(azimuth: float, elevation: float, heading: float, height: float) -> None:
    boxes = [Box(20.0, 15.0, heading, 25.0, 12.0, 0.0, height, 0.6), Box(-25.0, 5.0, 1.0, 30.0, 10.0, 0.0, 40.0, 0.3)]
    paths = paths_to(Surroundings(boxes), ANTENNA, STILL, towards(azimuth, elevation))
    reflected = paths.amplitude[0, 1:] > 0
    assert (paths.excess_m[0, 1:][reflected] > 0).all()
    assert (np.diff(paths.amplitude[0, 1:]) <= 0).all()
