"""What stands along a line's surroundings as obstacles to satellites: boxes drawn at random, and shade.

A canyon gets facades on both sides, a cutting walls that mirror nothing, a station roof a deck over
platform and track. In a tunnel nothing is received; a forest takes power away, by elevation and in
shadows some metres long.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.line.alignment import Alignment
from services.simulator.local_plane import LocalPlane
from services.simulator.surroundings import Box

Floats = NDArray[np.float64]

SHADOW_M: Final = 6.0
"""Way over which a tree's shadow lasts."""
SHADOW_DB: Final = 4.0
CROWN_DB: Final = 11.0
"""Loss through the crowns towards the horizon (ITU-R P.833: 1 to 1.5 dB/m of leaves at 1.6 GHz)."""


@dataclass(frozen=True, slots=True)
class Rail:
    """The rail at one place, in the plane."""

    xyz_m: Floats
    heading_rad: float
    """Anticlockwise from east."""


def rail_at(alignment: Alignment, plane: LocalPlane, axis_m: float) -> Rail:
    """The rail at a place."""
    around = plane.xyz(alignment.axis.at(np.array([axis_m - 5.0, axis_m, axis_m + 5.0])))
    ahead = around[2] - around[0]
    return Rail(around[1], float(np.arctan2(ahead[1], ahead[0])))


def scene_boxes(alignment: Alignment, plane: LocalPlane, generator: np.random.Generator) -> list[Box]:
    """Boxes along the whole route, in the plane."""
    boxes: list[Box] = []
    for one in alignment.surroundings_along:
        along = (one.start_axis_m, one.end_axis_m)
        if one.kind == "canyon":
            for side in (1.0, -1.0):
                boxes += _row(alignment, plane, along, side, generator)
        elif one.kind == "cutting":
            for side in (1.0, -1.0):
                boxes += _wall(alignment, plane, along, side, generator)
        elif one.kind == "station_roof":
            boxes += _roof(alignment, plane, along)
    return boxes


def _beside(rail: Rail, aside_m: float, length_m: float, depth_m: float, below_m: float, above_m: float) -> Box:
    """A box whose near face is `aside_m` from the track, positive to the left; no mirror."""
    across_m = aside_m + np.sign(aside_m) * depth_m / 2
    return Box(
        x_m=float(rail.xyz_m[0] - across_m * np.sin(rail.heading_rad)),
        y_m=float(rail.xyz_m[1] + across_m * np.cos(rail.heading_rad)),
        heading_rad=rail.heading_rad,
        length_m=length_m,
        depth_m=depth_m,
        bottom_m=float(rail.xyz_m[2]) - below_m,
        top_m=float(rail.xyz_m[2]) + above_m,
        reflectivity=0.0,
    )


def _row(
    alignment: Alignment, plane: LocalPlane, along: tuple[float, float], side: float, generator: np.random.Generator
) -> list[Box]:
    """Buildings 8 to 14 m from the track, 8 to 30 m high, with gaps."""
    boxes: list[Box] = []
    at_m = along[0]
    while at_m < along[1]:
        length_m = float(generator.uniform(12.0, 30.0))
        rail = rail_at(alignment, plane, at_m + length_m / 2)
        box = _beside(
            rail, side * generator.uniform(8.0, 14.0), length_m, 15.0, 6.0, float(generator.uniform(8.0, 30.0))
        )
        twist = np.deg2rad(0.4) * float(generator.uniform(-1.0, 1.0))
        boxes.append(
            Box(
                box.x_m,
                box.y_m,
                box.heading_rad + twist,
                length_m,
                box.depth_m,
                box.bottom_m,
                box.top_m,
                float(generator.uniform(0.35, 0.6)),
            )
        )
        at_m += length_m + float(generator.uniform(3.0, 20.0))
    return boxes


def _wall(
    alignment: Alignment, plane: LocalPlane, along: tuple[float, float], side: float, generator: np.random.Generator
) -> list[Box]:
    """Rock 5 to 7 m from the track, 4 to 12 m high, in pieces of 20 m."""
    boxes = []
    height_m = float(generator.uniform(5.0, 10.0))
    for at_m in np.arange(along[0], along[1], 20.0):
        height_m = float(np.clip(height_m + generator.uniform(-1.5, 1.5), 4.0, 12.0))
        rail = rail_at(alignment, plane, float(at_m) + 10.0)
        boxes.append(_beside(rail, side * generator.uniform(5.0, 7.0), 21.0, 10.0, 1.0, height_m))
    return boxes


def _roof(alignment: Alignment, plane: LocalPlane, along: tuple[float, float]) -> list[Box]:
    """A deck 6 m above the rail, 18 m wide, in pieces of 20 m."""
    boxes = []
    for at_m in np.arange(along[0], along[1], 20.0):
        rail = rail_at(alignment, plane, float(at_m) + 10.0)
        boxes.append(_beside(rail, 0.0, 21.0, 18.0, -6.0, 6.5))
    return boxes


class Foliage:
    """Loss of each satellite's signal under trees."""

    def __init__(self, satellites: int) -> None:
        """Draw the first shadows with the first loss."""
        self._shadow = np.zeros(satellites)
        self._axis_m: float | None = None

    def loss_db(self, axis_m: float, elevation_rad: Floats, generator: np.random.Generator) -> Floats:
        """Loss [dB] of every satellite with the antenna at a place; draws whether there are trees or not."""
        keep = 0.0 if self._axis_m is None else float(np.exp(-abs(axis_m - self._axis_m) / SHADOW_M))
        fresh = generator.standard_normal(len(self._shadow))
        self._shadow = keep * self._shadow + np.sqrt(1.0 - keep**2) * fresh
        self._axis_m = axis_m
        crown = CROWN_DB * (1.0 - 0.75 * np.sin(np.maximum(elevation_rad, 0.0)))
        return np.asarray(np.maximum(crown + SHADOW_DB * self._shadow, 0.0))
