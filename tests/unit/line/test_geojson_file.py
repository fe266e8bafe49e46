"""GeoJSON and profiles: what can be read is, what cannot is named by its spot in the file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from services.line.geojson_file import GeoJsonError, read_features
from services.line.gradient_fitting import gradients_of
from services.line.imported_profile import ProfileAlong
from services.line.profile_file import ProfileFileError, read_profile


def written(path: Path, content: object) -> Path:
    path.write_text(content if isinstance(content, str) else json.dumps(content), "utf-8")
    return path


def feature(kind: str, coordinates: object, **properties: object) -> dict[str, object]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def test_all_kinds_of_lines_and_points_are_read(tmp_path: Path) -> None:
    collection = {
        "type": "FeatureCollection",
        "features": [
            feature("Point", [134.0, 35.0], name="霧浜", km="1.5"),
            feature("MultiLineString", [[[134, 35], [134.1, 35]], [[134.1, 35], [134.2, 35, 12.5]]], N02_003="本線"),
            feature("Polygon", [[[134, 35], [134.1, 35], [134, 35]]]),
            {"type": "Feature", "properties": None, "geometry": None},
            {
                "type": "Feature",
                "properties": {"chainage_m": 20},
                "geometry": {
                    "type": "GeometryCollection",
                    "geometries": [{"type": "LineString", "coordinates": [[1, 2], [3, 4]]}],
                },
            },
        ],
    }
    found = read_features(written(tmp_path / "a.geojson", collection))
    assert [len(one.vertices) for one in found] == [1, 2, 2, 2]
    assert [one.name for one in found] == ["霧浜", "本線", "本線", ""]
    assert [one.chainage_m for one in found] == [1500.0, None, None, 20.0]
    assert found[2].vertices[1].tolist() == [134.2, 35.0, 12.5]
    assert np.isnan(found[1].vertices[:, 2]).all()
    assert found[2].where == "$.features[1].geometry[1]"


def test_features_are_selected_by_any_property(tmp_path: Path) -> None:
    collection = {
        "type": "FeatureCollection",
        "features": [feature("LineString", [[0, 0], [k, 1]], N02_003=f"line {k}") for k in range(1, 4)],
    }
    path = written(tmp_path / "a.geojson", collection)
    assert [one.name for one in read_features(path, "line 2")] == ["line 2"]
    with pytest.raises(GeoJsonError, match="no line and no point with a property 'line 9'"):
        read_features(path, "line 9")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "not JSON"),
        ("[]", "no GeoJSON"),
        ({"type": "FeatureCollection"}, r"\$\.features: no list"),
        ({"type": "FeatureCollection", "features": [3]}, r"\$\.features\[0\]: no feature"),
        ({"type": "FeatureCollection", "features": []}, "no line and no point"),
        (feature("Circle", [1, 2]), "no geometry that can be read: 'Circle'"),
        (feature("LineString", []), "no coordinates"),
        (feature("LineString", [[1, 2], [3]]), r"coordinates\[1\]: a position is"),
        (feature("LineString", [[1, 2], ["a", 3]]), r"coordinates\[1\]: a position is"),
        (feature("Point", [355977.1, 5262562.9]), "may be projected"),
        (feature("Point", [1, 2], km="far"), "property km is 'far'"),
        ({"type": "LineString", "coordinates": 7}, "no coordinates"),
        (feature("LineString", [[True, 2], [1, 3]]), r"coordinates\[0\]: a position is"),
        (feature("LineString", [[10**400, 2], [1, 3]]), r"coordinates\[0\]: a position is"),
        (feature("Point", [1, 2], km=1e300), "property km is 1e\\+300"),
        ({"type": "GeometryCollection", "geometries": 7}, r"\$\.geometries: no list"),
        ('{"a":' * 5000, "nested too deeply"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path: Path, content: object, words: str) -> None:
    with pytest.raises(GeoJsonError, match=words):
        read_features(written(tmp_path / "a.geojson", content))


def test_a_profile_is_read_in_order_of_place(tmp_path: Path) -> None:
    path = written(tmp_path / "p.csv", "axis_m,altitude_m,limit_kmh\n500,12,90\n0,10,72\n1000,,\n")
    table = read_profile(path)
    assert table.place_m.tolist() == [0.0, 500.0, 1000.0]
    assert table.height_m is not None
    assert table.height_m[:2].tolist() == [10.0, 12.0]
    assert np.isnan(table.height_m[2])
    assert table.limit_mps is not None
    assert table.limit_mps[:2].tolist() == pytest.approx([20.0, 25.0])
    assert table.gradient_permille is None
    assert not table.by_chainage


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("place,height\n1,2\n", "p.csv:1: columns wanted: axis_m or chainage_m"),
        ("axis_m,h_m\n1,2\nx,3\n", "p.csv:3: axis_m is 'x'"),
        ("axis_m,h_m\n1,nan\n", "p.csv:2: h_m is 'nan'"),
        ("axis_m,h_m\n", "no rows"),
        ("", "columns wanted"),
        ("axis_m,h_m\n1,1e308\n", "p.csv:2: h_m is 1e308: -19999 to 19999 is wanted"),
        ("axis_m,permille\n1,200\n", "p.csv:2: permille is 200: -150 to 150 is wanted"),
        ("axis_m,limit_kmh\n1,0\n", "p.csv:2: limit_kmh is 0: 0.36 to 504 is wanted; leave the cell empty"),
        ("axis_m,limit_kmh\n1,5000\n", "p.csv:2: limit_kmh is 5000"),
        ("chainage_m,h_m\n1e300,0\n", "p.csv:2: chainage_m is 1e300"),
    ],
)
def test_a_profile_that_is_none_is_named(tmp_path: Path, content: str, words: str) -> None:
    with pytest.raises(ProfileFileError, match=words):
        read_profile(written(tmp_path / "p.csv", content))


def test_gradients_follow_heights_with_few_pieces() -> None:
    along = np.arange(0.0, 3000.1, 25.0)
    height = np.interp(along, [0.0, 1000.0, 2200.0, 3000.0], [50.0, 50.0, 80.0, 68.0])
    bumps = 0.3 * np.sin(along / 40.0)
    found = gradients_of(along, height + bumps)
    assert [round(one.permille) for one in found] == pytest.approx([0, 25, -15], abs=1)
    assert [one.axis_m for one in found] == pytest.approx([0.0, 1000.0, 2200.0], abs=75.0)


def test_a_profile_seen_from_the_other_end_falls_where_it_rose() -> None:
    profile = ProfileAlong(
        np.array([0.0, 400.0, 1000.0]),
        gradient_permille=np.array([10.0, -5.0, np.nan]),
        limit_mps=np.array([20.0, 10.0, np.nan]),
    )
    turned = profile.turned(1000.0)
    assert [(one.axis_m, one.permille) for one in turned.gradients(1000.0)] == [(0.0, 5.0), (600.0, -10.0)]
    limits = [(one.start_axis_m, one.end_axis_m, one.limit_mps) for one in turned.speed_limits(1000.0)]
    assert limits == [(0.0, 600.0, 10.0), (600.0, 1000.0, 20.0)]
    assert turned.heights_m(np.array([0.0, 600.0, 1000.0])).tolist() == [0.0, 3.0, -1.0]
