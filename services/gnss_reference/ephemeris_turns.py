"""Corrections for two ephemerides of a satellite in turns, while trains may use either.

A correction holds for one ephemeris. When a satellite changes it, trains and station notice within a minute of each
other; a train just out of a tunnel still has the old one, and one that has just been switched on knows the newest one
alone. RTCM 10402.3 keeps the old issue for 90 s after a change and sends the difference to the new one beside it
(message 2). Here a message holds one correction of each satellite, so the two take turns, epoch by epoch: a train uses
the latest that fits its own ephemeris, which is one epoch older at most.

    correction' = correction + modelled' - modelled

with the range and satellite clock that each ephemeris says at the station.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from msgspec.structs import replace

from schemas.gnss import Corrections, Ephemeris, SatelliteCorrection
from schemas.gnss_time import WEEK_S
from services.gnss_correction.ephemeris_table import tabulate
from services.gnss_correction.preparation import SignalStrengths, prepare
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.solver_arrays import RULES
from services.gnss_correction.station_sight import Station, see_from
from services.gnss_receiver.observations import Observations, satellite_name

HOLD_S: Final = 300.0
"""How long the ephemeris before stays in use beside a new one: trains in tunnels and stations have it so long."""
FOLLOWS_S: Final = 2.5
"""Epochs further apart give no rate of the difference."""
LARGEST_DIFFERENCE_M: Final = 100.0
"""Ephemerides of one satellite that are further apart do not both hold: it was moved, or one is broken."""
_KEPT: Final = 6
"""Ephemerides of a satellite; Galileo sends one every ten minutes."""
_USABLE: Final = int(Rejection.USABLE)

Name = tuple[int, float, int]
"""GPS week and time of reference, issue."""


@dataclass(frozen=True, slots=True)
class _Known:
    ephemeris: Ephemeris
    heard_s: float


class EphemerisTurns:
    """Which ephemerides of each satellite are in use, and whose turn it is."""

    def __init__(self, station: Station, systems: str) -> None:
        """Know no ephemeris yet; `systems` are the constellations that are corrected."""
        self._station, self._systems = station, systems
        self._known: dict[str, dict[Name, _Known]] = {}
        self._differences: dict[tuple[str, Name, Name], tuple[float, float]] = {}
        self._is_others = False

    def add(self, ephemeris: Ephemeris, gps_s: float) -> None:
        """Take in an ephemeris heard at `gps_s`, which counts from the GPS epoch; -inf before the first epoch."""
        kept = self._known.setdefault(ephemeris.satellite, {})
        before = kept.get(_name(ephemeris))
        kept[_name(ephemeris)] = _Known(ephemeris, before.heard_s if before else gps_s)
        if len(kept) > _KEPT:
            del kept[min(kept, key=lambda name: kept[name].ephemeris.t_ns)]

    def other(self, satellite: str, used: Name, gps_s: float) -> Ephemeris | None:
        """Ephemeris that trains may use besides the one `used`; None where there is none.

        The newest, where that is not the one used; else the one before it, for HOLD_S.
        """
        kept = self._known.get(satellite, {})
        others = [one for name, one in kept.items() if name != used]
        if used not in kept or not others:
            return None
        latest = max(others, key=lambda one: one.ephemeris.t_ns)
        is_newer = latest.ephemeris.t_ns > kept[used].ephemeris.t_ns
        if not is_newer and gps_s - kept[used].heard_s > HOLD_S:
            return None
        found = latest.ephemeris
        age_s = abs(gps_s - found.gps_week * WEEK_S - found.toe_s)
        return found if found.healthy and age_s <= found.fit_interval_s else None

    def spoken(self, corrections: Corrections, observations: Observations) -> Corrections:
        """Corrections to be said now, from those of the station's own choice; `observations` are that one epoch."""
        gps_s = corrections.gps_week * WEEK_S + corrections.tow_s
        pairs: dict[str, tuple[Ephemeris, Ephemeris]] = {}
        for one in corrections.satellites:
            used = (one.toe_week, one.toe_s, one.issue)
            other = self.other(one.satellite, used, gps_s)
            if other is not None:
                pairs[one.satellite] = self._known[one.satellite][used].ephemeris, other
        if not pairs:
            self._is_others = False
            return corrections
        modelled_m = self._modelled_m(pairs, observations)
        given = {
            one.satellite: for_other
            for one in corrections.satellites
            if (for_other := self._moved(one, pairs, modelled_m, gps_s)) is not None
        }
        self._is_others = not self._is_others
        if not self._is_others:
            return corrections
        satellites = tuple(given.get(one.satellite, one) for one in corrections.satellites)
        return replace(corrections, satellites=satellites)

    def _modelled_m(
        self, pairs: Mapping[str, tuple[Ephemeris, Ephemeris]], observations: Observations
    ) -> dict[str, tuple[float, float]]:
        """Modelled ranges by both ephemerides of each satellite, without air and receiver clock."""
        by_used, by_other = (self._ranges_m((pair[which] for pair in pairs.values()), observations) for which in (0, 1))
        return {name: (by_used[name], by_other[name]) for name in pairs if name in by_used and name in by_other}

    def _ranges_m(self, ephemerides: Iterable[Ephemeris], observations: Observations) -> dict[str, float]:
        table = tabulate(list(ephemerides))
        prepared = prepare(observations, np.zeros(1, bool), table, self._systems, SignalStrengths(0.0))
        rows = prepared.rows[prepared.rows["rejection"] == _USABLE]
        see_from(self._station, rows, float(prepared.t_s[0]), np.zeros(1, RULES)[0])
        names = [satellite_name(code) for code in rows["satellite"].tolist()]
        return dict(zip(names, rows["modelled_m"].tolist(), strict=True))

    def _moved(
        self,
        one: SatelliteCorrection,
        pairs: Mapping[str, tuple[Ephemeris, Ephemeris]],
        modelled_m: Mapping[str, tuple[float, float]],
        gps_s: float,
    ) -> SatelliteCorrection | None:
        """A satellite's correction for its other ephemeris; None where it has none."""
        if one.satellite not in modelled_m:
            return None
        used, other = pairs[one.satellite]
        difference_m = modelled_m[one.satellite][1] - modelled_m[one.satellite][0]
        if not abs(difference_m) <= LARGEST_DIFFERENCE_M:
            return None
        key = (one.satellite, _name(used), _name(other))
        before_s, before_m = self._differences.get(key, (-np.inf, 0.0))
        self._differences = {name: value for name, value in self._differences.items() if name[0] != one.satellite}
        self._differences[key] = gps_s, difference_m
        since_s = gps_s - before_s
        rate_mps = (difference_m - before_m) / since_s if 0.0 < since_s <= FOLLOWS_S else 0.0
        return replace(
            one,
            issue=other.issue,
            toe_week=other.gps_week,
            toe_s=other.toe_s,
            correction_m=one.correction_m + difference_m,
            rate_mps=one.rate_mps + rate_mps,
        )


def _name(ephemeris: Ephemeris) -> Name:
    return ephemeris.gps_week, ephemeris.toe_s, ephemeris.issue
