"""`evaluate --centreline`: a line file says the same as a CSV polyline, kilometrage with broken chains included."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.gnss_correction.command import app
from services.gnss_correction.evaluation import centreline_of
from services.line.line_file import read_line

LON_DEG, H_M = 139.0, 40.0
LATITUDES = [35.0 + 0.001 * k for k in range(4)]
"""111 m apart on a meridian."""
STEP_M = 110.9415
"""The meridian's arc of 0.001° at 35° N, 40 m up: M = a (1 - e²) / (1 - e² sin² φ)^1.5 plus the height, in radians."""
BREAK_M = 1000.0
ROUNDING_M = 0.01
"""The break of the line file stands this far before its vertex, lest rounding put it behind."""


def chainage_m(index: int) -> float:
    """Kilometrage of a vertex; the chain is broken at the third."""
    return STEP_M * index + (BREAK_M if index >= 2 else 0.0)


@pytest.fixture
def centrelines(tmp_path: Path) -> dict[str, Path]:
    """The same line both ways; repeated rows are the broken chain of the CSV."""
    rows = [(chainage_m(index), LATITUDES[index]) for index in (0, 1, 2, 3)]
    rows.insert(2, (2 * STEP_M, LATITUDES[2]))
    csv, line = tmp_path / "line.csv", tmp_path / "line.json"
    csv.write_text(
        "chainage_m,lat_deg,lon_deg,h_ell_m\n" + "".join(f"{at:.4f},{lat:.6f},{LON_DEG},{H_M}\n" for at, lat in rows)
    )
    at_break = 2 * STEP_M - ROUNDING_M
    points = [(0.0, 0.0), (at_break, at_break), (at_break, at_break + BREAK_M), (3 * STEP_M, chainage_m(3))]
    line.write_text(
        json.dumps(
            {
                "id": "demo",
                "name": "Demo",
                "axis": [[LON_DEG, lat, H_M] for lat in LATITUDES],
                "chainage": [{"axis_m": axis, "chainage_m": at} for axis, at in points],
            }
        )
    )
    return {"csv": csv, "json": line}


@pytest.fixture
def run(tmp_path: Path) -> tuple[Path, Path]:
    """Truth that runs along the line in 30 s, and fixes 5 m east of it whose chainage is 2 m ahead."""
    truth, fixes = tmp_path / "truth.csv", tmp_path / "fixes.csv"
    lines, told = ["gps_week,tow_s,lat_deg,lon_deg,h_ell_m"], ["gps_week,tow_s,status,reason,lat_deg,lon_deg,h_m"]
    told[0] += ",ve_mps,vn_mps,vu_mps,satellites_used,satellites_flagged,bound_m,chainage_m,chainage_bound_m"
    east_deg = 5.0 / 91_288.0  # a degree of longitude at 35° N
    for second in (k + 0.5 for k in range(30)):
        lat, way_m = 35.0 + 0.0001 * second, 0.1 * STEP_M * second
        lines.append(f"2300,{second},{lat:.9f},{LON_DEG},{H_M}")
        at = way_m + (BREAK_M if second >= 20 else 0.0) + 2.0
        told.append(f"2300,{second},fix,,{lat:.9f},{LON_DEG + east_deg:.9f},{H_M},0,0,0,9,0,9.0,{at:.3f},9.0")
    truth.write_text("\n".join(lines) + "\n")
    fixes.write_text("\n".join(told) + "\n")
    return truth, fixes


def evaluated(centreline: Path, run: tuple[Path, Path]) -> dict[str, dict[str, float]]:
    truth, fixes = run
    given = ["evaluate", "--fixes", str(fixes), "--truth", str(truth), "--centreline", str(centreline), "--json"]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0, result.output
    (found,) = json.loads(result.output)
    return dict(found)


@pytest.mark.parametrize("kind", ["csv", "json"])
def test_both_kinds_of_centreline_are_read(centrelines: dict[str, Path], run: tuple[Path, Path], kind: str) -> None:
    found = evaluated(centrelines[kind], run)
    # STEP_M is off by 0.2 mm, the vertices of the CSV by as much as its six decimals.
    assert found["line"]["average_m"] == pytest.approx(5.0, abs=0.01)
    assert found["along"]["known_percent"] == 100.0
    assert found["along"]["maximum_m"] == pytest.approx(2.0, abs=0.01)
    assert found["along"]["beyond_bound"] == 0


def test_the_vertices_come_back_with_their_chainages(centrelines: dict[str, Path]) -> None:
    line = centreline_of(read_line(centrelines["json"]))
    assert line.lat_deg == pytest.approx(LATITUDES, abs=1e-11)
    assert line.h_m == pytest.approx([H_M] * 4, abs=1e-6)
    # STEP_M is off by 0.2 mm.
    assert line.at == pytest.approx([chainage_m(index) for index in range(4)], abs=1e-3)


def test_what_is_no_line_is_named(tmp_path: Path, run: tuple[Path, Path]) -> None:
    truth, fixes = run
    broken = tmp_path / "broken.json"
    broken.write_text('{"id": "demo", "name": "Demo", "axis": [[139.0, 35.0]]}')
    given = ["evaluate", "--fixes", str(fixes), "--truth", str(truth), "--centreline", str(broken)]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 1
    assert "broken.json" in result.output
    assert "$.axis" in result.output
