"""Everything that a receiver's stream can say, whatever its protocol."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.gnss import Ephemeris, Epoch, Ionosphere, OwnPosition


@dataclass(frozen=True, slots=True)
class StationPosition:
    """Where a reference station says that its antenna is (RTCM 1005, 1006)."""

    station: int
    """Number of the station, 0 to 4095."""
    position_m: tuple[float, float, float]
    """Antenna reference point, Earth-fixed."""
    antenna_height_m: float | None = None
    """Antenna reference point above the marker; None in 1005."""


Heard = Epoch | Ephemeris | Ionosphere | OwnPosition | StationPosition
