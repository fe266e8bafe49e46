"""Runs projected onto a line with a branch: right places, honest probabilities, no confusion at self-approaches."""

from __future__ import annotations

import numpy as np
import pytest

from schemas.line import Line, ParallelTrack
from services.line.alignment import alignment_of
from services.line.built_in_file import built_in_line
from services.line.route_projection import project_run, tracks_beside

DEMO = built_in_line("demo")
WAYS = (alignment_of(DEMO), alignment_of(DEMO, "akaiwa"))
JUNCTION_M = DEMO.branches[0].leaves_axis_m
METRES_PER_DEGREE = 111_000.0


def drive(way: int, places: np.ndarray, noise_m: float = 4.0, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Noisy latitudes and longitudes."""
    lat, lon, _ = WAYS[way].position(places)
    noise = np.random.default_rng(seed).normal(0.0, noise_m / METRES_PER_DEGREE, (2, len(places)))
    return lat + noise[0], lon + noise[1] / np.cos(np.radians(lat))


@pytest.mark.parametrize("way", [0, 1])
def test_a_drive_there_and_back_stays_on_its_route(way: int) -> None:
    there = np.arange(200.0, WAYS[way].length_m - 100.0, 15.0)
    places = np.concatenate([there, there[::-1]])
    found = project_run(WAYS, np.arange(len(places), dtype=float), *drive(way, places))
    # Five standard deviations of the noise along the track.
    assert np.abs(found.axis_m - places).max() < 20.0
    assert found.seeded.sum() == 1
    # 300 m behind the junction the branch is 20 m from the main line.
    apart = places > JUNCTION_M + 300.0
    assert (found.route[apart] == way).all()
    assert (found.probability[apart] > 0.9).all()
    assert (found.route[places < JUNCTION_M - 50.0] == 0).all()


def test_at_a_junction_neither_branch_is_certain() -> None:
    places = np.arange(JUNCTION_M - 300.0, JUNCTION_M + 40.0, 10.0)
    found = project_run(WAYS, np.arange(len(places), dtype=float), *drive(1, places, noise_m=1.0))
    behind = places > JUNCTION_M + 5.0
    # 40 m behind the toe of the turnout both are half a metre apart.
    assert (found.probability[behind] < 0.7).all()
    assert (found.probability[places < JUNCTION_M - 70.0] > 0.99).all()


def test_after_a_gap_everything_is_looked_for_anew() -> None:
    places = np.concatenate([np.arange(1000.0, 2000.0, 20.0), np.arange(9000.0, 10_000.0, 20.0)])
    t_s = np.arange(100.0)
    t_s[50:] += 200.0
    found = project_run(WAYS, t_s, *drive(0, places))
    assert np.flatnonzero(found.seeded).tolist() == [0, 50]
    assert np.abs(found.axis_m - places).max() < 20.0


def test_a_jump_without_a_gap_is_found_after_some_places() -> None:
    places = np.concatenate([np.arange(1000.0, 2000.0, 20.0), np.arange(20_000.0, 21_000.0, 20.0)])
    found = project_run(WAYS, np.arange(100.0), *drive(0, places))
    assert np.isnan(found.axis_m[50:55]).all()
    assert (found.route[50:55] == -1).all()
    assert np.abs(found.axis_m[55:] - places[55:]).max() < 20.0


def test_missing_and_wild_places_do_no_harm() -> None:
    places = np.arange(1000.0, 2000.0, 10.0)
    lat, lon = drive(0, places)
    lat[10:20] = np.nan
    lat[40], lon[40] = 0.0, 0.0
    found = project_run(WAYS, np.arange(100.0), lat, lon)
    assert np.isnan(found.axis_m[10:20]).all()
    assert np.isnan(found.axis_m[40])
    kept = np.isfinite(found.axis_m)
    assert kept.sum() == 89
    assert np.abs(found.axis_m - places)[kept].max() < 20.0


def test_a_line_that_nears_itself_is_not_confused() -> None:
    # 2 km to the east, a half circle, 2 km back 20 m beside.
    turn = np.linspace(-np.pi / 2, np.pi / 2, 60)
    east = np.concatenate([np.arange(0.0, 2000.0, 10.0), 2000.0 + 10.0 * np.cos(turn), np.arange(2000.0, -1.0, -10.0)])
    north = np.concatenate([np.zeros(200), 10.0 + 10.0 * np.sin(turn), np.full(201, 20.0)])
    axis = tuple((float(x), float(y), 0.0) for x, y in zip(east / 111_319.5, north / 110_574.3, strict=True))
    way = alignment_of(Line(id="h", name="h", axis=axis))
    places = np.arange(0.0, way.length_m, 10.0)
    lat, lon, _ = way.position(places)
    noise = np.random.default_rng(2).normal(0.0, 5.0 / METRES_PER_DEGREE, (2, len(places)))
    found = project_run((way,), np.arange(len(places), dtype=float), lat + noise[0], lon + noise[1])
    # The first places may be of either side; after 20 of them the distance of 20 m has told.
    assert np.abs(found.axis_m - places)[20:].max() < 30.0
    assert found.probability[0] < 1.0
    late = project_run((way,), np.arange(50.0), (lat + noise[0])[-50:], (lon + noise[1])[-50:])
    assert np.abs(late.axis_m - places[-50:])[20:].max() < 30.0


def test_after_a_short_gap_passages_side_by_side_are_both_possible() -> None:
    # 1.5 km to the east, a loop back, and on to the east 10 m beside: for a kilometre both passages are near.
    turn = np.linspace(0.0, np.pi, 61)[1:]
    east = [np.arange(0.0, 1501.0, 10.0), 1500.0 + 200.0 * np.sin(turn), np.arange(1490.0, 499.0, -10.0)]
    east += [500.0 - 205.0 * np.sin(turn), np.arange(510.0, 3000.0, 10.0)]
    north = [np.zeros(151), 200.0 - 200.0 * np.cos(turn), np.full(100, 400.0), 195.0 + 205.0 * np.cos(turn)]
    x, y = np.concatenate(east) / 111_319.5, np.concatenate([*north, np.full(249, -10.0)]) / 110_574.3
    axis = tuple((float(lon), float(lat), 0.0) for lon, lat in zip(x, y, strict=True))
    way = alignment_of(Line(id="o", name="o", axis=axis))
    for lost_s in (20, 26, 43):  # the first place of each is nearer to the wrong passage
        t_s = np.concatenate([np.arange(lost_s), np.arange(lost_s + 40.0, 250.0)])
        lat, lon, _ = way.position(15.0 * t_s)
        noise = np.random.default_rng(lost_s).normal(0.0, 6.0 / METRES_PER_DEGREE, (2, len(t_s)))
        found = project_run((way,), t_s, lat + noise[0], lon + noise[1])
        wrong = np.abs(found.axis_m - 15.0 * t_s) > 50.0
        assert wrong[lost_s]
        # Ten places count as one: after a few the right one is ahead, and until then neither is sure.
        assert not wrong[lost_s + 15 :].any()
        assert (found.probability[wrong] < 0.9).all()


def test_tracks_side_by_side_are_counted_not_guessed() -> None:
    line = Line(
        id="p",
        name="p",
        axis=((10.0, 0.0, 0.0), (10.02, 0.0, 0.0)),
        parallel_tracks=(ParallelTrack(id="t", start_axis_m=500.0, end_axis_m=900.0, aside_m=4.0),),
    )
    way = alignment_of(line)
    assert tracks_beside(way, [499.0, 500.0, 900.0, 901.0]).tolist() == [1, 2, 2, 1]
    lat, lon, _ = way.position(np.array([100.0, 700.0]))
    # Exactly on the parallel track, and yet undecided.
    found = project_run((way,), np.array([0.0, 30.0]), lat + 4.0 / METRES_PER_DEGREE, lon)
    assert found.tracks.tolist() == [1, 2]
    assert found.aside_m == pytest.approx(4.0, abs=0.1)


def test_alignments_of_other_lines_are_refused() -> None:
    other = alignment_of(Line(id="o", name="o", axis=((1.0, 1.0, 0.0), (1.01, 1.0, 0.0))))
    for ways in ((), (WAYS[0], other)):
        with pytest.raises(ValueError, match="of one line"):
            project_run(ways, [0.0], [35.0], [134.0])
