"""Solutions as messages: a fix for every epoch, or the reason in words why there is none."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schemas.gnss import Fix, FixStatus, Method
from services.gnss_correction.differential import Differential
from services.gnss_correction.ephemeris_table import EphemerisTable
from services.gnss_correction.multipath import Judgement
from services.gnss_correction.preparation import Prepared
from services.gnss_correction.rejection import REJECTION_WORDS, Outcome, Rejection
from services.gnss_correction.robust_reasons import remarkable, robust_reason
from services.gnss_correction.settings import Config
from services.gnss_correction.solver_arrays import Float64s, Records

_FIX, _PREDICTED = int(Outcome.FIX), int(Outcome.PREDICTED)
_STATUS: dict[int, FixStatus] = {_FIX: "fix", _PREDICTED: "predicted"}
_FIGURES = (
    "lat_rad",
    "lon_rad",
    "h_m",
    "ve_mps",
    "vn_mps",
    "vu_mps",
    "clock_m",
    "sigma_horizontal_m",
    "hdop",
)


_OPTIONAL = ("bound_m", "chainage_m", "chainage_bound_m", "speed_along_mps")


@dataclass(frozen=True, slots=True)
class Solution:
    """One method's solutions of a block and the rows they were made from."""

    epochs: Records
    """Dtype SOLUTION."""
    rows: Records
    """Dtype ROW."""
    reasons: Sequence[str] = ()
    """What is to be said of each epoch, where the method finds the words itself."""


@dataclass(frozen=True, slots=True)
class Corrected:
    """A block of epochs, solved by every method and judged."""

    config: Config
    t_ns: Sequence[int]
    gps_week: Sequence[int]
    tow_s: Sequence[float]
    refusals: Sequence[str]
    """Why an epoch was not solved at all; empty where it was."""
    table: EphemerisTable
    prepared: Prepared
    judgements: Sequence[Judgement | None]
    """One per row; None where there was nothing to judge."""
    flagged: Sequence[int]
    """Flagged satellites of each epoch."""
    evidence: Records
    """Dtype EVIDENCE: what speaks for multipath in each row."""
    solutions: dict[Method, Solution]
    differential: Differential
    """What became of the corrections of a reference station."""


def numbers(column: Float64s) -> list[float | None]:
    """List with None for NaN."""
    return [value if value == value else None for value in column.tolist()]  # noqa: PLR0124 - NaN differs from itself


def _left_out(rejections: Sequence[int]) -> str:
    """What was wrong with the satellites of an epoch, commonest first."""
    counts = Counter(Rejection(one) for one in rejections if one != Rejection.USABLE)
    return ", ".join(f"{count} {REJECTION_WORDS[rejection]}" for rejection, count in counts.most_common())


def _no_fix_reason(epoch: np.void, rejections: Sequence[int], config: Config) -> str:
    """In words why an epoch has no fix."""
    used = int(epoch["used"])
    match Outcome(int(epoch["outcome"])):
        case Outcome.TOO_FEW_SATELLITES:
            reason = f"{used} usable of {len(rejections)} satellites, {int(epoch['needed'])} needed"
        case Outcome.WEAK_GEOMETRY if epoch["pdop"] > config.most_pdop:
            reason = f"weak geometry: PDOP {epoch['pdop']:.0f} over the limit of {config.most_pdop:g}"
        case Outcome.WEAK_GEOMETRY:
            reason = f"weak geometry: the directions to {used} satellites determine no place"
        case Outcome.NOT_CONVERGED:
            reason = f"the solution of {used} satellites does not converge"
        case Outcome.CONTRADICTION:
            reason = "pseudoranges contradict each other by kilometres and too few are left to tell which"
        case _:
            reason = f"the solution of {used} satellites is at no height where a train can be"
    left_out = _left_out(rejections)
    return f"{reason} ({left_out})" if left_out else reason


