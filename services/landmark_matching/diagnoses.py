"""The diagnoses of a passage, one function each, in the order of Iwata et al., section 3.2.

Each gives None when it finds nothing wrong, else the words that refuse the match.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from services.landmark_matching.crossing_bound import crossing_bound_m
from services.landmark_matching.passage import Measured, Passage, common_bias_radps, find_straight, measure
from services.landmark_matching.settings import MatchSettings

Kind = Literal[
    "accepted",
    "slip",
    "low speed",
    "reverse running",
    "gap",
    "leap",
    "no curvature",
    "start point",
    "entry straight",
    "sign",
    "upper limit",
    "lower limit",
    "curvature",
    "length",
    "exit straight",
    "shape",
    "window",
    "gnss",
    "twin",
    "moved",
    "no curve",
]
DISTURBANCES: tuple[Kind, ...] = ("slip", "reverse running", "gap", "low speed", "leap", "no curvature")


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the diagnoses say of one passage."""

    kind: Kind
    reason: str
    t_s: float
    distance_m: float
    """Of the odometry at the exit crossing."""
    u_m: float
    """Place of the sensor there, by the landmark."""
    correction_m: float
    """Along the axis' direction of running: `u_m` minus the place held."""
    bound_m: float
    measured: Measured | None = None
    fits: bool = False
    """The curve is the landmark's in every respect; where it is refused, only its place is not believed."""


def disturbance(passage: Passage) -> tuple[Kind, str] | None:
    """Slip, low speed, reverse running, a gap or a leap anywhere from the straight before the curve to now."""
    reach_m = abs(passage.landmark.entry_straight_end_m - passage.landmark.entry_straight_start_m)
    begin_m = min(passage.entry_m, passage.entry_m - (passage.shape.arc_start_m - passage.shape.start_m)) - reach_m
    beyond = passage.distance_m >= begin_m
    found = Counter(fault for fault, counts in zip(passage.faults, beyond, strict=True) if counts and fault)
    for kind in DISTURBANCES:
        if found[kind]:
            return kind, f"{kind} in the curve's window ({found[kind]} samples)"
    if bool(np.any(np.diff(passage.distance_m[beyond]) < 0.0)):
        return "reverse running", "distance falls in the curve's window"
    return None


def start_point(passage: Passage) -> str | None:
    """Diagnosis 1: the train is where the landmark's curve begins, as far as its margin lets one say."""
    entry_u_m = passage.shape.start_m + passage.landmark.lower_share * (
        passage.shape.arc_start_m - passage.shape.start_m
    )
    return _outside(passage, passage.entry_m, entry_u_m, "curve begins")


def _outside(passage: Passage, distance_m: float, u_m: float, what: str) -> str | None:
    behind_m, ahead_m = passage.anchor.window(distance_m, passage.excess_at(distance_m))
    slack_m = passage.landmark.accuracy_m + 0.5 * max(passage.windows_m)
    difference_m = u_m - passage.anchor.place(distance_m)
    if -behind_m - slack_m <= difference_m <= ahead_m + slack_m:
        return None
    return (
        f"{what} {abs(difference_m):.0f} m {'before' if difference_m > 0.0 else 'beyond'} the landmark's place, "
        f"search window -{behind_m + slack_m:.0f} m … +{ahead_m + slack_m:.0f} m"
    )


def entry_straight(passage: Passage, settings: MatchSettings) -> str | None:
    """Diagnosis 2: straight track before the curve."""
    if find_straight(passage, settings, entry=True) is not None:
        return None
    return f"no straight within {settings.straight_within_m:.0f} m before the curve"


def sign(passage: Passage) -> str | None:
    """Diagnosis 3a: the curve has the hand of the database."""
    turned = float(np.nansum(passage.curvature_per_m[passage.inside]))
    if turned * passage.shape.curvature_per_m > 0.0:
        return None
    return f"curve turns {'left' if turned > 0.0 else 'right'}, the landmark's {passage.landmark.hand}"


def upper_limit(passage: Passage, bias_radps: float, settings: MatchSettings) -> str | None:
    """Diagnosis 3b: curvature stays below the upper limit, the gyro's bias on the straight before taken off.

    A peak may exceed the limit by one standard deviation of noise; the mean curvature, judged next, may not.
    """
    inside = passage.inside
    speed_mps = np.maximum(passage.speed_mps[inside], 0.1)
    size = np.abs(passage.curvature_per_m[inside] - bias_radps / speed_mps) - settings.noise_per_s / speed_mps
    peak = float(np.max(size, initial=0.0)) * passage.landmark.radius_m
    limit = passage.landmark.upper_share
    return None if peak <= limit else f"curvature reaches {peak:.2f} of the database's, limit {limit:.2f}"


def curvature(measured: Measured, settings: MatchSettings) -> str | None:
    """Between 3b and 3c: the mean curvature is the database's, which a single peak cannot tell."""
    if abs(measured.scale - 1.0) <= settings.scale_tolerance:
        return None
    return f"mean curvature {measured.scale:.2f} of the database's, tolerance {settings.scale_tolerance:.2f}"


def length_tolerance_m(passage: Passage, measured: Measured, settings: MatchSettings) -> float:
    """Tolerance of the length between crossings: the database's, but never a large share of a short curve."""
    length_m = measured.exit.u_m - measured.entry.u_m
    rows = passage.landmark
    wide_m = max(rows.length_tolerance_share * length_m, rows.length_tolerance_m)
    return min(wide_m, max(settings.length_cap_share * length_m, settings.length_floor_m))


