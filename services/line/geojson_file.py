"""Reads GeoJSON (RFC 7946): tracks as lines, stations as points or short lines, with their properties."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.line.chainage import LARGEST_CHAINAGE_M

Floats = NDArray[np.float64]

LARGEST_BYTES: Final = 512_000_000
NAMES: Final = ("name", "N02_005", "N02_003", "station", "駅名", "title")
"""Properties that name a feature; N02_003 and N02_005: line and station in the National Land Numerical Information."""
NAMES_JA: Final = ("name_ja", "name:ja")
CHAINAGES: Final = {"chainage_m": 1.0, "kilometrage_m": 1.0, "chainage_km": 1000.0, "km": 1000.0, "キロ程": 1000.0}
"""Properties that give a kilometrage, with their unit in metres."""


class GeoJsonError(ValueError):
    """A file that holds no usable GeoJSON: path, feature, what is wrong."""

    def __init__(self, path: Path, where: str, text: str) -> None:
        """Name the file and the spot in it."""
        super().__init__(f"{path}:{where}: {text}" if where else f"{path}: {text}")


@dataclass(frozen=True, slots=True)
class Feature:
    """One line or point."""

    where: str
    """Its path in the file."""
    vertices: Floats
    """Shape (n, 3): longitude, latitude [deg], height [m] (NaN where the file gives none); one row for a point."""
    name: str
    name_ja: str
    chainage_m: float | None
    properties: Mapping[str, Any]


def read_features(path: Path, select: str = "") -> tuple[Feature, ...]:
    """Every line and point of a file, in its order; with `select` those that have this value among their properties.

    Raises GeoJsonError and OSError.
    """
    if path.stat().st_size > LARGEST_BYTES:
        raise GeoJsonError(path, "", f"larger than {LARGEST_BYTES // 1_000_000} MB")
    try:
        root = msgspec.json.decode(path.read_bytes())
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise GeoJsonError(path, "", f"not JSON: {error}") from error
    except RecursionError as error:
        raise GeoJsonError(path, "", "nested too deeply for GeoJSON") from error
    found = tuple(
        feature
        for where, properties, geometry in _geometries(path, root)
        if not select or select in {str(value) for value in properties.values()}
        for feature in _features(path, where, properties, geometry)
    )
    if not found:
        wanted = f" with a property {select!r}" if select else ""
        raise GeoJsonError(path, "", f"no line and no point{wanted}")
    return found


def _geometries(path: Path, root: Any) -> Iterator[tuple[str, Mapping[str, Any], Any]]:  # noqa: ANN401 - parsed JSON
    """Path, properties and geometry of everything in a file."""
    kind = root.get("type") if isinstance(root, dict) else None
    if kind == "FeatureCollection":
        features = root.get("features")
        if not isinstance(features, list):
            raise GeoJsonError(path, "$.features", "no list of features")
        for number, feature in enumerate(features):
            yield from _of_feature(path, f"$.features[{number}]", feature)
    elif kind == "Feature":
        yield from _of_feature(path, "$", root)
    elif isinstance(kind, str):
        yield "$", {}, root
    else:
        raise GeoJsonError(path, "$", "no GeoJSON: an object with a `type` is expected")


def _of_feature(path: Path, where: str, feature: Any) -> Iterator[tuple[str, Mapping[str, Any], Any]]:  # noqa: ANN401 - parsed JSON
    if not isinstance(feature, dict):
        raise GeoJsonError(path, where, "no feature")
    properties = feature.get("properties")
    if feature.get("geometry") is not None:
        yield f"{where}.geometry", properties if isinstance(properties, dict) else {}, feature["geometry"]


def _features(path: Path, where: str, properties: Mapping[str, Any], geometry: Any) -> Iterator[Feature]:  # noqa: ANN401 - parsed JSON
    """Lines and points of one geometry; areas are no tracks and are left out."""
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind == "GeometryCollection":
        inner = geometry.get("geometries")
        if not isinstance(inner, list):
            raise GeoJsonError(path, f"{where}.geometries", "no list of geometries")
        for number, one in enumerate(inner):
            yield from _features(path, f"{where}.geometries[{number}]", properties, one)
        return
    coordinates = geometry.get("coordinates") if isinstance(geometry, dict) else None
    parts: list[tuple[str, Any]]
    if kind in ("Point", "LineString"):
        parts = [(where, [coordinates] if kind == "Point" else coordinates)]
    elif kind in ("MultiPoint", "MultiLineString") and isinstance(coordinates, list):
        parts = [(f"{where}[{k}]", [one] if kind == "MultiPoint" else one) for k, one in enumerate(coordinates)]
    elif kind in ("Polygon", "MultiPolygon"):
        return
    else:
        raise GeoJsonError(path, where, f"no geometry that can be read: {kind!r}")
    for spot, vertices in parts:
        yield Feature(
            where=spot,
            vertices=_vertices(path, spot, vertices),
            name=_text(properties, NAMES),
            name_ja=_text(properties, NAMES_JA),
            chainage_m=_chainage_m(path, spot, properties),
            properties=properties,
        )


def _vertices(path: Path, where: str, given: Any) -> Floats:  # noqa: ANN401 - parsed JSON
    """Rows of longitude, latitude, height."""
    if not isinstance(given, list) or not given:
        raise GeoJsonError(path, where, "no coordinates")
    rows = np.full((len(given), 3), np.nan)
    for number, one in enumerate(given):
        figures = _figures(one)
        if figures is None:
            raise GeoJsonError(
                path, f"{where}.coordinates[{number}]", "a position is [longitude, latitude] or with height"
            )
        rows[number, : len(figures)] = figures
        lon, lat = figures[:2]
        if not (abs(lon) <= 360.0 and abs(lat) <= 90.0):  # noqa: PLR2004 - degrees
            advice = "; the coordinates may be projected: GeoJSON wants degrees (WGS 84)" if abs(lat) > 360.0 else ""  # noqa: PLR2004 - degrees
            raise GeoJsonError(path, f"{where}.coordinates[{number}]", f"[{lon}, {lat}] is no place{advice}")
    return rows


def _figures(position: Any) -> list[float] | None:  # noqa: ANN401 - parsed JSON
    """Longitude, latitude and height if there is one; None for what is no position."""
    if not isinstance(position, list) or len(position) < 2:  # noqa: PLR2004 - longitude and latitude
        return None
    if not all(type(part) in (int, float) for part in position):
        return None
    try:
        return [float(part) for part in position[:3]]
    except OverflowError:
        return None


def _text(properties: Mapping[str, Any], names: tuple[str, ...]) -> str:
    """The first of these properties that is a text."""
    return next((str(properties[name]) for name in names if isinstance(properties.get(name), str)), "")


def _chainage_m(path: Path, where: str, properties: Mapping[str, Any]) -> float | None:
    """Kilometrage among the properties; a text is taken when it is a number."""
    for name, unit_m in CHAINAGES.items():
        given = properties.get(name)
        if given is None or given == "":
            continue
        try:
            figure = float(given) * unit_m
        except (TypeError, ValueError):
            figure = math.nan
        if not abs(figure) <= LARGEST_CHAINAGE_M:
            raise GeoJsonError(path, where, f"property {name} is {given!r}, which is no kilometrage")
        return figure
    return None
