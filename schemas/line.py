"""The line file: where a line runs and how its kilometrage counts.

JSON. Coordinates are WGS 84. `axis_m` is true length along the axis from its first vertex,
`chainage_m` the railway's own kilometrage. Fields that a reader does not know are ignored.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

Vertex = tuple[
    Annotated[float, Meta(ge=-360.0, le=360.0)],
    Annotated[float, Meta(ge=-90.0, le=90.0)],
    Annotated[float, Meta(gt=-20_000.0, lt=20_000.0)],
]
"""Longitude, latitude [deg] and ellipsoidal height of the rail [m]."""


class ChainagePoint(msgspec.Struct, frozen=True, kw_only=True):
    """A place whose kilometrage is known; two at one place are a broken chain."""

    axis_m: Annotated[float, Meta(ge=0.0)]
    chainage_m: float


class Line(msgspec.Struct, frozen=True, kw_only=True):
    """A line."""

    id: Annotated[str, Meta(min_length=1, max_length=64)]
    name: str
    axis: Annotated[tuple[Vertex, ...], Meta(min_length=2)]
    chainage: tuple[ChainagePoint, ...] = ()
    """In order along the axis; chainage is `axis_m` itself when left out."""
