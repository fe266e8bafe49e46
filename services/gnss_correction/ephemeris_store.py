"""The ephemerides heard so far, ready for the solver."""

from __future__ import annotations

from typing import Final

from schemas.gnss import Ephemeris
from services.gnss_correction.ephemeris_table import EphemerisTable, tabulate

MOST_PER_SATELLITE: Final = 200
"""Two days of GLONASS, whose ephemerides are the shortest; beyond that the oldest is dropped."""


class EphemerisStore:
    """Keeps one ephemeris per satellite, reference time and issue: the one heard last."""

    def __init__(self) -> None:
        """Know none yet."""
        self._of: dict[str, dict[tuple[int, float, int], Ephemeris]] = {}
        self._table: EphemerisTable | None = None

    def add(self, ephemeris: Ephemeris) -> None:
        """Take one in. Of one satellite the newest MOST_PER_SATELLITE by reference time are kept."""
        kept = self._of.setdefault(ephemeris.satellite, {})
        name = (ephemeris.gps_week, ephemeris.toe_s, ephemeris.issue)
        if kept.get(name) == ephemeris:
            return
        kept[name] = ephemeris
        if len(kept) > MOST_PER_SATELLITE:
            del kept[min(kept)]
        self._table = None

    def table(self) -> EphemerisTable:
        """Table of all that is known; made anew only after something was added."""
        if self._table is None:
            self._table = tabulate([one for kept in self._of.values() for one in kept.values()])
        return self._table
