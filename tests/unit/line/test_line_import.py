"""A map of the demo line, cut up and shuffled, becomes the demo line again; and the commands around it."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from schemas.line import Line
from services.line.alignment import alignment_of
from services.line.built_in_file import built_in_line
from services.line.command import app
from services.line.line_check import problems_of
from services.line.line_json_file import line_text

DEMO = built_in_line("demo")
MAIN = alignment_of(DEMO)
RUNNER = CliRunner()


def line_string(vertices: object, **properties: object) -> dict[str, object]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": "LineString", "coordinates": vertices}}


def station_points(*, with_chainage: bool) -> list[dict[str, object]]:
    found: list[dict[str, object]] = []
    for one in (*DEMO.stations, *DEMO.branches[0].stations):
        on_branch = one in DEMO.branches[0].stations
        lat, lon, _ = alignment_of(DEMO, "akaiwa" if on_branch else "").position(one.axis_m)
        properties: dict[str, object] = {"name": one.name_ja}
        if with_chainage and not on_branch:
            properties["chainage_m"] = round(float(MAIN.chainage.at(one.axis_m)), 1)
        geometry = {"type": "Point", "coordinates": [float(lon), float(lat)]}
        found.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return found


def drawn_map(folder: Path, *, with_chainage: bool = True) -> tuple[Path, Path, Path]:
    """Files of tracks (pieces in disorder, the branch, a loop), stations, and a profile of heights."""
    main = [list(vertex[:2]) for vertex in DEMO.axis]
    cuts = [0, 700, 1500, 1501, 2400, len(main) - 1]
    tracks = [line_string(main[a : b + 1][:: -1 if k % 2 else 1]) for k, (a, b) in enumerate(pairwise(cuts))]
    tracks.append(line_string([list(vertex[:2]) for vertex in DEMO.branches[0].axis]))
    tracks.append(tracks[0])
    order = np.random.default_rng(1).permutation(len(tracks))
    axis = folder / "axis.geojson"
    axis.write_text(json.dumps({"type": "FeatureCollection", "features": [tracks[k] for k in order]}))
    stations = folder / "stations.geojson"
    points = station_points(with_chainage=with_chainage)
    stations.write_text(json.dumps({"type": "FeatureCollection", "features": points}, ensure_ascii=False), "utf-8")
    profile = folder / "profile.csv"
    along = np.arange(0.0, MAIN.length_m, 50.0)
    rows = zip(along, MAIN.position(along)[2], strict=True)
    profile.write_text("axis_m,height_m\n" + "".join(f"{place:.1f},{height:.3f}\n" for place, height in rows))
    return axis, stations, profile


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Line:
    folder = tmp_path_factory.mktemp("map")
    axis, stations, profile = drawn_map(folder)
    out = folder / "line.json"
    arguments = ["--axis", axis, "--stations", stations, "--profile", profile, "--name", "Kirisato", "--out", out]
    result = RUNNER.invoke(app, ["import", *map(str, arguments)])
    assert result.exit_code == 0, result.output
    assert sorted(one.name for one in folder.iterdir()) == [
        "axis.geojson",
        "line.json",
        "profile.csv",
        "stations.geojson",
    ]
    return msgspec.json.decode(out.read_bytes(), type=Line)


def test_the_line_comes_back_as_long_as_it_was(imported: Line) -> None:
    # Smoothing by 0.3 m, the least error that a map is taken to have, cuts corners by centimetres each.
    assert alignment_of(imported).length_m == pytest.approx(MAIN.length_m, abs=3.0)
    assert imported.id == "kirisato"


def test_stations_keep_their_places_and_kilometrage(imported: Line) -> None:
    found = alignment_of(imported)
    assert [one.name_ja for one in imported.stations] == [one.name_ja for one in DEMO.stations]
    for one, known in zip(imported.stations, DEMO.stations, strict=True):
        assert one.axis_m == pytest.approx(known.axis_m, abs=3.0)
        assert float(found.chainage.at(one.axis_m)) == pytest.approx(float(MAIN.chainage.at(known.axis_m)), abs=0.1)


def test_the_branch_leaves_where_it_did(imported: Line) -> None:
    (branch,) = imported.branches
    known = DEMO.branches[0]
    assert branch.leaves_axis_m == pytest.approx(known.leaves_axis_m, abs=3.0)
    assert branch.side == known.side
    assert [one.name_ja for one in branch.stations] == ["鹿沢", "赤岩温泉"]


def test_curves_are_those_of_the_design(imported: Line) -> None:
    assert len(imported.curves) == len(DEMO.curves)
    error = [one.radius_m / known.radius_m - 1.0 for one, known in zip(imported.curves, DEMO.curves, strict=True)]
    # Exact vertices, smoothed by 0.3 m: 0.2 % was measured as median, 4.5 % at most.
    assert np.median(np.abs(error)) < 0.005
    assert np.abs(error).max() < 0.06
    assert all(one.radius_sigma_m is not None and one.place_sigma_m is not None for one in imported.curves)


def test_gradients_are_those_of_the_heights(imported: Line) -> None:
    along = np.array([one.axis_m for one in DEMO.gradients])
    middles = (along[1:] + along[:-1]) / 2.0
    off = alignment_of(imported).gradient_permille(middles) - MAIN.gradient_permille(middles)
    # Heights are kept to 1 m over pieces of 300 m and more.
    assert np.abs(off).max() < 4.0


def test_what_was_imported_passes_the_check(imported: Line) -> None:
    assert [one for one in problems_of(imported) if one.severity == "error"] == []


def test_landmarks_of_fitted_curves_say_what_they_are_worth(imported: Line) -> None:
    assert len(imported.landmarks) >= 28
    assert min(one.accuracy_m for one in imported.landmarks) >= 10.0


def test_stations_in_falling_order_turn_the_line_round(tmp_path: Path) -> None:
    axis, stations, _ = drawn_map(tmp_path, with_chainage=False)
    content = json.loads(stations.read_text("utf-8"))
    content["features"] = content["features"][:8][::-1]
    stations.write_text(json.dumps(content), "utf-8")
    for extra, first in ((), "霞城"), (("--start", "霧浜"), "霧浜"):
        out = tmp_path / "line.json"
        arguments = ["import", "--axis", str(axis), "--stations", str(stations), "--out", str(out), *extra, "--json"]
        result = RUNNER.invoke(app, arguments)
        assert result.exit_code == 0, result.output
        line = msgspec.json.decode(out.read_bytes(), type=Line)
        assert line.stations[0].name_ja == first
    # Seen from the far end the branch would leave backwards.
    assert json.loads(result.stdout)["branches"] == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--start", "nowhere"], "no station 'nowhere'"),
        (["--select", "no line"], "no line and no point with a property"),
        (["--axis", "missing.geojson"], "missing.geojson"),
    ],
)
def test_an_import_that_fails_says_why_and_leaves_nothing(tmp_path: Path, arguments: list[str], words: str) -> None:
    axis, stations, _ = drawn_map(tmp_path)
    out = tmp_path / "line.json"
    given = ["import", "--axis", str(axis), "--stations", str(stations), "--out", str(out), *arguments]
    result = RUNNER.invoke(app, given)
    assert result.exit_code == 1
    assert words in result.output
    assert not out.exists()


def test_check_lists_problems_and_ends_with_1(tmp_path: Path) -> None:
    path = tmp_path / "line.json"
    faulty = msgspec.structs.replace(DEMO, stations=DEMO.stations[::-1], valid_until="2019-01-01")
    path.write_bytes(line_text(faulty))
    result = RUNNER.invoke(app, ["check", str(path)])
    assert result.exit_code == 1
    assert f"{path}:$.stations[1].axis_m: error: " in result.output
    assert f"{path}:$.valid_until: error: " in result.output
    listed = json.loads(RUNNER.invoke(app, ["check", str(path), "--json"]).stdout)
    assert {one["severity"] for one in listed} == {"error"}
    assert RUNNER.invoke(app, ["check", "demo"]).exit_code == 0


def test_a_file_that_is_none_ends_with_1(tmp_path: Path) -> None:
    path = tmp_path / "line.json"
    path.write_text('{"id": "x"')
    for command in ("check", "show"):
        result = RUNNER.invoke(app, [command, str(path)])
        assert result.exit_code == 1
        assert str(path) in result.output
    path.write_bytes(
        line_text(msgspec.structs.replace(DEMO, curves=(msgspec.structs.replace(DEMO.curves[0], radius_m=0.0),)))
    )
    result = RUNNER.invoke(app, ["show", str(path)])
    assert result.exit_code == 1
    assert "$.curves[0]" in result.output


def test_show_gives_tables_json_and_a_picture(tmp_path: Path) -> None:
    picture = tmp_path / "demo.png"
    result = RUNNER.invoke(app, ["show", "demo", "--plot", str(picture)])
    assert result.exit_code == 0
    for words in ("Kirisato Line 霧里線", "curves (29)", "stations (8)", "broken chains (2)", "landmarks (50)"):
        assert words in result.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert [one.name for one in tmp_path.iterdir()] == ["demo.png"]
    summary = json.loads(RUNNER.invoke(app, ["show", "demo", "--branch", "akaiwa", "--json"]).stdout)
    assert summary["branch"] == "akaiwa"
    assert summary["stations"][-1]["name"] == "Akaiwa-Onsen"
    unknown = RUNNER.invoke(app, ["show", "demo", "--branch", "x"])
    assert (unknown.exit_code, "it has: akaiwa" in unknown.output) == (2, True)
    refused = RUNNER.invoke(app, ["show", "demo", "--plot", str(tmp_path / "demo.xyz")])
    assert refused.exit_code == 1


@pytest.mark.parametrize(
    ("rows", "words", "code"),
    [
        ("0,10\n1000,20\n", "the profile covers axis_m 0 to 1000", 0),
        ("1000000,10\n2000000,20\n", "no row of the profile lies on the line", 1),
    ],
)
def test_heights_of_a_part_are_level_beyond(tmp_path: Path, rows: str, words: str, code: int) -> None:
    axis, profile, out = (tmp_path / name for name in ("a.geojson", "p.csv", "line.json"))
    axis.write_text(json.dumps({"type": "LineString", "coordinates": [[0.001 * k, 0.0] for k in range(40)]}), "utf-8")
    profile.write_text("axis_m,height_m\n" + rows, "utf-8")
    result = RUNNER.invoke(app, ["import", "--axis", str(axis), "--profile", str(profile), "--out", str(out)])
    assert (result.exit_code, words in result.output) == (code, True)
    if code == 0:
        line = msgspec.json.decode(out.read_bytes(), type=Line)
        assert [(one.axis_m, one.permille) for one in line.gradients] == [(0.0, 10.0), (1000.0, 0.0)]
        assert not problems_of(line)


def test_vertices_of_other_continents_are_no_track(tmp_path: Path) -> None:
    axis, out = tmp_path / "a.geojson", tmp_path / "line.json"
    axis.write_text(json.dumps({"type": "LineString", "coordinates": [[0, 0], [0.01, 0], [100, 0]]}), "utf-8")
    result = RUNNER.invoke(app, ["import", "--axis", str(axis), "--out", str(out)])
    assert (result.exit_code, "$.coordinates[2]: " in result.output, out.exists()) == (1, True, False)


def test_a_profile_may_go_by_kilometrage(tmp_path: Path) -> None:
    axis, stations, profile = drawn_map(tmp_path)
    along = np.arange(0.0, MAIN.length_m, 50.0)
    rows = zip(MAIN.chainage.at(along), MAIN.gradient_permille(along), strict=True)
    profile.write_text("chainage_m,gradient_permille,limit_kmh\n" + "".join(f"{c:.1f},{g:.2f},80\n" for c, g in rows))
    out = tmp_path / "line.json"
    given = ["import", "--axis", str(axis), "--profile", str(profile), "--out", str(out), "--stations"]
    result = RUNNER.invoke(app, [*given, str(stations)])
    assert result.exit_code == 0, result.output
    found = alignment_of(msgspec.json.decode(out.read_bytes(), type=Line))
    middles = np.array([3500.0, 7300.0, 19_000.0])
    # Away from the broken chains, which a map with stations alone does not show, and from changes of gradient.
    assert found.gradient_permille(middles) == pytest.approx(MAIN.gradient_permille(middles), abs=0.1)
    assert found.speed_limit_mps(12_000.0) == pytest.approx(80.0 / 3.6)
    content = {"type": "FeatureCollection", "features": station_points(with_chainage=False)}
    stations.write_text(json.dumps(content), "utf-8")
    refused = RUNNER.invoke(app, [*given, str(stations)])
    assert refused.exit_code == 1
    assert "two stations or more with a kilometrage" in refused.output
