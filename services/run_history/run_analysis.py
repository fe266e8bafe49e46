"""One run: from fixes to legs with running time, energy, quality, and the reasons that leave a leg out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from schemas.line import Station
from services.line.alignment import Alignment
from services.line.route_projection import project_run
from services.run_history.fixes import RunLog
from services.run_history.leg_ends import Ends
from services.run_history.leg_quality import LegEvidence, judged, sudden_move_m
from services.run_history.legs import Leg, assumed_ends, ends_by_slope, halt_of, legs_of, start_of, stops_of
from services.run_history.speed_credibility import credible_speeds
from services.run_history.track_smoothing import Smoothed, moving_average, smoothed
from services.run_history.traction_energy import Energy, traction_energy
from services.run_history.vehicle import Vehicle

Floats = NDArray[np.float64]
Direction = Literal["up", "down"]
FEWEST: Final = 20
"""Fixes of a run that anything can be said of."""
PLACE_SIGMA_M: Final = 5.0
MANY_LEFT_OUT: Final = 0.02
TO_AND_FRO_M: Final = 15.0
"""Single fixes are off by some metres; two clocks a second apart put a moving train this far to and fro."""
LEAST_ON_LINE: Final = 0.3
"""Of a run's fixes; fewer, and it is a run on another line."""
ENOUGH_SPEEDS: Final = 0.2
"""Share of a leg's fixes with a credible speed; with fewer, its ends come from the smoothed ones."""
FACTOR_KMH: Final = 3.6


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
    if len(log.t_unix_s) < FEWEST:
        return RunResult(log.run_id, (), f"{len(log.t_unix_s)} usable fixes: too few")
    zero_s = float(np.floor(log.t_unix_s[0]))
    t = log.t_unix_s - zero_s
    placed = project_run(ways, t, log.lat_deg, log.lon_deg, PLACE_SIGMA_M)
    on_line = np.isfinite(placed.axis_m)
    if on_line.mean() < LEAST_ON_LINE:
        return RunResult(
            log.run_id, (), f"{on_line.mean():.0%} of its fixes lie near the line: the line of another railway?"
        )
    jump_m = _to_and_fro_m(t, placed.axis_m)
    if jump_m > TO_AND_FRO_M:
        return RunResult(
            log.run_id,
            (),
            f"its fixes jump to and fro by {jump_m:.0f} m: two devices under one run id, or a wild clock?",
        )
    kmh = _looks_like_kmh(t, placed.axis_m, log.speed_mps)
    speeds = log.speed_mps / FACTOR_KMH if kmh else log.speed_mps
    credible = credible_speeds(t, np.ascontiguousarray(speeds), 1.3 * vehicle.max_speed_mps)
    notes = ["its speeds are km/h: divided by 3.6"] if kmh else []
    rows = len(t) + log.left_out
    if log.left_out > MANY_LEFT_OUT * rows:
        notes.append(f"{log.left_out} of {rows} rows left out: no place, no time, or a time that was there already")
    if not np.isfinite(log.speed_mps).any():
        notes.append("no speeds in the log: derived from places")
    signed = _signed(t, placed.axis_m, credible.speed_mps)
    track = smoothed(t, placed.axis_m, signed)
    speed = np.abs(track.speed_mps)
    stops = stops_of(t, track.way_m, speed, stations)
    legs = tuple(
        _leg_run(log.run_id, zero_s, leg, track, credible.speed_mps, placed.axis_m, ways[0], vehicle, window_s)
        for leg in legs_of(stops)
    )
    return RunResult(log.run_id, legs, "; ".join(notes))


def _to_and_fro_m(t_s: Floats, axis_m: Floats) -> float:
    """Median distance of moving fixes from where their two neighbours put them; 0 with too few of them."""
    at, ahead, behind = axis_m[1:-1], axis_m[2:], axis_m[:-2]
    span_s = t_s[2:] - t_s[:-2]
    near = np.isfinite(at + ahead + behind) & (span_s < 5.0)  # noqa: PLR2004 - neighbours, no gap
    moving = near & (np.abs(ahead - behind) > 5.0 * span_s)
    if moving.sum() < FEWEST:
        return 0.0
    expected = behind + (ahead - behind) * (t_s[1:-1] - t_s[:-2]) / span_s
    return float(np.median(np.abs(at - expected)[moving]))


