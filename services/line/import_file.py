"""Imports a line from files: tracks and stations as GeoJSON, heights and limits as CSV."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from services.line.axis import LONGEST_SEGMENT_M
from services.line.geojson_file import Feature, GeoJsonError, read_features
from services.line.imported_profile import ProfileAlong
from services.line.line_import import GivenStation, Imported, Wishes, import_line
from services.line.profile_file import read_profile
from services.line.smoothing import lengths_m
from services.numerics.geodesy import ecef_from_geodetic


def import_from_files(
    axis: Path, stations: Path | None, profile: Path | None, wishes: Wishes, select: str = ""
) -> Imported:
    """A line file of a map's files; without a file of stations, named points beside the tracks are taken for them.

    Raises GeoJsonError, ProfileFileError, StitchingError, ImportRefusedError, OSError.
    """
    features = read_features(axis, select)
    tracks = [one for one in features if len(one.vertices) > 1]
    if not tracks:
        raise GeoJsonError(axis, "", "points only: tracks are lines")
    for one in tracks:
        _require_near(axis, one)
    places = read_features(stations, select) if stations is not None else features
    given = [_station(one) for one in places if stations is not None or (len(one.vertices) == 1 and one.name)]
    table, by_chainage = None, False
    if profile is not None:
        rows = read_profile(profile)
        by_chainage = rows.by_chainage
        table = ProfileAlong(rows.place_m, rows.height_m, rows.gradient_permille, rows.limit_mps)
    name = wishes.name or _common_name(tracks) or axis.stem
    wishes = replace(wishes, name=name, profile_by_chainage=by_chainage)
    return import_line([one.vertices[:, :2] for one in tracks], given, wishes, table)


def _require_near(path: Path, track: Feature) -> None:
    """Refuse a track with vertices further apart than any railway is surveyed; raises GeoJsonError."""
    lon, lat = np.radians(track.vertices[:, :2]).T
    apart_m = np.linalg.norm(np.diff(np.stack(ecef_from_geodetic(lat, lon, np.zeros(len(lat)))), axis=1), axis=0)
    if apart_m.max() > LONGEST_SEGMENT_M:
        wrong = int(apart_m.argmax())
        text = f"{apart_m[wrong] / 1000.0:.0f} km from the vertex before; correct or leave out the vertex"
        raise GeoJsonError(path, f"{track.where}.coordinates[{wrong + 1}]", text)


def _station(feature: Feature) -> GivenStation:
    """A station; of a short line along its platforms the middle."""
    lonlat = feature.vertices[:, :2]
    along = lengths_m(lonlat)
    middle = np.array([np.interp(along[-1] / 2.0, along, lonlat[:, k]) for k in range(2)])
    return GivenStation(feature.name, feature.name_ja, middle, feature.chainage_m)


def _common_name(tracks: list[Feature]) -> str:
    """Name that all tracks share; empty when they have several."""
    names = {one.name for one in tracks if one.name}
    return names.pop() if len(names) == 1 else ""
