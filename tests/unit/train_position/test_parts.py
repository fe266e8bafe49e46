"""Estimate, routes, make-up, tables: each by closed-form values."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from schemas.line import Branch, ParallelTrack
from schemas.position import BranchEvidence, PositionEvent, Stretch, TrainChange
from services.odometry_fusion.picture_plot import save_picture
from services.train_position.branches import Branches
from services.train_position.claims import Interval
from services.train_position.estimate import Estimate
from services.train_position.evaluation import Passes, Positions, Truth, judge, margin_maxima
from services.train_position.instants import Instant
from services.train_position.keeper import PositionKeeper
from services.train_position.line_places import LinePlaces
from services.train_position.makeup import Makeup, Shift, changed
from services.train_position.margin_plot import draw_margin
from services.train_position.settings import AntennaPlace, Config
from services.train_position.table_file import TableError, read_table
from tests.unit.train_position.made_up import DEGREES, LENGTH_M, START_NS, Run, fix_of, run_with, straight_line


def instant(distance_m: float, **changes: float) -> Instant:
    t_ns = round(distance_m * 1e8)
    start = Instant(t_ns, distance_m, distance_m, distance_m, distance_m, distance_m, distance_m, 0, 0, 0, 10.0, 0.0)
    return start._replace(**changes)  # type: ignore[arg-type]  # fields of the instant by name


def test_an_estimate_is_the_weighted_mean_at_rest() -> None:
    estimate = Estimate(100.0, 2.0, 0.0, 0.0)
    estimate.measure(103.0, 1.0, instant(0.0), instant(0.0))
    # Weights 1/4 and 1.
    assert estimate.axis_m == pytest.approx((100.0 / 4.0 + 103.0) / 1.25)
    assert estimate.var_m2 == pytest.approx(1.0 / 1.25)


def test_a_late_measurement_moves_the_estimate_as_one_in_time() -> None:
    in_time, late = (Estimate(0.0, 2.0, 0.0, 0.01) for _ in range(2))
    start, later = instant(0.0), instant(500.0)
    in_time.measure(1.0, 1.0, start, start)
    in_time.move(start, later)
    late.move(start, later)
    late.measure(1.0, 1.0, start, later)
    # The scale walks by 1e-10 per metre, over 500 m 0.01 m² of the 29 m² that the late one weighs with.
    assert late.axis_m == pytest.approx(in_time.axis_m, abs=5e-3)
    assert late.var_m2 == pytest.approx(in_time.var_m2, rel=1e-2)


def test_coupling_ahead_moves_the_front_end() -> None:
    ahead = TrainChange(t_ns=0, kind="coupled", length_m=100.0, front_shift_m=40.0)
    makeup, shift = changed(Makeup(60.0, "A"), ahead)
    assert (makeup.length_m, makeup.front_m, shift) == (100.0, 40.0, Shift(40.0, 40.0))
    other, back = changed(makeup, TrainChange(t_ns=0, kind="cab", cab="B"))
    assert back == Shift(-100.0, -100.0)
    assert other.front_m == 0.0
    assert other.flips == 1


def test_coupling_that_says_nothing_may_have_happened_at_either_end() -> None:
    makeup, shift = changed(Makeup(60.0, "A"), TrainChange(t_ns=0, kind="coupled", length_m=100.0))
    assert shift == Shift(0.0, 40.0)
    assert makeup.doubt_m == 20.0


LEAVES = {"x": 1000.0, "y": 2000.0}


def test_routes_are_all_possible_until_something_tells() -> None:
    branches = Branches(LEAVES)
    span = Interval(900.0, 1050.0)
    assert branches.of(Interval(940.0, 960.0), span) == ""
    assert branches.of(Interval(1040.0, 1050.0), span) is None
    assert branches.occupied(span) == (
        Stretch(branch="", start_axis_m=900.0, end_axis_m=1050.0),
        Stretch(branch="x", start_axis_m=1000.0, end_axis_m=1050.0),
    )
    assert branches.decide("x", 1000.0, "curvature") == ""
    assert branches.occupied(span)[0] == Stretch(branch="", start_axis_m=900.0, end_axis_m=1000.0)
    assert branches.of(Interval(1040.0, 1050.0), span) == "x"


def test_evidence_for_the_main_line_excludes_what_leaves_there() -> None:
    branches = Branches(LEAVES)
    branches.decide("", 1000.0, "curvature")
    assert branches.possible == {"", "y"}


def test_a_route_comes_back_once_the_whole_train_is_before_its_junction() -> None:
    branches = Branches(LEAVES)
    branches.decide("x", 1000.0, "curvature")
    branches.passed(Interval(900.0, 1001.0))
    assert branches.possible == {"x"}
    branches.passed(Interval(900.0, 999.0))
    assert branches.possible == {"", "x", "y"}


def test_contradicting_evidence_leaves_both_until_a_third_tells() -> None:
    branches = Branches(LEAVES)
    branches.set_route("x", Interval(900.0, 960.0))
    branches.commit(Interval(990.0, 1050.0))
    assert branches.possible == {"x"}
    assert "against x" in branches.decide("", 1000.0, "curvature")
    assert branches.possible == {"", "x"}
    branches.decide("", 1000.0, "curvature")
    assert branches.possible == {"", "x"}, "the same source again is no further evidence"
    branches.decide("x", None, "reference")
    assert branches.possible == {"x"}
    assert branches.disputed == ""


def at_the_junction() -> Run:
    run = run_with(axis_m=19_900.0)
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    assert run.status() == "valid"
    run.go(15.0)
    return run


def test_undecided_at_a_junction_is_degraded_and_occupies_both() -> None:
    run = at_the_junction()
    position = run.position
    assert position.branch is None
    assert position.status == "degraded"
    assert "branch undecided" in position.reason
    assert {one.branch for one in position.occupied} == {"", "north"}
    run.hear(BranchEvidence(t_ns=run.t_ns, junction_axis_m=20_000.0, decided="north", chances=(), reason="curvature"))
    run.go(0.1)
    assert run.position.branch == "north"
    assert run.status() == "valid"
    assert [one.text for one in run.heard if isinstance(one, PositionEvent) and one.kind == "branch"] == ["on north"]


METRES = LENGTH_M / DEGREES
LOOP_M = ((0.0, 0.0), (30.0, 4.0), (900.0, 4.0))
"""Vertices: along the main line and aside of it."""
LOOP = Branch(
    id="loop",
    name="Loop",
    leaves_axis_m=20_000.0,
    side="left",
    axis=tuple((DEGREES / 2 + along_m / METRES, aside_m / METRES, 0.0) for along_m, aside_m in LOOP_M),
)


@pytest.mark.parametrize(
    ("decided", "route", "track"),
    [("loop", None, "loop-1"), ("", None, ""), (None, None, None), ("loop", "", None), ("loop", "loop-1", "loop-1")],
)
def test_curves_that_tell_the_branch_tell_the_parallel_track(
    decided: str | None, route: str | None, track: str | None
) -> None:
    parallel = ParallelTrack(id="loop-1", start_axis_m=20_050.0, end_axis_m=20_600.0, aside_m=4.0)
    line = msgspec.structs.replace(straight_line(), branches=(LOOP,), parallel_tracks=(parallel,))
    run = run_with(axis_m=19_900.0)
    run.keeper = PositionKeeper(run.keeper.held.config, LinePlaces(line))
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    if route is not None:
        # A way that is set, and of which only the track is told.
        run.keeper.held.track = route
    run.go(25.0)
    assert run.position.track == route
    told = BranchEvidence(t_ns=run.t_ns, junction_axis_m=20_000.0, decided=decided, chances=(), reason="curvature")
    run.hear(told)
    run.go(0.1)
    assert run.position.track == track
    # Behind the loop there is one track only.
    run.go(60.0)
    assert run.position.track is None


def test_a_line_file_out_of_its_days_is_told() -> None:
    # The made-up runs begin at 22:13 UTC on 14 November 2023.
    places = LinePlaces(msgspec.structs.replace(straight_line(), valid_from="2023-11-15"))
    for start_ns, status in ((START_NS, "degraded"), (START_NS + 7_200_000_000_000, "valid")):
        run = run_with(Config(facing="up", forward="vehicle"))
        run.keeper, run.t_ns = PositionKeeper(run.keeper.held.config, places), start_ns
        run.go(1.0)
        run.hear(run.front_end(0.0, 5.0))
        run.go(0.1)
        assert run.status() == status
        assert ("is valid from 2023-11-15 on" in run.position.reason) == (status == "degraded")
    # Files count from their own start.
    assert not places.unusable(60_000_000_000)


def test_a_route_set_before_decides() -> None:
    run = run_with(axis_m=19_500.0)
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.hear(TrainChange(t_ns=run.t_ns, kind="route", branch="north"))
    run.go(70.0)
    assert run.position.branch == "north"
    assert run.status() == "valid"


def test_satellites_tell_the_branch_by_what_is_aside() -> None:
    config = Config(antennas={"front": AntennaPlace()}, clock_bound_s=0.0, holdover=0.0, forward="vehicle")
    run = run_with(config, axis_m=19_900.0)
    run.go(10.0, 1.0)
    run.hear(fix_of(run, 0.0), "front")
    run.go(5.0)
    run.hear(fix_of(run, 0.0), "front")
    run.go(30.0)
    assert run.position.branch is None
    for _ in range(4):
        # On the main line, far east of where the branch has turned north by then.
        run.go(5.0)
        run.hear(fix_of(run, 0.0), "front")
    assert run.position.branch == ""
    run.require_true()


def test_teeth_of_the_saw() -> None:
    assert margin_maxima(np.arange(6.0), np.array([10.0, 20.0, 30.0, 5.0, 9.0, 12.0])) == (30.0, 12.0)


def saw() -> tuple[Positions, Truth]:
    t_s = np.arange(0.0, 100.0, 0.1)
    axis_m = 10.0 * t_s
    margin_m = 5.0 + (t_s % 25.0)
    positions = Positions(
        "saw",
        t_s,
        axis_m + 2.0,
        margin_m,
        np.where(t_s < 50.0, 1.0, margin_m),
        np.ones(1000),
        np.zeros(1000, bool),
        ("valid",) * 1000,
    )
    return positions, Truth(t_s, axis_m)


def test_errors_are_judged_against_the_bound_of_their_side() -> None:
    positions, truth = saw()
    found = judge(positions, truth)
    # The estimate is 2 m too far on, so that the truth is behind it: within 1 m half of the time, it is not.
    assert found.within_percent == pytest.approx(50.0)
    assert found.largest_excess_m == pytest.approx(1.0)
    assert found.median_error_m == pytest.approx(2.0)
    assert found.resets == 3
    assert found.median_of_maxima_m == pytest.approx(29.9)


def test_pictures_are_the_same_bytes_twice(tmp_path: Path) -> None:
    positions, truth = saw()
    for name in ("a.svg", "b.svg"):
        save_picture(tmp_path / name, draw_margin(positions, truth, Passes(np.array([25.0]), ("C1",))))
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    with pytest.raises(ValueError, match=r"\.png or \.svg"):
        save_picture(tmp_path / "a.gif", draw_margin(positions, truth))


def test_tables_name_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("t_s,axis_m\n1,2\n3,four\n")
    table = read_table(path, ("t_s", "axis_m"))
    with pytest.raises(TableError, match=r"t\.csv:3: axis_m is 'four'"):
        table.number(*table.rows[1], "axis_m")
    with pytest.raises(TableError, match="no column bound_m"):
        read_table(path, ("bound_m",))