def length(passage: Passage, measured: Measured, settings: MatchSettings) -> str | None:
    """Diagnosis 3c: length between the lower limit's crossings.

    The length expected follows the measured curvature and the window: a curvature that reads 15 % low
    crosses the same level later and leaves it earlier.
    """
    tolerance_m = length_tolerance_m(passage, measured, settings)
    if abs(measured.length_error_m) <= tolerance_m:
        return None
    return (
        f"{measured.exit_m - measured.entry_m:.0f} m between the lower limit's crossings, "
        f"{measured.exit.u_m - measured.entry.u_m:.0f} m expected, tolerance {tolerance_m:.0f} m"
    )


def exit_straight(passage: Passage, settings: MatchSettings) -> str | None:
    """Diagnosis 4: straight track after the curve."""
    if find_straight(passage, settings, entry=False) is not None:
        return None
    return f"no straight within {settings.straight_within_m:.0f} m after the curve"


def shape(measured: Measured, settings: MatchSettings) -> str | None:
    """After 4: the whole course of curvature is the database's; finds wheels that slip unseen within the curve."""
    if measured.shape_error <= settings.shape_tolerance:
        return None
    limit = settings.shape_tolerance
    return f"curvature differs from the database's by {measured.shape_error:.2f} rms, {limit:.2f} at most"


def window(passage: Passage, u_m: float, exit_m: float, bound_m: float) -> str | None:
    """The correction is one that the margin explains."""
    behind_m, ahead_m = passage.anchor.window(exit_m, passage.excess_at(exit_m))
    correction_m = u_m - passage.anchor.place(exit_m)
    if -behind_m - bound_m <= correction_m <= ahead_m + bound_m:
        return None
    return f"correction {correction_m:+.1f} m is more than the margin explains (-{behind_m:.0f} m … +{ahead_m:.0f} m)"


def gnss(passage: Passage, u_m: float, exit_m: float, bound_m: float) -> str | None:
    """The optional check against GNSS: the place by the landmark lies within the bound of the place by GNSS."""
    by_gnss = passage.anchor.gnss
    if by_gnss is None:
        return None
    offset_m, allowed_m = by_gnss
    difference_m = u_m - passage.anchor.place(exit_m) - offset_m
    allowed_m += bound_m + passage.anchor.growth(exit_m, passage.excess_at(exit_m))
    if abs(difference_m) <= allowed_m:
        return None
    return f"place by GNSS differs by {abs(difference_m):.0f} m, {allowed_m:.0f} m at most"


def _as(kind: Kind, reason: str | None) -> tuple[Kind, str] | None:
    return None if reason is None else (kind, reason)


def _before_exit(passage: Passage, settings: MatchSettings) -> tuple[Kind, str] | None:
    """Diagnoses 2 to 3b, the straight before the curve, its hand and its largest curvature."""
    bias_radps = common_bias_radps(find_straight(passage, settings, entry=True))
    return (
        _as("entry straight", entry_straight(passage, settings))
        or _as("sign", sign(passage))
        or _as("upper limit", upper_limit(passage, bias_radps, settings))
    )


def _of_curve(passage: Passage, measured: Measured, settings: MatchSettings) -> tuple[Kind, str] | None:
    """Diagnoses from 3b to 4, with the mean curvature and the whole shape."""
    return (
        _as("curvature", curvature(measured, settings))
        or _as("length", length(passage, measured, settings))
        or _as("exit straight", exit_straight(passage, settings))
        or _as("shape", shape(measured, settings))
    )


def _of_shape(passage: Passage, measured: Measured | None, settings: MatchSettings) -> tuple[Kind, str] | None:
    """Everything that does not depend on where the train is believed to be."""
    refusal = _before_exit(passage, settings)
    if refusal is None and measured is None:
        return "lower limit", "curvature does not reach the lower limit as the database's curve would"
    return refusal or (None if measured is None else _of_curve(passage, measured, settings))


def diagnose(passage: Passage, settings: MatchSettings) -> Verdict:
    """All diagnoses in their order; the first that fails refuses."""
    before = find_straight(passage, settings, entry=True)
    after = find_straight(passage, settings, entry=False)
    measured = measure(passage, common_bias_radps(before, after))
    disturbed = disturbance(passage)
    elsewhere = None if disturbed else _as("start point", start_point(passage))
    refusal = disturbed or _of_shape(passage, measured, settings)
    if refusal is not None or measured is None or before is None or after is None:
        kind, words = elsewhere or refusal or ("exit straight", "no straight after the curve")
        place_m = passage.anchor.place(passage.exit_m)
        return Verdict(kind, f"{kind}: {words}", passage.exit_t_s, passage.exit_m, place_m, 0.0, 0.0, measured)
    bound_m = passage.landmark.accuracy_m + crossing_bound_m(passage, measured, (before, after), settings)
    u_m, exit_m = measured.exit.u_m, measured.exit_m
    t_s = float(np.interp(exit_m, passage.distance_m, passage.t_s))
    correction_m = u_m - passage.anchor.place(exit_m)
    verdict = Verdict("accepted", "accepted", t_s, exit_m, u_m, correction_m, bound_m, measured, fits=True)
    refusal = (
        elsewhere
        or _as("window", window(passage, u_m, exit_m, bound_m))
        or _as("gnss", gnss(passage, u_m, exit_m, bound_m))
    )
    return replace(verdict, kind=refusal[0], reason=f"{refusal[0]}: {refusal[1]}") if refusal else verdict
