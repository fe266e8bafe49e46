"""What a leg is worth: quality from 0 to 1, and the reasons that leave it out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.run_history.leg_ends import Ends, Onset
from services.run_history.middle import median_of

Floats = NDArray[np.float64]
LONGEST_GAP_S: Final = 15.0
LONGEST_MISSING_S: Final = 30.0
MOST_ASTRAY_M: Final = 300.0
"""Between the way by places and the way by speeds, over a leg."""
MOST_SUDDEN_M: Final = 45.0
"""The same from standstill to shortly after the first speeds: then these do not tell when the train left."""
SUDDEN_S: Final = 12.0
LONGEST_BLIND_S: Final = 20.0
"""From standstill to the first credible speed, or from the last one: phones hold zero for up to 15 s."""
STANDING_S: Final = 30.0
OFF_SHARE: Final = 0.2
APART_MPS: Final = 1.25
"""Between a measured speed and the smoothed one, which places have a say in …"""
DERIVED: Final = 0.8
"""What speeds from places alone count beside the other faults: they tell a start to some seconds."""
MOST_APART: Final = 0.3
"""… in more than this share of the fixes: places and speeds tell of two different runs."""
HELD_MPS: Final = 15.0 / 3.6
"""Slower between stations, away from both: the train was held."""
HELD_AWAY_S: Final = 45.0


@dataclass(frozen=True, slots=True)
class LegEvidence:
    """What was measured of a leg; arrays of shape (n,), n fixes from the first to the last."""

    t_s: Floats
    place_m: Floats
    """Along the way, rising; NaN off the track."""
    measured_mps: Floats
    """Credible speeds; NaN where there is none."""
    smoothed_mps: Floats


def judged(leg: LegEvidence, ends: Ends, sudden_m: float, blind_s: float) -> tuple[float, str]:
    """Quality from 0 to 1, and why the leg is left out; empty when it counts.

    `sudden_m`: what `sudden_move_m` gave for its start; `blind_s`: the longer of the times between its ends and the
    credible speeds these were told from. Times of `ends` are those of the leg's fixes.
    """
    under_way = slice(*np.searchsorted(leg.t_s, (ends.departure_s, ends.arrival_s)))
    t_s = leg.t_s[under_way]
    gap_s = float(np.max(t_s[1:] - t_s[:-1], initial=0.0))
    missing_s = longest_missing_s(t_s, leg.measured_mps[under_way])
    astray_m = astray(leg)
    off = 1.0 - float(np.isfinite(leg.place_m).mean())
    apart = _apart_share(leg.measured_mps[under_way], leg.smoothed_mps[under_way])
    away = (leg.t_s > ends.rising_s + HELD_AWAY_S) & (leg.t_s < ends.falling_s - HELD_AWAY_S)
    reasons = []
    if gap_s > LONGEST_GAP_S:
        reasons.append(f"a gap of {gap_s:.0f} s")
    if missing_s > LONGEST_MISSING_S:
        reasons.append(f"{missing_s:.0f} s without a credible speed")
    if abs(astray_m) > MOST_ASTRAY_M:
        reasons.append(f"speeds and places disagree by {abs(astray_m):.0f} m of way")
    if abs(sudden_m) > MOST_SUDDEN_M:
        reasons.append(f"speeds and places disagree by {abs(sudden_m):.0f} m at the departure")
    if blind_s > LONGEST_BLIND_S:
        reasons.append(f"{blind_s:.0f} s between a stop and the next credible speed")
    if apart > MOST_APART:
        reasons.append(f"{apart:.0%} of its speeds contradict its places")
    if off > OFF_SHARE:
        reasons.append(f"{off:.0%} of its fixes off the track")
    if np.any(away & (leg.smoothed_mps < HELD_MPS)):
        reasons.append("held between stations")
    if reasons:
        return 0.0, "; ".join(reasons)
    worst = max(
        gap_s / LONGEST_GAP_S,
        missing_s / LONGEST_MISSING_S,
        abs(astray_m) / MOST_ASTRAY_M,
        abs(sudden_m) / MOST_SUDDEN_M,
        blind_s / LONGEST_BLIND_S,
        off / OFF_SHARE,
        apart / MOST_APART,
        0.0 if np.isfinite(leg.measured_mps).any() else DERIVED,
    )
    return round(1.0 - 0.5 * min(worst, 1.0), 2), ""


def _apart_share(measured_mps: Floats, smoothed_mps: Floats) -> float:
    known = np.isfinite(measured_mps)
    return float(np.mean(np.abs(measured_mps - smoothed_mps)[known] > APART_MPS)) if known.any() else 0.0


def astray(leg: LegEvidence) -> float:
    """Way by places less way by speeds, smoothed ones where none was measured [m]; 0 where either is missing."""
    known, placed = np.isfinite(leg.measured_mps), np.flatnonzero(np.isfinite(leg.place_m))
    if known.sum() < 2 or len(placed) < 2:  # noqa: PLR2004 - a way needs two
        return 0.0
    way = _way_m(leg.t_s, np.where(known, leg.measured_mps, leg.smoothed_mps))
    first, last = placed[0], placed[-1]
    return float(leg.place_m[last] - leg.place_m[first] - (way[last] - way[first]))


def sudden_move_m(t_s: Floats, place_m: Floats, measured_mps: Floats, start: Onset) -> float:
    """What the places moved from standstill to shortly after a start's first speeds, less what the speeds explain [m].

    Phones hold their places and speeds in the signal's shadow, and then run after the train.
    """
    near = slice(*np.searchsorted(t_s, (t_s[start.first] - STANDING_S, t_s[start.first] + SUDDEN_S + 1.0)))
    first_s, (t_s, place_m, measured_mps) = t_s[start.first], (t_s[near], place_m[near], measured_mps[near])
    standing = place_m[(t_s < start.still_s) & np.isfinite(place_m)]
    after = (t_s >= first_s) & (t_s <= first_s + SUDDEN_S)
    after &= np.isfinite(place_m) & np.isfinite(measured_mps)
    if not len(standing) or after.sum() < 3:  # noqa: PLR2004 - a median of three
        return 0.0
    ramp_m = float(measured_mps[after][0]) ** 2 / (2.0 * start.slope_mps2)
    by_speed = ramp_m + _way_m(t_s[after], measured_mps[after])
    beyond = place_m[after] - median_of(standing) - by_speed
    early, late = median_of(beyond), median_of(beyond[len(beyond) // 2 :])
    return max(early, late, key=abs)


def longest_missing_s(t_s: Floats, measured_mps: Floats) -> float:
    """Longest time without a credible speed [s]; 0 for a log that has none at all: that is said in its note."""
    known = t_s[np.isfinite(measured_mps)]
    if not len(known):
        return 0.0
    steps = np.diff(np.concatenate((t_s[:1], known, t_s[-1:])))
    return float(steps.max(initial=0.0))


def _way_m(t_s: Floats, speed_mps: Floats) -> Floats:
    return np.concatenate(([0.0], np.cumsum(0.5 * (speed_mps[1:] + speed_mps[:-1]) * (t_s[1:] - t_s[:-1]))))
