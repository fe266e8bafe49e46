"""A smoothed axis laid onto the ellipsoid as the vertices of a line file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.line import Curve, Vertex
from services.line.axis import Axis, places_of_plane
from services.line.curve_fitting import FittedCurve, fit_curves
from services.line.route import axis_through
from services.line.smoothing import SmoothAxis, lengths_m, smooth
from services.line.station_placing import foot

Floats = NDArray[np.float64]

STRAIGHT_STRIDE: Final = 2
"""On straights every second point of the smoothed grid becomes a vertex."""
STRAIGHT_PER_M: Final = 1.0 / 10_000.0
AWAY_M: Final = 100.0
"""A branch's direction is taken over this length."""


@dataclass(frozen=True, slots=True)
class LaidWay:
    """A way as vertices of a line file, with where each of them lies on the smoothed axis."""

    smooth: SmoothAxis
    vertices: tuple[Vertex, ...]
    along_m: Floats
    """Shape (n,): of each vertex along the smoothed axis."""
    axis_m: Floats
    """Shape (n,): of each vertex along the polyline."""

    def to_axis(self, along_m: float) -> float:
        """`axis_m` of a place of the smoothed axis, in whole millimetres, never beyond the end."""
        return min(round(float(np.interp(along_m, self.along_m, self.axis_m)), 3), float(self.axis_m[-1]))

    @property
    def beside(self) -> Axis:
        """The smoothed axis in its plane, to project other tracks onto."""
        flat = np.column_stack([self.smooth.plane_m, np.zeros(len(self.smooth.plane_m))])
        return Axis(self.smooth.along_m, flat, self.smooth.plane_m, (0.0, 0.0, 0.0), np.arange(len(flat)))

    def curves(self) -> tuple[Curve, ...]:
        """Fitted curves as the line file has them."""
        return tuple(self._curve(fitted) for fitted in fit_curves(self.smooth))

    def _curve(self, fitted: FittedCurve) -> Curve:
        bend = fitted.bend
        start_m, end_m = self.to_axis(bend.start_m), self.to_axis(bend.end_m)
        room_m = end_m - start_m
        share = min(1.0, room_m / max(bend.transition_in_m + bend.transition_out_m, 1e-9))
        return Curve(
            start_axis_m=start_m,
            end_axis_m=end_m,
            transition_in_m=round(share * bend.transition_in_m, 3),
            transition_out_m=round(share * bend.transition_out_m, 3),
            radius_m=round(fitted.radius_m, 2),
            radius_sigma_m=round(fitted.radius_sigma_m, 2),
            place_sigma_m=round(max(fitted.start_sigma_m, fitted.end_sigma_m), 2),
        )


def lay(reference_deg: tuple[float, float, float], axis: SmoothAxis, height_m: Floats, start_axis_m: float) -> LaidWay:
    """Vertices of a smoothed axis (every second point on straights); `height_m` (n,) are those of its grid."""
    keep = np.abs(axis.curvature_per_m) > STRAIGHT_PER_M
    keep[::STRAIGHT_STRIDE] = True
    keep[[0, -1]] = True
    lat, lon = places_of_plane(reference_deg, axis.plane_m[keep])
    vertices = tuple(
        (round(x, 9), round(y, 9), round(h, 3))
        for x, y, h in zip(lon.tolist(), lat.tolist(), height_m[keep].tolist(), strict=True)
    )
    return LaidWay(axis, vertices, axis.along_m[keep], start_axis_m + axis_through(vertices).axis_m)


def lay_branch(
    reference_deg: tuple[float, float, float], plane_m: Floats, main: LaidWay, vertex_accuracy_m: float
) -> tuple[LaidWay, float] | None:
    """A branch (n, 2), level with its junction, and where it leaves the main line; None where it leaves backwards."""
    grid = main.smooth
    at_m, _ = foot(plane_m[0], grid.along_m, grid.plane_m)
    k = int(np.clip(np.searchsorted(grid.along_m, at_m) - 1, 0, len(grid.along_m) - 2))
    ahead = grid.plane_m[k + 1] - grid.plane_m[k]
    length = lengths_m(plane_m)
    away = [float(np.interp(min(AWAY_M, length[-1]), length, plane_m[:, j])) for j in range(2)] - plane_m[0]
    if float(ahead @ away) < 0.0:
        return None
    start = grid.plane_m[k] + (at_m - grid.along_m[k]) / (grid.along_m[k + 1] - grid.along_m[k]) * ahead
    axis = smooth(np.concatenate([[start], plane_m[1:]]), vertex_accuracy_m)
    leaves_m = main.to_axis(at_m)
    height_m = float(np.interp(leaves_m, main.axis_m, [vertex[2] for vertex in main.vertices]))
    axis.plane_m[0] = start
    return lay(reference_deg, axis, np.full(len(axis.along_m), height_m), leaves_m), leaves_m
