"""How good odometry is against a known truth: slips, errors, bounds.

An output may lag behind by a constant time without harm to distances between two instants: up to 0.6 s are
found and taken out where slips are judged. Bounds are judged without any allowance.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.odometry_fusion.motion_log import Floats

BEFORE_S: Final = 3.0
AFTER_S: Final = 11.0
"""A slip's error is that of the distance from so long before it to so long after it."""
SETTLED_S: Final = 8.0
"""From so long after a slip until AFTER_S the wheel must have been taken up again."""
LEAST_COST_M: Final = 1.0
"""Slips that cost the wheel less are no matter of re-adhesion."""
WITHIN_M: Final = 20.0
"""2 % of 1 km (Iwata et al., section 4.3.1)."""
LAGS_S: Final = tuple(0.05 * step for step in range(13))


@dataclass(frozen=True, slots=True, eq=False)
class MotionTrack:
    """Odometry to be judged, columns of shape (n,)."""

    name: str
    t_s: Floats
    distance_m: Floats
    speed_mps: Floats
    slip: NDArray[np.bool_]
    bound_m: Floats
    """NaN where there is none."""
    status: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class MotionTruth:
    """What the train really did, columns of shape (n,)."""

    t_s: Floats
    distance_m: Floats
    speed_mps: Floats
    slip: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class WheelWay:
    """Way of the wheel's rim by its pulses, columns of shape (n,)."""

    t_s: Floats
    way_m: Floats


class SlipSpan(NamedTuple):
    """A true slip."""

    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class SlipResult:
    """How one true slip was met."""

    span: SlipSpan
    error_m: float
    """Error of the distance across it."""
    cost_m: float
    """What it cost the wheel; NaN without pulses."""
    detected: bool
    early: bool
    """The wheel was taken up again while it still slipped."""
    adheres: bool
    """The wheel was taken up again in time, and not before."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Figures of one track; lengths in metres, shares in percent."""

    name: str
    hours: float
    slips: int
    counted: int
    """Slips that cost the wheel more than LEAST_COST_M."""
    detected: int
    readhered_percent: float | None
    early: int
    median_m: float | None
    p95_m: float | None
    largest_m: float | None
    within_2_percent: float | None
    false_per_hour: float
    lag_s: float
    end_error_m: float
    bounded_percent: float
    violations: int
    worst_share: float
    """Largest error over its bound."""
    above_etcs_percent: float
    """Rows whose bound is above 5 m + 5 % of the distance."""
    degraded_percent: float


