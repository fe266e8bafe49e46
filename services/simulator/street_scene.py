"""Boxes of a scene, drawn from the rows and decks of a scenario."""

from __future__ import annotations

import numpy as np

from services.simulator.line_shape import LineShape
from services.simulator.scenario import BuildingRow, Deck, Range, Scene
from services.simulator.surroundings import Box

OPEN = "open"


def draw_boxes(scene: Scene, line: LineShape, generator: np.random.Generator) -> list[Box]:
    """Buildings of every row, the left side before the right one, then the decks."""
    boxes: list[Box] = []
    for row in scene.rows:
        for side, sign in (("left", 1.0), ("right", -1.0)):
            if row.side in (side, "both"):
                boxes += _row_boxes(row, sign, scene.street_below_rail_m, line, generator)
    return boxes + [_deck_box(deck, line) for deck in scene.decks]


def place_name(scene: Scene, axis_m: float) -> str:
    """What the surroundings at `axis_m` are called: a deck's name before a row's, else 'open'."""
    stretches: tuple[Deck | BuildingRow, ...] = (*scene.decks, *scene.rows)
    for stretch in stretches:
        if stretch.from_m <= axis_m <= stretch.to_m:
            return stretch.name
    return OPEN


def _row_boxes(
    row: BuildingRow, sign: float, street_m: float, line: LineShape, generator: np.random.Generator
) -> list[Box]:
    def draw(between: Range) -> float:
        return float(generator.uniform(*between))

    boxes: list[Box] = []
    start_m = row.from_m + draw(row.gap_m)
    while start_m < row.to_m:
        length_m = min(draw(row.length_m), row.to_m - start_m)
        setback_m, height_m, reflectivity = draw(row.setback_m), draw(row.height_m), draw(row.reflectivity)
        twist = np.deg2rad(row.twist_deg) * float(generator.uniform(-1.0, 1.0))
        here = line.at(start_m + length_m / 2)
        heading = float(here.heading_rad[0])
        across_m = sign * (setback_m + row.depth_m / 2)
        boxes.append(
            Box(
                x_m=float(here.x_m[0]) - across_m * np.sin(heading),
                y_m=float(here.y_m[0]) + across_m * np.cos(heading),
                heading_rad=heading + twist,
                length_m=length_m,
                depth_m=row.depth_m,
                bottom_m=-street_m,
                top_m=height_m - street_m,
                reflectivity=reflectivity,
            )
        )
        start_m += length_m + draw(row.gap_m)
    return boxes


def _deck_box(deck: Deck, line: LineShape) -> Box:
    here = line.at((deck.from_m + deck.to_m) / 2)
    return Box(
        x_m=float(here.x_m[0]),
        y_m=float(here.y_m[0]),
        heading_rad=float(here.heading_rad[0]),
        length_m=deck.to_m - deck.from_m,
        depth_m=deck.width_m,
        bottom_m=deck.clearance_m,
        top_m=deck.clearance_m + deck.thickness_m,
        reflectivity=0.0,
    )