def _looks_like_kmh(t_s: Floats, axis_m: Floats, speed_mps: Floats) -> bool:
    """Whether places move at a 3.6th of the stated speeds."""
    step_s = np.diff(t_s)
    by_places = np.abs(np.diff(axis_m)) / np.maximum(step_s, 0.1)
    stated = 0.5 * (speed_mps[1:] + speed_mps[:-1])
    usable = np.isfinite(by_places) & (stated > 5.0) & (step_s < 5.0)  # noqa: PLR2004 - moving, and close together
    if usable.sum() < FEWEST:
        return False
    ratio = float(np.median(by_places[usable] / stated[usable]))
    return 0.8 < ratio * FACTOR_KMH < 1.2  # noqa: PLR2004 - a third off either way is something else


def _signed(t_s: Floats, axis_m: Floats, speed_mps: Floats) -> Floats:
    """Speeds with the sign of the movement along the axis: trains turn back at termini."""
    reach_s = 30.0
    known = np.isfinite(axis_m)
    if known.sum() < 2:  # noqa: PLR2004 - a direction needs two
        return speed_mps
    before = np.interp(t_s - reach_s, t_s[known], axis_m[known])
    after = np.interp(t_s + reach_s, t_s[known], axis_m[known])
    moved = after - before
    sign = np.where(np.abs(moved) > 30.0, np.sign(moved), 0.0)  # noqa: PLR2004 - more than fixes wander
    last = np.sign(float(axis_m[known][-1] - axis_m[known][0])) or 1.0
    index = np.where(sign != 0.0, np.arange(len(sign)), -1)
    held = np.maximum.accumulate(index)
    return speed_mps * np.where(held >= 0, sign[np.maximum(held, 0)], last)


def _leg_run(
    run_id: str,
    zero_s: float,
    leg: Leg,
    track: Smoothed,
    measured_mps: Floats,
    placed_m: Floats,
    way: Alignment,
    vehicle: Vehicle,
    window_s: float | None,
) -> LegRun:
    part = slice(leg.first - 1, leg.last + 2)
    t, places = track.t_s[part], track.way_m[part]
    up = leg.end.station is not None and leg.start.station is not None and leg.end.way_m > leg.start.way_m
    sign = 1.0 if up else -1.0
    speed = np.maximum(sign * track.speed_mps, 0.0)
    acceleration = sign * track.acceleration_mps2
    if window_s is not None:
        average = moving_average(track.t_s, measured_mps, window_s)
        speed = np.where(np.isfinite(average), average, speed)
        acceleration = np.gradient(speed, track.t_s)
    force = vehicle.track_force_n(sign * way.gradient_permille(places), way.curvature_per_m(places))
    energy = traction_energy(vehicle, t, speed[part], acceleration[part], track.acceleration_sigma_mps2[part], force)
    ends = assumed_ends(leg, track.t_s, speed, vehicle.acceleration_mps2, vehicle.deceleration_mps2)
    sudden_m = 0.0
    if window_s is None:
        told_mps = measured_mps if np.isfinite(measured_mps[part]).mean() > ENOUGH_SPEEDS else speed
        start, halt = start_of(leg, track.t_s, told_mps), halt_of(leg, track.t_s, told_mps)
        ends = ends_by_slope(ends, start, halt)
        sudden_m = 0.0 if start is None else sudden_move_m(track.t_s, sign * placed_m, measured_mps, start)
    evidence = LegEvidence(t, sign * placed_m[part], measured_mps[part], speed[part])
    quality, reason = judged(evidence, ends, sudden_m)
    ends = Ends(*(zero_s + one for one in (ends.departure_s, ends.rising_s, ends.falling_s, ends.arrival_s)))
    assert leg.start.station is not None  # noqa: S101 - legs run between stations
    assert leg.end.station is not None  # noqa: S101 - the same
    return LegRun(
        run_id,
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
