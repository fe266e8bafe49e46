"""What survives a restart, and what must be confirmed afterwards."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from schemas.position import TrainChange
from services.train_position.keeper import PositionKeeper
from services.train_position.line_places import LinePlaces
from services.train_position.position_store import StoreError, read_snapshot, state_file, write_snapshot
from services.train_position.settings import Config
from services.train_position.snapshot import Snapshot
from tests.unit.train_position.made_up import Run, run_with, straight_line

CONFIG = Config(clock_bound_s=0.0, holdover=0.0, line_accuracy_m=0.0, forward="vehicle")


def running() -> Run:
    run = run_with(CONFIG, wheel_error=0.01)
    run.go(10.0, 1.0)
    run.hear(run.front_end(0.0, 5.0))
    run.hear(run.landmark("C1", 1.0, 4.0))
    run.go(20.0)
    return run


def kept_of(run: Run) -> Snapshot:
    kept = run.keeper.snapshot()
    assert kept is not None
    return msgspec.json.decode(msgspec.json.encode(kept), type=Snapshot)


def restarted(run: Run, kept: Snapshot, line: LinePlaces | None = None) -> None:
    run.keeper = PositionKeeper(CONFIG, line or run.keeper.held.line, kept)


def test_the_odometry_bridges_a_restart() -> None:
    run = running()
    before_m = run.position.bound_ahead_m or 0.0
    kept = kept_of(run)
    run.go(3.0, -0.5, silent=True)
    restarted(run, kept)
    run.go(0.1)
    position = run.position
    assert position.status == "degraded"
    assert "restarted" in position.reason
    assert position.direction == "up"
    run.require_true()
    # 2 % of the 28 m since, and nothing for time.
    assert position.bound_ahead_m == pytest.approx(before_m + 0.02 * 28.0, abs=0.4)
    run.hear(run.landmark("C2", 0.0, 5.0))
    run.go(0.1)
    assert run.status() == "valid"
    run.require_true()


def test_a_restart_in_a_slide_keeps_what_is_provisional() -> None:
    run = running()
    run.distance_m += 6.0
    run.way_m += 6.0
    run.provisional_m = 8.0
    run.go(0.2)
    kept = kept_of(run)
    run.go(1.0, -0.5, silent=True)
    restarted(run, kept)
    run.go(0.1)
    run.require_true()
    run.distance_m -= 6.0
    run.way_m += 6.0
    run.provisional_m, run.excess_m = 0.0, 12.0
    run.go(0.1)
    run.require_true()


def test_both_restarted_within_seconds_physics_bounds_the_gap() -> None:
    run = running()
    kept = kept_of(run)
    run.go(4.0, -1.0, silent=True)
    run.origin, run.distance_m, run.way_m, run.excess_m = "o2", 0.0, 0.0, 0.0
    restarted(run, kept)
    run.go(0.1)
    run.require_true()
    assert run.status() == "degraded"
    assert "without odometry" in run.position.reason


def test_after_a_night_it_is_lost_until_a_reference() -> None:
    run = running()
    run.go(10.0, -1.0)
    run.speed_mps = 0.0
    run.go(0.2)
    kept = kept_of(run)
    run.t_ns += 8 * 3600 * 10**9
    run.origin, run.distance_m, run.way_m, run.excess_m = "o2", 0.0, 0.0, 0.0
    run.axis_m += 700.0  # shunted by others
    restarted(run, kept)
    run.go(1.0)
    assert run.status() == "lost"
    assert "may have been moved" in run.position.reason
    assert run.position.axis_m is None
    assert run.position.direction == "up"
    run.hear(run.front_end(0.0, 5.0))
    run.go(0.1)
    assert run.status() == "valid"
    run.require_true()


def test_another_version_of_the_line_forgets_the_place() -> None:
    run = running()
    kept = kept_of(run)
    restarted(run, kept, LinePlaces(straight_line("2")))
    run.go(0.1)
    assert run.status() == "lost"
    assert "made-up 2" in run.position.reason


def test_make_up_scale_and_contradiction_survive() -> None:
    run = running()
    run.hear(TrainChange(t_ns=run.t_ns, kind="coupled", length_m=100.0, front_shift_m=0.0))
    run.hear(TrainChange(t_ns=run.t_ns, kind="wheel_turned"))
    run.go(0.1)
    run.hear(run.landmark("C9", 150.0, 5.0))
    run.go(0.1)
    assert run.status() == "degraded"
    kept = kept_of(run)
    restarted(run, kept)
    run.go(0.1)
    assert run.position.train_length_m == 100.0
    assert run.keeper.held.scale.turned
    assert "contradict" in run.position.reason
    least_m, greatest_m = run.margin_m()
    assert least_m <= run.front_m
    assert greatest_m >= run.front_m + 145.0


def test_the_file_is_whole_or_refused(tmp_path: Path) -> None:
    path = state_file(tmp_path, "demo", "T 1/ä")
    assert path.parent == tmp_path / "train_position"
    assert read_snapshot(path) is None
    kept = kept_of(running())
    write_snapshot(path, kept)
    assert read_snapshot(path) == kept
    assert [one.name for one in path.parent.iterdir()] == [path.name]
    whole = path.read_bytes()
    # A write that was cut off anywhere leaves either the file before or one that is refused.
    for length in range(0, len(whole) - 1, 37):
        path.write_bytes(whole[:length])
        with pytest.raises(StoreError, match="damaged"):
            read_snapshot(path)
    changed = msgspec.structs.replace(kept, format=99)
    write_snapshot(path, changed)
    with pytest.raises(StoreError, match="format 99"):
        read_snapshot(path)


def test_a_cut_write_leaves_the_state_before(tmp_path: Path) -> None:
    path = state_file(tmp_path, "demo", "T1")
    kept = kept_of(running())
    write_snapshot(path, kept)
    path.with_name(path.name + ".new").write_bytes(b"half a sta")
    assert read_snapshot(path) == kept
    write_snapshot(path, kept)
    assert read_snapshot(path) == kept
