"""The axis of a line: from vertices on the ellipsoid to true metres along it, points and directions.

`axis_m` counts true length along the rail from the first vertex, heights included. Points are
Earth-fixed (WGS 84) for measuring, and in a plane tangent at the first vertex (east, north) for
looking places up; 100 km away that plane is flat to 1e-4, which moves no foot of a perpendicular.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.numerics.geodesy import (
    WGS84_A_M,
    ecef_from_geodetic,
    enu_about,
    enu_from_ecef_rotation,
    geodetic_from_ecef,
)

Floats = NDArray[np.float64]

FEWEST_VERTICES: Final = 2
SHORTEST_SEGMENT_M: Final = 1e-3
"""Vertices closer than this are one: a direction cannot be told from them."""
LONGEST_SEGMENT_M: Final = 20_000.0
"""No railway is surveyed with vertices further apart; a coordinate is wrong."""
PLANE_ROUNDS: Final = 6
TANGENT_REACH_M: Final = 4.0
"""Directions are taken over twice this, so that the corners of a polyline do not show."""


class AxisError(ValueError):
    """Vertices that make no axis; `vertex` counts from 0."""

    def __init__(self, vertex: int, text: str) -> None:
        """Name the vertex and what is wrong with it."""
        super().__init__(f"vertex {vertex + 1}: {text}")
        self.vertex = vertex
        self.text = text


@dataclass(frozen=True, slots=True)
class Axis:
    """A polyline in space. Made by `axis_of`."""

    axis_m: Floats
    """Shape (n,), strictly rising from 0."""
    ecef_m: Floats
    """Shape (n, 3)."""
    plane_m: Floats
    """Shape (n, 2): east and north in the plane tangent at the first vertex."""
    reference_deg: tuple[float, float, float]
    """Latitude, longitude [deg] and height [m] of the plane's origin."""
    vertex: NDArray[np.int64]
    """Shape (n,): which of the given vertices each one is (repeated ones were left out)."""

    @property
    def length_m(self) -> float:
        """Length of the whole axis."""
        return float(self.axis_m[-1])

    def at(self, axis_m: ArrayLike) -> Floats:
        """Earth-fixed points (..., 3) of the axis; before its start and beyond its end those ends."""
        wanted = np.asarray(axis_m, float)
        return np.stack([np.interp(wanted, self.axis_m, self.ecef_m[:, k]) for k in range(3)], axis=-1)

    def tangent(self, axis_m: ArrayLike) -> Floats:
        """Unit vectors (..., 3), Earth-fixed, towards rising `axis_m`, over TANGENT_REACH_M to both sides."""
        wanted = np.asarray(axis_m, float)
        inside = np.clip(wanted, 0.0, self.length_m)
        reach = min(TANGENT_REACH_M, self.length_m / 2.0)
        along = self.at(np.minimum(inside + reach, self.length_m)) - self.at(np.maximum(inside - reach, 0.0))
        return np.asarray(along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9))

    def to_plane(self, lat_deg: ArrayLike, lon_deg: ArrayLike, h_m: ArrayLike) -> Floats:
        """East and north (n, 2) of places in the plane of `plane_m`."""
        return np.asarray(enu_about(self.reference_deg, lat_deg, lon_deg, h_m)[:, :2])


def axis_of(lat_deg: ArrayLike, lon_deg: ArrayLike, h_m: ArrayLike) -> Axis:
    """Axis through vertices, each array of shape (n,); vertices that repeat the one before are left out.

    Raises AxisError for fewer than two different vertices, for coordinates that are none and for
    segments too long to be meant.

    >>> round(axis_of([0.0, 0.0], [0.0, 0.001], [0.0, 0.0]).length_m, 2)
    111.32
    """
    lat, lon, height = (np.atleast_1d(np.asarray(one, float)) for one in (lat_deg, lon_deg, h_m))
    sane = (np.abs(lat) <= 90.0) & (np.abs(lon) <= 360.0) & (np.abs(height) < 20_000.0)  # noqa: PLR2004 - angles, and heights on Earth
    if not sane.all():
        wrong = int(np.flatnonzero(~sane)[0])
        raise AxisError(wrong, f"latitude {lat[wrong]}, longitude {lon[wrong]}, height {height[wrong]} m is no place")
    ecef = np.stack(ecef_from_geodetic(np.radians(lat), np.radians(lon), height), axis=-1)
    kept = [0] if len(ecef) else []
    for i in range(1, len(ecef)):
        length_m = float(np.linalg.norm(ecef[i] - ecef[kept[-1]]))
        if length_m > LONGEST_SEGMENT_M:
            raise AxisError(i, f"{length_m / 1000.0:.0f} km from the vertex before")
        if length_m > SHORTEST_SEGMENT_M:
            kept.append(i)
    if len(kept) < FEWEST_VERTICES:
        raise AxisError(0, "an axis needs two different vertices")
    vertex = np.array(kept, np.int64)
    points = ecef[vertex]
    axis_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    reference = (float(lat[0]), float(lon[0]), float(height[0]))
    plane = np.ascontiguousarray(enu_about(reference, lat[vertex], lon[vertex], height[vertex])[:, :2])
    return Axis(axis_m, points, plane, reference, vertex)


def places_of_plane(reference_deg: tuple[float, float, float], plane_m: Floats) -> tuple[Floats, Floats]:
    """Latitudes and longitudes [deg] of points (n, 2) of the plane tangent at a reference, on the ellipsoid itself.

    Undoes `enu_about` of places of height 0, to below 1e-6 m within 200 km.
    """
    lat0_rad, lon0_rad = np.radians(reference_deg[:2])
    origin = np.array(ecef_from_geodetic(lat0_rad, lon0_rad, reference_deg[2]))
    rotation = enu_from_ecef_rotation(float(lat0_rad), float(lon0_rad))
    up_m = -reference_deg[2] - (plane_m**2).sum(axis=1) / (2.0 * WGS84_A_M)
    for _ in range(PLANE_ROUNDS):
        lat, lon, height = geodetic_from_ecef(*(origin + np.column_stack([plane_m, up_m]) @ rotation).T)
        up_m = up_m - height
    return np.degrees(lat), np.degrees(lon)
