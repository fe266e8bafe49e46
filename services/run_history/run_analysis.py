"""One run: from fixes to legs with running time, energy, quality, and the reasons that leave a leg out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from schemas.line import Station
from services.line.alignment import Alignment
from services.run_history.fixes import RunLog
from services.run_history.least_time import least_time_s
from services.run_history.leg_ends import Ends
from services.run_history.leg_quality import LegEvidence, judged, sudden_move_m
from services.run_history.legs import Leg, assumed_ends, ends_by_slope, halt_of, legs_of, start_of, stops_of
from services.run_history.log_track import LogTrack, UnusableLogError, log_track
from services.run_history.speed_noise import acceleration_noise_mps2
from services.run_history.track_smoothing import Smoothed, moving_average, smoothed
from services.run_history.traction_energy import Energy, traction_energy
from services.run_history.vehicle import Vehicle

Floats = NDArray[np.float64]
Direction = Literal["up", "down"]
ENOUGH_SPEEDS: Final = 0.2
"""Share of a leg's fixes with a credible speed; with fewer, its ends come from the smoothed ones."""


@dataclass(frozen=True, slots=True)
class LegRun:
    """A leg as it was run."""

    run_id: str
    start: Station
    end: Station
    direction: Direction
    ends: Ends
    """Seconds since 1970."""
    energy: Energy
    quality: float
    """1: nothing missing, nothing rough; 0: of no use."""
    excluded_because: str
    way_m: Floats
    """Of the leg's fixes, with the two beyond its ends: places along the axis …"""
    t_s: Floats
    """… seconds since 1970 …"""
    speed_mps: Floats
    """… and smoothed speeds."""

    @property
    def running_time_s(self) -> float:
        """From departure to arrival."""
        return self.ends.arrival_s - self.ends.departure_s


@dataclass(frozen=True, slots=True)
class RunResult:
    """What came of a run."""

    run_id: str
    legs: tuple[LegRun, ...]
    note: str = ""
    """Why there is none, or what was found in its log, in words."""


def analyse_run(
    log: RunLog, ways: Sequence[Alignment], stations: Sequence[Station], vehicle: Vehicle, window_s: float | None = None
) -> RunResult:
    """Legs of a run on the main line (the first of `ways`).

    `window_s`: the article's moving average instead of the smoother, and its assumed ramps at both ends.
    """
    try:
        found = log_track(log, ways, vehicle.max_speed_mps)
    except UnusableLogError as reason:
        return RunResult(log.run_id, (), str(reason))
    track = smoothed(found.t_s, found.place_m, found.signed_mps)
    forward = np.abs(track.speed_mps)
    stops = stops_of(found.t_s, track.way_m, forward, stations)
    average = None if window_s is None else moving_average(track.t_s, found.measured_mps, window_s)
    noise = acceleration_noise_mps2(
        track.t_s, found.measured_mps, forward if average is None else np.nan_to_num(average), window_s
    )
    run = _Run(log.run_id, found, track, average, noise)
    legs = tuple(_leg_run(run, leg, ways[0], vehicle) for leg in legs_of(stops))
    return RunResult(log.run_id, legs, "; ".join(found.notes))


@dataclass(frozen=True, slots=True)
class _Run:
    """What all legs of a run have in common."""

    run_id: str
    found: LogTrack
    track: Smoothed
    average_mps: Floats | None
    """The article's moving average; None for the smoother."""
    noise_mps2: float
    """Of the acceleration."""


def _observed_ends(
    run: _Run, leg: Leg, assumed: Ends, speed_mps: Floats, onward_m: Floats
) -> tuple[Ends, float, float]:
    """Ends as the speeds tell them; how far the train had moved [m] at its start, and how long [s] nobody saw it."""
    t_s, measured_mps = run.track.t_s, run.found.measured_mps
    derived = bool(np.isfinite(measured_mps[leg.first - 1 : leg.last + 2]).mean() <= ENOUGH_SPEEDS)
    told_mps = speed_mps if derived else measured_mps
    start = start_of(leg, t_s, told_mps, onward_m, derived=derived)
    halt = halt_of(leg, t_s, told_mps, onward_m, derived=derived)
    sudden_m = 0.0 if start is None else sudden_move_m(t_s, onward_m, measured_mps, start)
    blind_s = max((abs(one.still_s - float(t_s[one.first])) for one in (start, halt) if one), default=0.0)
    return ends_by_slope(assumed, start, halt), sudden_m, blind_s


def _leg_run(run: _Run, leg: Leg, way: Alignment, vehicle: Vehicle) -> LegRun:
    found, track = run.found, run.track
    measured_mps, zero_s = found.measured_mps, found.zero_s
    part = slice(leg.first - 1, leg.last + 2)
    t, places = track.t_s[part], track.way_m[part]
    up = leg.end.station is not None and leg.start.station is not None and leg.end.way_m > leg.start.way_m
    sign = 1.0 if up else -1.0
    onward_m = sign * found.place_m
    speed = np.maximum(sign * track.speed_mps, 0.0)
    acceleration = sign * track.acceleration_mps2
    if run.average_mps is not None:
        speed = np.where(np.isfinite(run.average_mps), run.average_mps, speed)
        acceleration = np.gradient(speed, track.t_s)
    force = vehicle.track_force_n(sign * way.gradient_permille(places), way.curvature_per_m(places))
    energy = traction_energy(
        vehicle, t, speed[part], acceleration[part], track.acceleration_sigma_mps2[part], force, run.noise_mps2
    )
    ends = assumed_ends(leg, track.t_s, speed, vehicle.acceleration_mps2, vehicle.deceleration_mps2)
    sudden_m = blind_s = 0.0
    if run.average_mps is None:
        ends, sudden_m, blind_s = _observed_ends(run, leg, ends, speed, onward_m)
    evidence = LegEvidence(t, onward_m[part], measured_mps[part], speed[part])
    quality, reason = judged(evidence, ends, sudden_m, blind_s)
    if ends.arrival_s - ends.departure_s < least_time_s(way, leg.start.way_m, leg.end.way_m, vehicle.max_speed_mps):
        quality, reason = 0.0, "; ".join((*([reason] if reason else []), "faster than line and vehicle allow"))
    ends = Ends(*(zero_s + one for one in (ends.departure_s, ends.rising_s, ends.falling_s, ends.arrival_s)))
    assert leg.start.station is not None  # noqa: S101 - legs run between stations
    assert leg.end.station is not None  # noqa: S101 - the same
    return LegRun(
        run.run_id,
        leg.start.station,
        leg.end.station,
        "up" if up else "down",
        ends,
        energy,
        quality,
        reason,
        places,
        t + zero_s,
        speed[part],
    )
