"""Which ephemeris of each satellite a receiver would hold at a time, out of a whole file of them."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf

from schemas.gnss import Ephemeris
from schemas.gnss_time import WEEK_S


@dataclass(slots=True)
class _Candidates:
    """Ephemerides of one satellite by reference time; between two of them the midpoint decides."""

    ephemerides: list[Ephemeris]
    changes_s: list[float]
    chosen: int | None = None


@dataclass(slots=True)
class BroadcastChoice:
    """Chooses for every satellite the ephemeris whose reference time is nearest, and says when that changes.

    Times are seconds since the GPS epoch. Of two with the same reference time, the one sent later is taken.
    """

    _satellites: list[_Candidates]
    _from_s: float = field(default=inf, init=False)
    """The choice made last holds from here to `_until_s`."""
    _until_s: float = field(default=-inf, init=False)

    @classmethod
    def of(cls, ephemerides: Iterable[Ephemeris]) -> BroadcastChoice:
        """Choice out of these, nothing chosen yet."""
        by_satellite: dict[str, dict[float, Ephemeris]] = {}
        for ephemeris in sorted(ephemerides, key=lambda each: each.t_ns):
            by_satellite.setdefault(ephemeris.satellite, {})[_toe_s(ephemeris)] = ephemeris
        satellites = []
        for _, by_time in sorted(by_satellite.items()):
            times_s = sorted(by_time)
            middles_s = [(a + b) / 2 for a, b in pairwise(times_s)]
            satellites.append(_Candidates([by_time[time_s] for time_s in times_s], middles_s))
        return cls(satellites)

    def changed(self, gps_s: float) -> list[Ephemeris]:
        """Ephemerides newly chosen at `gps_s`, by satellite; at the first call all of them."""
        if self._from_s <= gps_s < self._until_s:
            return []
        self._from_s, self._until_s = -inf, inf
        changed = []
        for satellite in self._satellites:
            index = bisect_right(satellite.changes_s, gps_s)
            if index:
                self._from_s = max(self._from_s, satellite.changes_s[index - 1])
            if index < len(satellite.changes_s):
                self._until_s = min(self._until_s, satellite.changes_s[index])
            if index != satellite.chosen:
                satellite.chosen = index
                changed.append(satellite.ephemerides[index])
        return changed


def _toe_s(ephemeris: Ephemeris) -> float:
    return ephemeris.gps_week * WEEK_S + ephemeris.toe_s
