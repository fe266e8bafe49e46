from __future__ import annotations

import numpy as np
import pytest

from services.simulator.motion_settings import CONVENTIONAL
from services.simulator.random_track import TrackSettings, random_track
from services.simulator.track_table import TrackTable, felt_by, roughened
from tests.unit.simulator.motion_tracks import uniform_track


def drawn(permille: float = 16.0) -> TrackTable:
    settings = TrackSettings(length_m=20_000.0, irregularity=0.0, max_gradient_permille=permille)
    return random_track(settings, np.random.default_rng(3))


def test_the_way_back_is_the_same_track() -> None:
    track = drawn()
    there_and_back = track.reversed_way().reversed_way()
    for name in ("curvature_per_m", "slope", "roll_rad", "limit_mps", "stops_m"):
        assert np.allclose(getattr(there_and_back, name), getattr(track, name), atol=1e-9)
    # A left curve uphill is a right curve downhill to a train that comes the other way.
    assert track.reversed_way().curvature_per_m[0] == -track.curvature_per_m[-1]
    assert np.all(np.diff(track.reversed_way().stops_m) > 0)


def test_gradients_and_radii_stay_within_what_was_asked_for() -> None:
    track = drawn(33.0)
    assert np.abs(track.slope).max() <= 0.033 + 1e-12
    assert np.abs(track.slope).max() > 0.02
    assert np.abs(track.curvature_per_m).max() <= 1 / 300.0
    # Cant tilts the track towards the inside of the curve.
    curved = np.abs(track.curvature_per_m) > 1e-3
    assert np.all(np.sign(track.roll_rad[curved]) == -np.sign(track.curvature_per_m[curved]))


def test_limits_leave_no_more_lateral_acceleration_than_allowed() -> None:
    track = drawn()
    lateral = track.limit_mps**2 * np.abs(track.curvature_per_m) - 9.80665 * np.abs(np.sin(track.roll_rad))
    # In transitions cant and curvature grow together, so the arc is the worst place.
    assert lateral.max() <= 0.7 + 1e-9


def test_a_body_takes_the_mean_between_its_bogies() -> None:
    bend = np.zeros(401)
    bend[200:] = 1 / 300.0
    track = TrackTable(bend, bend * 0, bend * 0, np.full(401, 20.0), np.array([390.0]))
    felt = felt_by(track, CONVENTIONAL, 0.0, 0.6)
    # 14 m between bogies: the sudden curve is spread over as much, about the same place.
    rising = np.flatnonzero((felt[:, 0] > 1e-9) & (felt[:, 0] < 1 / 300.0 - 1e-9))
    assert len(rising) == 13
    assert 199 <= rising.mean() <= 201
    assert felt[:, 0].sum() == pytest.approx(bend.sum(), rel=0.01)
    behind = felt_by(track, CONVENTIONAL, 25.0, 0.6)
    assert np.allclose(behind[25:, 0], felt[:-25, 0])


def test_a_restriction_is_braked_for_and_holds_until_the_rear_end_is_past() -> None:
    limit = np.full(3001, 25.0)
    limit[1500:1600] = 10.0
    track = TrackTable(limit * 0, limit * 0, limit * 0, limit, np.array([2900.0]))
    allowed = felt_by(track, CONVENTIONAL, 0.0, 0.5)[:, 4]
    assert allowed[1500:1660].max() == 10.0
    assert allowed[1661] == 25.0
    # v² = v1² + 2 b s before it.
    assert allowed[1400] == pytest.approx(np.sqrt(100.0 + 2 * 0.5 * 100.0))
    assert np.all(np.diff(allowed[:1500] ** 2) >= -2 * 0.5 - 1e-9)


def test_irregularities_belong_to_the_track_and_have_the_stated_size() -> None:
    flat = uniform_track(length_m=20_000)
    one, same, other = (roughened(flat, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(one.slope, same.slope)
    assert not np.array_equal(one.slope, other.slope)
    assert one.slope.std() == pytest.approx(5e-4, rel=0.02)
    assert one.curvature_per_m.std() == pytest.approx(8e-6, rel=0.02)
    # They have no mean over long stretches: the line stays where it is.
    assert abs(one.slope.mean()) < 2e-5
    assert np.array_equal(roughened(flat, np.random.default_rng(1), 0.0).slope, flat.slope)
