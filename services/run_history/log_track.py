"""A log as a track: places along the line and credible speeds by one clock, and what was found to be wrong with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.line.alignment import Alignment
from services.line.route_projection import RunProjection, project_run
from services.run_history.fixes import RunLog
from services.run_history.place_offset import along_m, common_offset
from services.run_history.speed_credibility import ZERO_MPS, credible_speeds
from services.run_history.speed_lag import speed_lag_s

Floats = NDArray[np.float64]
FEWEST: Final = 20
"""Fixes of a run that anything can be said of."""
PLACE_SIGMA_M: Final = 5.0
MANY_LEFT_OUT: Final = 0.02
TO_AND_FRO_M: Final = 15.0
"""Single fixes are off by some metres; two clocks a second apart put a moving train this far to and fro."""
LEAST_ON_LINE: Final = 0.3
"""Of a run's fixes; fewer, and it is a run on another line."""
FACTOR_KMH: Final = 3.6
TOLD_LAG_S: Final = 1.0
MOST_FROZEN: Final = 0.5
"""Of the speeds above zero; with more of them the others say nothing either."""
SPEED_TOLERANCE: Final = 1.3
"""Above the vehicle's maximum speed by this factor no speed is believed."""


class UnusableLogError(ValueError):
    """A log that no leg can come from, and why."""


@dataclass(frozen=True, slots=True)
class LogTrack:
    """A log along the line. All arrays have shape (n,)."""

    zero_s: float
    """Unix time of t_s = 0."""
    t_s: Floats
    """When the train was there: stamps less the lag of the speeds."""
    place_m: Floats
    """Along the axis; NaN off the line."""
    measured_mps: Floats
    """Credible speeds without sign; NaN where there is none."""
    signed_mps: Floats
    """The same with the sign of the movement along the axis."""
    notes: tuple[str, ...]


def log_track(log: RunLog, ways: Sequence[Alignment], fastest_mps: float) -> LogTrack:
    """Track of a log on a line (the main line is the first of `ways`). Raises UnusableLogError.

    Places are corrected for what the whole log is off by, and moved back to the moment that its speeds tell of; then
    both are of one moment, and the clock is set back by the same lag.
    """
    if len(log.t_unix_s) < FEWEST:
        msg = f"{len(log.t_unix_s)} usable fixes: too few"
        raise UnusableLogError(msg)
    zero_s = float(np.floor(log.t_unix_s[0]))
    t = log.t_unix_s - zero_s
    placed = project_run(ways, t, log.lat_deg, log.lon_deg, PLACE_SIGMA_M)
    on_line = float(np.isfinite(placed.axis_m).mean())
    if on_line < LEAST_ON_LINE:
        msg = f"{on_line:.0%} of its fixes lie near the line: the line of another railway?"
        raise UnusableLogError(msg)
    jump_m = _to_and_fro_m(t, placed.axis_m)
    if jump_m > TO_AND_FRO_M:
        msg = f"its fixes jump to and fro by {jump_m:.0f} m: two devices under one run id, or a wild clock?"
        raise UnusableLogError(msg)
    kmh = _looks_like_kmh(t, placed.axis_m, log.speed_mps)
    speeds = np.ascontiguousarray(log.speed_mps / FACTOR_KMH if kmh else log.speed_mps)
    credible = credible_speeds(t, speeds, SPEED_TOLERANCE * fastest_mps, placed.axis_m)
    frozen = credible.frozen > MOST_FROZEN * int(np.sum(speeds > ZERO_MPS))
    measured = np.full(len(t), np.nan) if frozen else credible.speed_mps
    place = _without_offset(t, placed, ways)
    lag_s = speed_lag_s(t, place, measured)
    known = np.isfinite(measured)
    if lag_s != 0.0:
        place = place - lag_s * _signed(t, place, np.interp(t, t[known], measured[known]))
    notes = _notes(log, kmh=kmh, frozen=frozen, lag_s=lag_s)
    return LogTrack(zero_s, t - lag_s, place, measured, _signed(t, place, measured), notes)


def _without_offset(t_s: Floats, placed: RunProjection, ways: Sequence[Alignment]) -> Floats:
    heading = np.full(len(t_s), np.nan)
    for number, way in enumerate(ways):
        here = placed.route == number
        heading[here] = way.heading_rad(placed.axis_m[here])
    return placed.axis_m - along_m(common_offset(t_s, placed.axis_m, placed.aside_m, heading), heading)


def _notes(log: RunLog, *, kmh: bool, frozen: bool, lag_s: float) -> tuple[str, ...]:
    notes = ["its speeds are km/h: divided by 3.6"] if kmh else []
    rows = len(log.t_unix_s) + log.left_out
    if log.left_out > MANY_LEFT_OUT * rows:
        notes.append(f"{log.left_out} of {rows} rows left out: no place, no time, or a time that was there already")
    if not np.isfinite(log.speed_mps).any():
        notes.append("no speeds in the log: derived from places")
    if frozen:
        notes.append("its speeds repeat one value for most of the way: derived from places")
    if abs(lag_s) > TOLD_LAG_S:
        notes.append(f"its speeds come {lag_s:.1f} s after its places: brought together")
    return tuple(notes)


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