def _reasons(corrected: Corrected, solution: Solution) -> list[str]:
    """Reason of every epoch; of fixes only what is special about them."""
    if solution.reasons:
        return [refusal or said for refusal, said in zip(corrected.refusals, solution.reasons, strict=True)]
    reasons = list(corrected.refusals)
    first = corrected.prepared.first_row
    if "undetermined_s" in (solution.epochs.dtype.names or ()):
        for i in remarkable(solution.epochs):
            left_out = _left_out(solution.rows["rejection"][first[i] : first[i + 1]].tolist())
            reasons[i] = robust_reason(solution.epochs[i], left_out)
    for i in np.flatnonzero(~np.isin(solution.epochs["outcome"], (_FIX, _PREDICTED))).tolist():
        if not reasons[i]:
            rejections = solution.rows["rejection"][first[i] : first[i + 1]].tolist()
            reasons[i] = _no_fix_reason(solution.epochs[i], rejections, corrected.config)
    for i in np.flatnonzero(np.isfinite(solution.epochs["held_s"])).tolist():
        epoch = solution.epochs[i]
        if epoch["outcome"] == _FIX:
            reasons[i] = f"weak geometry (PDOP {epoch['pdop']:.0f}): height held from {epoch['held_s']:.1f} s before"
    return reasons


def _reasons_with_corrections(corrected: Corrected, solution: Solution) -> list[str]:
    """Reasons, and why an epoch that should be corrected by a reference station is not."""
    said = zip(_reasons(corrected, solution), corrected.differential.epochs, strict=True)
    return ["; ".join(words for words in both if words) for both in said]


def _corrected_satellites(corrected: Corrected, solution: Solution) -> list[int]:
    """How many of the satellites in each solution a reference station corrected."""
    by_station = (solution.rows["rejection"] == Rejection.USABLE) & (solution.rows["correction_sigma_m"] > 0.0)
    total = np.concatenate([[0], np.cumsum(by_station)])
    return np.diff(total[corrected.prepared.first_row]).tolist()  # type: ignore[no-any-return]  # numpy's stubs say Any


def _optional(epochs: Records, name: str) -> list[float | None]:
    """A column that not every method has, such as the horizontal bound; None where there is none."""
    return numbers(epochs[name]) if name in (epochs.dtype.names or ()) else [None] * len(epochs)


def fixes_of(corrected: Corrected, method: Method) -> list[Fix]:
    """A fix, or the reason why none, for every epoch of the block."""
    solution = corrected.solutions[method]
    epochs = solution.epochs
    columns = zip(
        corrected.t_ns,
        corrected.gps_week,
        corrected.tow_s,
        epochs["outcome"].tolist(),
        _reasons_with_corrections(corrected, solution),
        epochs["used"].tolist(),
        corrected.flagged,
        _corrected_satellites(corrected, solution),
        *(_optional(epochs, name) for name in _OPTIONAL),
        *(numbers(epochs[name]) for name in _FIGURES),
        strict=True,
    )
    return [
        Fix(
            t_ns=t_ns,
            gps_week=week,
            tow_s=tow_s,
            method=method,
            status=_STATUS.get(outcome, "none"),
            reason=reason,
            lat_deg=None if lat_rad is None else math.degrees(lat_rad),
            lon_deg=None if lon_rad is None else math.degrees(lon_rad),
            h_m=h_m,
            ve_mps=ve_mps,
            vn_mps=vn_mps,
            vu_mps=vu_mps,
            clock_bias_m=clock_m if outcome in _STATUS else None,
            satellites_used=used if outcome in _STATUS else 0,
            satellites_flagged=flagged,
            satellites_corrected=by_station if outcome in _STATUS else 0,
            sigma_horizontal_m=sigma_m if outcome in _STATUS else None,
            bound_m=bound_m,
            chainage_m=chainage_m,
            chainage_bound_m=chainage_bound_m,
            speed_along_mps=speed_along_mps,
            hdop=hdop if outcome == _FIX else None,
        )
        for (
            t_ns,
            week,
            tow_s,
            outcome,
            reason,
            used,
            flagged,
            by_station,
            bound_m,
            chainage_m,
            chainage_bound_m,
            speed_along_mps,
            lat_rad,
            lon_rad,
            h_m,
            ve_mps,
            vn_mps,
            vu_mps,
            clock_m,
            sigma_m,
            hdop,
        ) in columns
    ]
