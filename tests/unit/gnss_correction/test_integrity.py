"""Bounds against errors: the classes of the Stanford diagram, its table, its picture and the command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from services.gnss_correction.command import app
from services.gnss_correction.integrity import BoundedErrors, integrity_of, integrity_table
from services.gnss_correction.stanford_plot import save_stanford

# In turn: nominal, misleading, hazardously misleading, unavailable, unavailable and misleading, no bound.
ERROR_M = np.array([3.0, 9.0, 60.0, 10.0, 90.0, 1.0])
BOUND_M = np.array([10.0, 8.0, 40.0, 70.0, 80.0, np.nan])
TRACK = BoundedErrors("robust", 8, ERROR_M, BOUND_M)

FIXES = """gps_week,tow_s,status,reason,lat_deg,lon_deg,h_m,bound_m
2300,1,fix,,50.0,8.0,100,5
2300,2,fix,,50.0,8.001,100,5
2300,3,predicted,no satellites,50.0,8.0,100,500
"""
TRUTH = """gps_week,tow_s,lat_deg,lon_deg,h_ell_m
2300,1,50.0,8.0,100
2300,2,50.0,8.0,100
2300,3,50.0,8.0,100
"""


def test_every_class_is_counted() -> None:
    result = integrity_of(TRACK, 50.0)
    assert (result.misleading, result.hazardous) == (4, 1)
    assert result.misleading_percent == pytest.approx(100.0 * 4 / 6)
    assert result.fix_percent == pytest.approx(75.0)
    assert result.bounded_percent == pytest.approx(100.0 * 5 / 6)
    # Three of eight epochs have a bound within the limit.
    assert result.unavailable_percent == pytest.approx(62.5)
    assert (result.bound_p50_m, result.worst_ratio) == (40.0, 1.5)


def test_without_a_bound_nothing_is_vouched_for() -> None:
    result = integrity_of(BoundedErrors("original", 2, np.array([1.0, 2.0]), np.full(2, np.nan)), 50.0)
    assert (result.misleading, result.unavailable_percent) == (2, 100.0)
    assert (result.bound_p50_m, result.worst_ratio) == (None, None)


def test_without_a_fix_nothing_is_divided_by_zero() -> None:
    result = integrity_of(BoundedErrors("none", 5, np.empty(0), np.empty(0)), 50.0)
    assert (result.misleading_percent, result.fix_percent, result.unavailable_percent) == (0.0, 0.0, 100.0)


def test_the_table_sets_methods_side_by_side() -> None:
    text = integrity_table([integrity_of(TRACK, 50.0), integrity_of(TRACK, 50.0)])
    assert text.startswith("Integrity at an alert limit of 50 m\n")
    assert ["misleading:", "error", ">", "bound", "4", "4"] in [line.split() for line in text.splitlines()]


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_the_same_input_gives_the_same_picture(tmp_path: Path, kind: str) -> None:
    first, second = tmp_path / f"a.{kind}", tmp_path / f"b.{kind}"
    for path in (first, second):
        save_stanford(path, [TRACK, TRACK], 50.0)
    assert first.read_bytes() == second.read_bytes()
    assert len(first.read_bytes()) > 5_000


def test_nothing_to_draw_is_said_and_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no fix with a bound"):
        save_stanford(tmp_path / "a.png", [BoundedErrors("none", 1, np.ones(1), np.full(1, np.nan))], 50.0)
    assert list(tmp_path.iterdir()) == []


def written(folder: Path) -> tuple[str, str]:
    (folder / "fixes.csv").write_text(FIXES)
    (folder / "truth.csv").write_text(TRUTH)
    return str(folder / "fixes.csv"), str(folder / "truth.csv")


def test_the_command_counts_fixes_only(tmp_path: Path) -> None:
    fixes, truth = written(tmp_path)
    plot = tmp_path / "stanford.png"
    arguments = ["evaluate", "--fixes", fixes, "--truth", truth, "--integrity", "--alert-limit", "20", "--json"]
    done = CliRunner().invoke(app, [*arguments, "--plot", str(plot)])
    assert done.exit_code == 0, done.output
    (result,) = json.loads(done.stdout)
    assert (result["epochs"], result["misleading"], result["hazardous"]) == (3, 1, 1)
    assert (result["alert_limit_m"], result["bound_p50_m"]) == (20.0, 5.0)
    assert plot.stat().st_size > 0


def test_bounds_need_a_truth(tmp_path: Path) -> None:
    fixes, _ = written(tmp_path)
    done = CliRunner().invoke(app, ["evaluate", "--fixes", fixes, "--integrity"])
    assert done.exit_code == 2
    assert "--truth" in done.stderr
