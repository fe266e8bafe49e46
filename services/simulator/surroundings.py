"""What stands beside and above a line: buildings that hide satellites and mirror them.

Everything is in the line's plane: x east, y north, z up from the rail [m]. A building is an upright
box over a rectangle; a deck is a flat cover over a rectangle (an overbridge, a station roof).
Rays are straight: no diffraction, no ground reflection, one bounce at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.int64]

NEAR_M = 350.0
"""Boxes farther away than this from the antenna are left out: 60 m of height hide 10 degrees there."""
SKIN_M = 1e-3
"""A reflection point stands this far in front of its facade, so that the facade does not hide it."""
GRAZING = 0.03
"""Smallest sine of the angle between ray and facade for which a facade mirrors (about 2 degrees)."""


@dataclass(frozen=True, slots=True)
class Box:
    """An upright box: rectangle `length_m` by `depth_m` about (x, y), from `bottom_m` to `top_m`."""

    x_m: float
    y_m: float
    heading_rad: float
    """Direction of the length, anticlockwise from east."""
    length_m: float
    depth_m: float
    bottom_m: float
    top_m: float
    reflectivity: float
    """Amplitude that a facade gives back, polarisation loss at the antenna included; 0: none."""


@dataclass(frozen=True, slots=True)
class Reflections:
    """Single-bounce paths from satellites to the antenna; one row per path."""

    satellite: Indices
    """Row of the satellite in the directions that were asked about."""
    facade: Indices
    """Number of the facade, the same as long as the scene lives."""
    excess_m: Floats
    """Longer than the direct path by this."""
    excess_rate_mps: Floats
    amplitude: Floats


class Surroundings:
    """All boxes of a scene, and the rays among them."""

    def __init__(self, boxes: Sequence[Box]) -> None:
        """Lay out the boxes and their four facades each."""
        columns = [
            (b.x_m, b.y_m, b.heading_rad, b.length_m, b.depth_m, b.bottom_m, b.top_m, b.reflectivity) for b in boxes
        ]
        table = np.array(columns, dtype=np.float64).reshape(len(boxes), 8)
        self._centre = table[:, :2]
        self._along = np.stack([np.cos(table[:, 2]), np.sin(table[:, 2])], axis=1)
        self._half = table[:, 3:5] / 2
        self._bottom, self._top, self._reflectivity = table[:, 5], table[:, 6], table[:, 7]
        self._reach = np.hypot(self._half[:, 0], self._half[:, 1])
        across = np.stack([-self._along[:, 1], self._along[:, 0]], axis=1)
        self._normals = np.stack([across, -across, self._along, -self._along], axis=1)
        self._depths = self._half[:, [1, 1, 0, 0]]
        self._widths = self._half[:, [0, 0, 1, 1]]

    def __len__(self) -> int:
        """Give the number of boxes."""
        return len(self._top)

    def near(self, position_m: Floats) -> Indices:
        """Boxes within NEAR_M of a position of shape (3,)."""
        away = self._centre - position_m[:2]
        return np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) < NEAR_M + self._reach)

    def hidden(self, near: Indices, origin_m: Floats, direction: Floats, reach_m: Floats) -> Bools:
        """Whether a box of `near` stands in each ray.

        `origin_m` (k, 3), unit `direction` (k, 3), `reach_m` (k,) length of the ray, infinite for
        one that goes to a satellite. In a box's own frame a ray is inside the rectangle between
        two lengths (slab method); it hits if its height there lies between bottom and top.
        """
        along = self._along[near]
        offset = origin_m[:, None, :2] - self._centre[near]
        ahead = direction[:, None, :2]
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        slabs = [((offset * axis).sum(axis=2), (ahead * axis).sum(axis=2)) for axis in (along, across)]
        enter, leave = np.zeros((len(origin_m), len(near))), np.broadcast_to(reach_m[:, None], offset.shape[:2])
        for half, (start, rate) in zip(self._half[near].T, slabs, strict=True):
            safe = np.where(np.abs(rate) < 1e-12, 1e-12, rate)  # noqa: PLR2004 - parallel to the slab: far away or everywhere
            one, other = (-half - start) / safe, (half - start) / safe
            enter = np.maximum(enter, np.minimum(one, other))
            leave = np.minimum(leave, np.maximum(one, other))
        with np.errstate(invalid="ignore"):
            z_in = origin_m[:, 2:] + enter * direction[:, 2:]
            z_out = origin_m[:, 2:] + leave * direction[:, 2:]
        low, high = np.fmin(z_in, z_out), np.fmax(z_in, z_out)
        hits = (enter < leave) & (low < self._top[near]) & (high > self._bottom[near])
        return np.asarray(hits.any(axis=1))

    def reflections(self, near: Indices, position_m: Floats, velocity_mps: Floats, direction: Floats) -> Reflections:
        """Paths over one facade of `near` from satellites in unit `direction` (k, 3) to the antenna.

        The antenna mirrored at the facade's plane, a = n.(p - w) in front of it, sees the satellite
        through the reflection point; the path is longer by 2 a (n.d), and as the train moves that
        changes by 2 (n.v) (n.d). The point must lie on the facade and both legs must be free.
        """
        normal = self._normals[near].reshape(-1, 2)
        facade = (4 * near[:, None] + np.arange(4)).reshape(-1)
        depth, width = self._depths[near].reshape(-1), self._widths[near].reshape(-1)
        centre = np.repeat(self._centre[near], 4, axis=0)
        bottom, top, reflectivity = (
            np.repeat(column[near], 4) for column in (self._bottom, self._top, self._reflectivity)
        )
        offset = position_m[:2] - centre
        ahead_m = (normal * offset).sum(axis=1) - depth
        towards = direction[:, :2] @ normal.T
        length_m = ahead_m / np.where(towards > GRAZING, towards, 1.0)
        tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        sideways = (tangent * offset).sum(axis=1) + length_m * (direction[:, :2] @ tangent.T)
        height = position_m[2] + length_m * direction[:, 2:]
        found = (ahead_m > SKIN_M) & (towards > GRAZING) & (reflectivity > 0)
        found &= (np.abs(sideways) < width) & (height > bottom) & (height < top)
        satellite, wall = np.nonzero(found)
        spot = position_m + length_m[satellite, wall, None] * direction[satellite]
        spot[:, :2] -= (2 * ahead_m[wall] - SKIN_M)[:, None] * normal[wall]
        leg = spot - position_m
        leg_m = np.sqrt((leg * leg).sum(axis=1))
        origins = np.concatenate([spot, np.broadcast_to(position_m, spot.shape)])
        ways = np.concatenate([direction[satellite], leg / leg_m[:, None]])
        reaches = np.concatenate([np.full(len(spot), np.inf), leg_m])
        free = ~self.hidden(near, origins, ways, reaches).reshape(2, -1).any(axis=0)
        satellite, wall = satellite[free], wall[free]
        cosine = towards[satellite, wall]
        return Reflections(
            satellite=satellite,
            facade=facade[wall],
            excess_m=2 * ahead_m[wall] * cosine,
            excess_rate_mps=2 * (normal[wall] @ velocity_mps[:2]) * cosine,
            amplitude=reflectivity[wall],
        )
