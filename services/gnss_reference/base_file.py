"""Corrections from the recording of a base receiver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from schemas.gnss import Corrections
from services.gnss_receiver.observations import FileIssue, Navigation
from services.gnss_receiver.rinex_observation_file import read_observations
from services.gnss_reference.reference_correction import ReferenceStation, StationSettings


@dataclass(frozen=True, slots=True)
class Base:
    """A recording of a receiver whose place is known."""

    observations: Path
    position_deg: tuple[float, float, float]
    """Latitude, longitude [deg], ellipsoidal height [m] (WGS 84)."""


def read_corrections(
    base: Base, navigation: Navigation, settings: StationSettings, *, beside_ns: int | None = None
) -> tuple[list[Corrections], Sequence[FileIssue]]:
    """Corrections of every epoch of a base, and what was refused in its file.

    `beside_ns` is a time (UTC) of the rover's recording, for a base's that does not name its day.
    Raises ValueError when it holds no epoch, RinexError, OSError.
    """
    observations = read_observations(base.observations, beside_ns=beside_ns)
    if not len(observations):
        msg = f"{base.observations}: no epoch that can be read"
        raise ValueError(msg)
    station = ReferenceStation(base.observations.stem, base.position_deg, settings)
    for ephemeris in navigation.ephemerides:
        station.add(ephemeris)
    if navigation.ionosphere is not None:
        station.add(navigation.ionosphere)
    return list(station.block(observations)), observations.issues