def spans_of(marked: NDArray[np.bool_], t_s: Floats) -> list[SlipSpan]:
    """Times from the first marked row to the first one that is not, of each run."""
    edges = np.flatnonzero(np.diff(np.r_[False, marked, False].astype(np.int8)))
    last = len(t_s) - 1
    return [SlipSpan(float(t_s[a]), float(t_s[min(b, last)])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def lag_of(track: MotionTrack, truth: MotionTruth) -> float:
    """Constant delay of the output [s], found where nothing slips; 0 where there is too little of that."""
    calm = np.ones(len(track.t_s), np.bool_)
    for span in spans_of(truth.slip != 0, truth.t_s):
        calm &= ~((track.t_s > span.start_s - 1.0) & (track.t_s < span.end_s + 20.0))
    if calm.sum() <= 100:  # noqa: PLR2004 - ten seconds
        return 0.0
    own_mps = np.gradient(track.distance_m, track.t_s)[calm]
    differences = [
        float(np.median(np.abs(own_mps - np.gradient(_true_m(truth, track.t_s - lag_s), track.t_s)[calm])))
        for lag_s in LAGS_S
    ]
    return LAGS_S[int(np.argmin(differences))]


def _true_m(truth: MotionTruth, t_s: Floats) -> Floats:
    return np.interp(t_s, truth.t_s, truth.distance_m)


def error_of(track: MotionTrack, truth: MotionTruth, lag_s: float = 0.0) -> Floats:
    """Error of the distance since the first row, shape (n,)."""
    true_m = _true_m(truth, track.t_s - lag_s)
    error_m: Floats = track.distance_m - track.distance_m[0] - (true_m - true_m[0])
    return error_m


def _cost_m(wheel: WheelWay | None, truth: MotionTruth, span: SlipSpan) -> float:
    """What a slip cost the wheel, from a second before to a second after it."""
    if wheel is None:
        return float("nan")
    ends_s = np.array([span.start_s - 1.0, span.end_s + 1.0])
    turned_m, true_m = np.interp(ends_s, wheel.t_s, wheel.way_m), _true_m(truth, ends_s)
    return float(abs((turned_m[1] - turned_m[0]) - (true_m[1] - true_m[0])))


def slip_results(track: MotionTrack, truth: MotionTruth, wheel: WheelWay | None, lag_s: float) -> list[SlipResult]:
    """One result per true slip that lies within the track with its surroundings."""
    error_m = error_of(track, truth, lag_s)
    found: list[SlipResult] = []
    for span in spans_of(truth.slip != 0, truth.t_s):
        start_s, end_s = span.start_s + lag_s, span.end_s + lag_s
        if start_s - BEFORE_S < track.t_s[0] or end_s + AFTER_S > track.t_s[-1]:
            continue
        across_m = np.interp([start_s - BEFORE_S, end_s + AFTER_S], track.t_s, error_m)
        seen = track.t_s[(track.t_s >= start_s - 0.5) & (track.t_s <= end_s + 3.5) & track.slip]
        early = False
        if len(seen):
            inner = (track.t_s >= seen[0]) & (track.t_s <= end_s - 1.0)
            early = bool(inner.any() and float((~track.slip[inner]).mean()) * (end_s - 1.0 - float(seen[0])) > 1.0)
        after = (track.t_s >= end_s + SETTLED_S) & (track.t_s <= end_s + AFTER_S)
        adheres = bool(len(seen)) and not early and not bool(track.slip[after].any())
        error = float(abs(across_m[1] - across_m[0]))
        found.append(SlipResult(span, error, _cost_m(wheel, truth, span), bool(len(seen)), early, adheres))
    return found


def false_triggers(track: MotionTrack, truth: MotionTruth, lag_s: float) -> list[SlipSpan]:
    """Times in which the track tells of a slip that there is not."""
    true = spans_of(truth.slip != 0, truth.t_s)
    edges = np.flatnonzero(np.diff(np.r_[False, track.slip, False].astype(np.int8)))
    told = [(float(track.t_s[a]), float(track.t_s[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [
        SlipSpan(first_s, last_s)
        for first_s, last_s in told
        if not any(last_s >= s.start_s + lag_s - 1.0 and first_s <= s.end_s + lag_s + SETTLED_S for s in true)
    ]


def evaluate(track: MotionTrack, truth: MotionTruth, wheel: WheelWay | None) -> Evaluation:
    """All figures of one track."""
    lag_s = lag_of(track, truth)
    results = slip_results(track, truth, wheel, lag_s)
    costly = [one for one in results if not one.cost_m <= LEAST_COST_M]
    errors_m = np.array([one.error_m for one in results])
    raw_m, settled_m = error_of(track, truth), error_of(track, truth, lag_s)
    finite = np.isfinite(track.bound_m)
    bound_m = np.where(finite, track.bound_m, -1.0)
    hours = float(track.t_s[-1] - track.t_s[0]) / 3600.0
    positive = bound_m > 0.0
    above = np.where(finite, track.bound_m, np.inf) > 5.0 + 0.05 * (track.distance_m - track.distance_m[0])
    return Evaluation(
        name=track.name,
        hours=hours,
        slips=len(results),
        counted=len(costly),
        detected=sum(one.detected for one in costly),
        readhered_percent=100.0 * sum(one.adheres for one in costly) / len(costly) if costly else None,
        early=sum(one.early for one in costly),
        median_m=float(np.median(errors_m)) if results else None,
        p95_m=float(np.percentile(errors_m, 95.0)) if results else None,
        largest_m=float(errors_m.max()) if results else None,
        within_2_percent=100.0 * float((errors_m <= WITHIN_M).mean()) if results else None,
        false_per_hour=len(false_triggers(track, truth, lag_s)) / hours,
        lag_s=lag_s,
        end_error_m=float(settled_m[-1]),
        bounded_percent=100.0 * float(finite.mean()),
        violations=int((np.abs(raw_m) > bound_m).sum()),
        worst_share=float((np.abs(raw_m[positive]) / bound_m[positive]).max()) if positive.any() else float("inf"),
        above_etcs_percent=100.0 * float(above.mean()),
        degraded_percent=100.0 * sum(word != "valid" for word in track.status) / len(track.status),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Places that the train passed, in the order of passing, columns of shape (n,)."""

    kind: str
    """What they are, in the plural."""
    t_s: Floats
    place_m: Floats
    """Along the track; the distance between two is true whatever the origin."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Distances between one mark and the next, columns of shape (n,)."""

    begin_m: Floats
    """True way gone at the first mark of each."""
    end_m: Floats
    true_m: Floats
    measured_m: Floats
    slipped: NDArray[np.bool_]
    """Whether a slip began, ended or went on in between."""


def even_marks(truth: MotionTruth, spacing_m: float) -> Marks:
    """Marks every `spacing_m` of the true way, the first half of that after its begin; none on a shorter way."""
    kind = f"{spacing_m:g} m marks"
    if len(truth.t_s) < 2 or truth.distance_m[-1] - truth.distance_m[0] < spacing_m:  # noqa: PLR2004 - a way has two ends
        return Marks(kind, np.empty(0), np.empty(0))
    ahead = np.maximum.accumulate(truth.distance_m)
    first = np.searchsorted(ahead, np.arange(ahead[0] + 0.5 * spacing_m, ahead[-1], spacing_m))
    t_s = truth.t_s[np.minimum(first, len(truth.t_s) - 1)]
    return Marks(kind, t_s, _true_m(truth, t_s))


def measured_stretches(t_s: Floats, distance_m: Floats, truth: MotionTruth, marks: Marks) -> Stretches:
    """Distances between marks by an odometry (or a wheel), as balises would show them (Iwata et al., figure 4).

    Marks beyond its times are left out, and stretches from a mark to itself (a train that turned back).
    """
    inside = (marks.t_s >= max(t_s[0], truth.t_s[0])) & (marks.t_s <= min(t_s[-1], truth.t_s[-1]))
    at_s, place_m = marks.t_s[inside], marks.place_m[inside]
    true_m = np.abs(np.diff(place_m))
    kept = true_m > 0.0
    way_m = _true_m(truth, at_s) - truth.distance_m[0]
    slipped = [bool((truth.slip[(truth.t_s >= a) & (truth.t_s <= b)] != 0).any()) for a, b in pairwise(at_s.tolist())]
    measured_m = np.abs(np.diff(np.interp(at_s, t_s, distance_m)))
    return Stretches(
        way_m[:-1][kept], way_m[1:][kept], true_m[kept], measured_m[kept], np.array(slipped, np.bool_)[kept]
    )
