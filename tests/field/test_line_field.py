"""Lines of real maps, and real runs on them: N02 lines of Japan, and line 80 in Hungary."""

from __future__ import annotations

import json
import os
from pathlib import Path

import duckdb
import numpy as np
import pytest

from services.line.alignment import Alignment, alignment_of
from services.line.geojson_file import read_features
from services.line.import_file import import_from_files
from services.line.line_check import problems_of
from services.line.line_import import Imported, Wishes
from services.line.projection import follow
from services.line.route_projection import project_run

FIELD = os.environ.get("KIROTEI_FIELD_DATA")
RUNS = Path(FIELD or "") / "runs"
N02 = RUNS / "lines_jp" / "n02"
HUNGARY = RUNS / "hungary_line80"

pytestmark = pytest.mark.skipif(not FIELD, reason="KIROTEI_FIELD_DATA names no folder of real logs")

# Operating lengths [km] as the companies state them.
LENGTHS = [
    ("京阪電気鉄道", "京阪本線", 49.3),
    ("南海電気鉄道", "南海本線", 64.2),
    ("近畿日本鉄道", "近鉄名古屋線", 78.8),
    ("近畿日本鉄道", "近鉄奈良線", 26.7),
    ("神戸電鉄", "有馬線", 22.5),
    ("神戸電鉄", "粟生線", 29.2),
    ("阪急電鉄", "阪急神戸本線", 32.3),
    ("阪急電鉄", "阪急宝塚本線", 24.5),
    ("阪神電気鉄道", "阪神本線", 32.1),
    ("叡山電鉄", "鞍馬線", 8.8),
]


@pytest.mark.parametrize(("company", "line", "stated_km"), LENGTHS)
def test_pieces_of_a_national_map_make_a_line_of_its_stated_length(company: str, line: str, stated_km: float) -> None:
    imported = import_from_files(
        N02 / company / f"{company}{line}.geojson",
        N02 / company / f"{company}{line}_station_only.geojson",
        None,
        Wishes(name=line),
    )
    # Kilometrage is measured between stations; tracks go on behind the last ones, and old posts were kept.
    assert imported.length_m / 1000.0 == pytest.approx(stated_km, rel=0.025)
    assert len(imported.line.stations) > 5
    assert not [one for one in problems_of(imported.line) if one.severity == "error"]
    # The map's scatter is 0.3 to 0.6 m; beyond 10 m run other tracks of the same map.
    axis = alignment_of(imported.line).axis
    tracks = read_features(N02 / company / f"{company}{line}.geojson")
    lon, lat = np.concatenate([one.vertices[:, :2] for one in tracks]).T
    places = axis.to_plane(lat, lon, np.zeros(len(lat)))
    aside_m = np.abs(follow(axis, places, np.full(len(places), np.inf))[:, 1])
    assert np.percentile(aside_m[aside_m < 10.0], 95.0) < 1.0


@pytest.fixture(scope="module")
def line_80() -> tuple[Imported, Alignment]:
    files = (HUNGARY / "axis.geojson", HUNGARY / "stations.geojson", HUNGARY / "profile.csv")
    imported = import_from_files(*files, Wishes(gauge_m=1.435))
    return imported, alignment_of(imported.line)


def test_line_80_keeps_its_length_and_its_stations(line_80: tuple[Imported, Alignment]) -> None:
    imported, _ = line_80
    known = json.loads((HUNGARY / "axis.geojson").read_text("utf-8"))["features"][0]["properties"]["length_m"]
    # Its places were measured in a projected plane, 0.03 % shorter than the ellipsoid there.
    assert imported.length_m == pytest.approx(known, rel=5e-4)
    stations = json.loads((HUNGARY / "stations.geojson").read_text("utf-8"))["features"]
    given = {one["properties"]["name"]: one["properties"]["axis_m"] for one in stations}
    for one in imported.line.stations:
        assert one.axis_m == pytest.approx(given[one.name], rel=5e-4, abs=5.0)
    assert not [one for one in problems_of(imported.line) if one.severity == "error"]


def test_curves_of_line_80_turn_as_gyroscopes_would(line_80: tuple[Imported, Alignment]) -> None:
    _, alignment = line_80
    turned = 0.0
    for one in alignment.curves:
        arc_m = one.end_axis_m - one.start_axis_m - (one.transition_in_m + one.transition_out_m) / 2.0
        turned += abs(arc_m / one.radius_m)
    along = np.arange(0.0, alignment.length_m, 100.0)
    heading = alignment.heading.at(along)
    # What the curves leave out are kinks of the map between straights, a sixth of all its turning.
    assert turned > 0.7 * float(np.abs(np.diff(heading)).sum())


@pytest.mark.parametrize("run", [2, 5, 8, 10, 12, 17])
def test_runs_of_a_phone_are_followed_through_gaps_and_noise(line_80: tuple[Imported, Alignment], run: int) -> None:
    _, alignment = line_80
    query = "select t, lat, lon from read_parquet(?) where run = ? and rx = 'phone' order by t"
    con = duckdb.connect()
    con.execute("SET threads=1")
    rows = con.execute(query, [str(HUNGARY / "runs.parquet"), run]).fetchnumpy()
    columns: list[np.ndarray] = [np.ma.filled(np.ma.asarray(rows[name], float), np.nan) for name in ("t", "lat", "lon")]
    found = project_run((alignment,), columns[0], columns[1], columns[2], 8.0)
    on_line = np.isfinite(found.axis_m)
    # 2 to 5 % of the fixes are far off the track.
    assert on_line.mean() > 0.95
    assert np.median(np.abs(found.aside_m[on_line])) < 13.0
    step_m = np.diff(found.axis_m[on_line])
    against = np.sign(np.median(step_m[np.abs(step_m) > 1.0])) * step_m < -30.0
    assert against.mean() < 0.005
