"""Legs cut out of a train's own positions as they come, by the same core as logs.

Positions are thinned to one a second and kept since the last stop at a station; when the train stands at the next one,
what lies between goes through the analysis of logs. What begins between stations is told as cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import msgspec
import numpy as np

from schemas.line import Line, Station
from schemas.position import TrainPosition
from schemas.runs import RunRecord
from services.line.alignment import Alignment
from services.run_history.fixes import run_log
from services.run_history.leg_ends import V_STOP_MPS
from services.run_history.legs import STATION_REACH_M
from services.run_history.run_analysis import LegRun, analyse_run
from services.run_history.vehicle import Vehicle

NS: Final = 1_000_000_000
INTERVAL_NS: Final = NS
STANDS_S: Final = 15.0
"""So long below V_stop at a station: the smoother has seen the stop from both sides, and no train creeps so long."""
MOST: Final = 7200
"""Positions kept; a train that does not stop at a station for two hours starts anew."""
SILENT_S: Final = 600.0
"""After such a silence nothing is known of what lies between."""


class PlaceSeen(msgspec.Struct, frozen=True, array_like=True):
    """A position of the train, thinned out."""

    t_ns: int
    axis_m: float
    branch: str
    speed_mps: float


class LegBegun(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of the leg under way beside its positions."""

    line_version: str
    run_id: str
    left: str
    """Station's id; empty while it is not known."""
    told: bool
    """Whether the stop that the positions begin with has been told."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """A train has come from one station to another: positions to be analysed."""

    run_id: str
    places: tuple[PlaceSeen, ...]
    left: Station
    reached: Station
    stood_ns: int


class LiveRuns:
    """Legs of one train; single-threaded, but for `record`, which changes nothing."""

    def __init__(self, line: Line, ways: Sequence[Alignment], vehicle: Vehicle) -> None:
        """`ways`: the main line first, then each branch, as for logs."""
        self._line, self._ways, self._vehicle = line, ways, vehicle
        self._by_branch = {way.branch: way for way in ways}
        self._kept: list[PlaceSeen] = []
        self._left: Station | None = None
        """Where the leg began; None while that is not known."""
        self._stood_ns: int | None = None
        """Since when the train stands at a station."""
        self._told = False
        """Whether this stop has been told."""
        self._run_id = ""
        self.ignored = 0
        """Positions without a place, out of order, or off the known routes."""

    def take(self, position: TrainPosition) -> RunRecord | Arrival | None:
        """Take a position; gives an arrival to be analysed by `record`, or the record of a leg that was cut."""
        place = self._place_of(position)
        return None if place is None else self._take(place)

    @property
    def kept(self) -> Sequence[PlaceSeen]:
        """Positions of the leg under way."""
        return self._kept

    def begun(self) -> tuple[LegBegun, tuple[PlaceSeen, ...]]:
        """What `resume` needs to go on from here."""
        left = "" if self._left is None else self._left.id
        known = LegBegun(line_version=self._line.version, run_id=self._run_id, left=left, told=self._told)
        return known, tuple(self._kept)

    def resume(self, begun: LegBegun, places: Sequence[PlaceSeen]) -> list[RunRecord | Arrival]:
        """Go on after a restart; gives what had not been told. Positions of another version of the line are dropped."""
        if begun.line_version != self._line.version:
            return []
        self._run_id, self._told = begun.run_id, begun.told
        self._left = next((one for one in self._line.stations if one.id == begun.left), None)
        known = (one for one in places if one.branch in self._by_branch)
        return [found for place in known if (found := self._take(place)) is not None]

    def _take(self, place: PlaceSeen) -> RunRecord | Arrival | None:
        if self._kept and place.t_ns - self._kept[-1].t_ns < INTERVAL_NS:
            return None
        cut = None
        if self._kept and (place.t_ns - self._kept[-1].t_ns > SILENT_S * NS or len(self._kept) >= MOST):
            cut = self._begin_anew()
        self._kept.append(place)
        self._run_id = self._run_id or f"{place.t_ns // NS}"
        return cut if cut is not None else self._at_station(place)

    def _place_of(self, position: TrainPosition) -> PlaceSeen | None:
        axis_m, speed = position.axis_m, position.speed_mps
        branch = position.branch or ""
        early_ns = self._kept[-1].t_ns - position.t_ns if self._kept else -1
        if early_ns > SILENT_S * NS:  # the clock was set back: what was kept would hold up all that comes
            self._begin_anew()
            early_ns = -1
        if axis_m is None or speed is None or branch not in self._by_branch or early_ns >= 0:
            self.ignored += 1
            return None
        way = self._by_branch[branch]
        return PlaceSeen(position.t_ns, min(max(axis_m, 0.0), way.length_m), branch, abs(speed))

    def _begin_anew(self) -> RunRecord | None:
        """Forget; gives a record cut at its end when the train was under way from a known station."""
        last, left = self._kept[-1], self._left
        under_way = left is not None and self._stood_ns is None
        self._kept, self._left, self._stood_ns, self._told = [], None, None, False
        if not under_way or left is None:
            return None
        return self._cut(last.t_ns, left.id, "", "end", "positions stopped between stations")

    def _at_station(self, place: PlaceSeen) -> RunRecord | Arrival | None:
        station = self._station(place)
        if station is None or place.speed_mps >= V_STOP_MPS:
            self._stood_ns = None
            self._told = False
            return None
        if self._stood_ns is None:
            self._stood_ns = place.t_ns
        if self._told or place.t_ns - self._stood_ns < STANDS_S * NS:
            return None
        self._told = True
        return self._arrived(station)

    def _station(self, place: PlaceSeen) -> Station | None:
        near = min(self._line.stations, key=lambda one: abs(one.axis_m - place.axis_m), default=None)
        if near is None or place.branch or abs(near.axis_m - place.axis_m) > max(STATION_REACH_M, near.platform_m):
            return None
        return near

    def _arrived(self, station: Station) -> RunRecord | Arrival | None:
        left, before = self._left, self._kept
        moved = any(place.speed_mps >= V_STOP_MPS for place in before)
        stood_ns = self._stood_ns if self._stood_ns is not None else before[-1].t_ns
        self._left = station
        self._kept = [place for place in before if place.t_ns >= stood_ns]
        if left is None:
            return self._cut(stood_ns, "", station.id, "start", "known only from between stations") if moved else None
        if left.id == station.id:
            return None
        return Arrival(self._run_id, tuple(before), left, station, stood_ns)

    def record(self, arrival: Arrival) -> RunRecord:
        """Running time and energy of the leg, as logs are analysed; without them where no leg is found. Takes time."""
        places = arrival.places
        lat, lon = np.empty(len(places)), np.empty(len(places))
        for branch, way in self._by_branch.items():
            here = np.array([place.branch == branch for place in places])
            if here.any():
                axis = np.array([place.axis_m for place in places])[here]
                lat[here], lon[here], _ = way.position(axis)
        t_s = np.array([place.t_ns / NS for place in places])
        speed = np.array([place.speed_mps for place in places])
        log = run_log(arrival.run_id, t_s, lat, lon, speed)
        result = analyse_run(log, self._ways, self._line.stations, self._vehicle)
        wanted = (arrival.left.id, arrival.reached.id)
        legs = [leg for leg in result.legs if (leg.start.id, leg.end.id) == wanted]
        if not legs:
            because = result.note or "no leg could be found in its positions"
            return self._cut(arrival.stood_ns, *wanted, "", because)
        return self._record(legs[-1])

    def _record(self, leg: LegRun) -> RunRecord:
        return RunRecord(
            t_ns=round(leg.ends.arrival_s * 1000.0) * 1_000_000,
            run_id=leg.run_id,
            from_station=leg.start.id,
            to_station=leg.end.id,
            direction=leg.direction,
            departure_ns=round(leg.ends.departure_s * 1000.0) * 1_000_000,
            arrival_ns=round(leg.ends.arrival_s * 1000.0) * 1_000_000,
            running_time_s=leg.running_time_s,
            energy_kwh=leg.energy.traction_kwh,
            energy_sigma_kwh=leg.energy.sigma_kwh,
            energy_noise_kwh=leg.energy.noise_kwh,
            energy_noise_sigma_kwh=leg.energy.noise_sigma_kwh,
            regenerated_kwh=leg.energy.regenerated_kwh,
            regenerated_sigma_kwh=leg.energy.regenerated_sigma_kwh,
            auxiliaries_kwh=leg.energy.auxiliaries_kwh,
            auxiliaries_sigma_kwh=leg.energy.auxiliaries_sigma_kwh,
            quality=leg.quality,
            excluded_because=leg.excluded_because,
            series=self._vehicle.group,
            vehicle=self._vehicle.name,
            line_version=self._line.version,
        )

    def _cut(self, t_ns: int, left: str, reached: str, cut: Literal["", "start", "end"], because: str) -> RunRecord:
        return RunRecord(
            t_ns=t_ns,
            run_id=self._run_id,
            from_station=left,
            to_station=reached,
            cut=cut,
            excluded_because=because,
            series=self._vehicle.group,
            vehicle=self._vehicle.name,
            line_version=self._line.version,
        )
