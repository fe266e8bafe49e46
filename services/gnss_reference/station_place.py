"""Where a reference station stands: as it is configured, as its receiver says, and whether both agree."""

from __future__ import annotations

from math import degrees, dist, radians
from typing import Final

from services.gnss_receiver.heard import StationPosition
from services.numerics.geodesy import ecef_from_geodetic, geodetic_from_ecef

MOVED_M: Final = 5.0
"""A place that differs by more is another place: coordinates of one antenna in different frames differ by less."""

Degrees = tuple[float, float, float]
"""Latitude, longitude [deg], ellipsoidal height [m]."""
Ecef = tuple[float, float, float]


class StationPlace:
    """The configured place, or the first one that the receiver says; later ones are held against it."""

    def __init__(self, configured: Degrees | None) -> None:
        """Begin with the configured place, if there is one."""
        self.position_deg = configured
        self.fault = ""
        """Why the place cannot be trusted now; empty when it can."""
        self._configured = configured is not None

    @property
    def position_m(self) -> Ecef | None:
        """Earth-fixed; None while there is no place."""
        return None if self.position_deg is None else _ecef(self.position_deg)

    def hear(self, said: StationPosition) -> None:
        """Take in what the receiver says; `fault` lasts until it says the old place again."""
        if not all(abs(part) < 1e7 for part in said.position_m) or not any(said.position_m):  # noqa: PLR2004 - near the Earth
            # Receivers that do not know their place say zeros.
            return
        place = self.position_m
        if place is None:
            lat_rad, lon_rad, h_m = (float(part) for part in geodetic_from_ecef(*said.position_m))
            self.position_deg = degrees(lat_rad), degrees(lon_rad), h_m
            return
        moved_m = dist(place, said.position_m)
        against = "where it is configured" if self._configured else "where it was"
        self.fault = f"the station says that it stands {moved_m:.1f} m from {against}" if moved_m > MOVED_M else ""


def _ecef(position_deg: Degrees) -> Ecef:
    lat_deg, lon_deg, h_m = position_deg
    x_m, y_m, z_m = ecef_from_geodetic(radians(lat_deg), radians(lon_deg), h_m)
    return float(x_m), float(y_m), float(z_m)
