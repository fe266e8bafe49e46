"""Judgements as messages: a verdict for every satellite of every epoch, with its reason in words and figures."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from schemas.gnss import SatelliteVerdict, Verdicts
from services.gnss_correction.ephemeris_table import selection_reason
from services.gnss_correction.fix_messages import Corrected, numbers
from services.gnss_correction.multipath import Judgement
from services.gnss_correction.multipath_probability import LIKELY, contributions, evidence_in_words, probability
from services.gnss_correction.rejection import REJECTION_WORDS, Rejection
from services.gnss_correction.settings import Config
from services.gnss_correction.solver_arrays import Float64s
from services.gnss_receiver.observations import satellite_name

_USABLE, _MULTIPATH = int(Rejection.USABLE), int(Rejection.MULTIPATH)
_JUDGED = (_USABLE, _MULTIPATH, int(Rejection.INCONSISTENT))
"""Rows whose measurement was looked at, whatever became of it."""
_CLEAN = "clean"
_name = lru_cache(maxsize=1024)(satellite_name)


class _Belief(NamedTuple):
    """What the evidence of a block makes of its rows."""

    added: Float64s
    """Log odds by row and piece of evidence."""
    probability: list[float]


class _Measured(NamedTuple):
    """What was measured of a satellite, before any substitution."""

    pseudorange_m: float | None
    range_rate_mps: float | None


class _Seen(NamedTuple):
    """One satellite at one epoch, as the primary method left it."""

    satellite: int
    rejection: int
    pseudorange_m: float | None
    elevation_rad: float | None
    azimuth_rad: float | None
    cn0_dbhz: float | None
    strength_dbhz: float | None
    residual_m: float | None


def _rejected_because(corrected: Corrected, seen: _Seen, i: int, t_s: float) -> str:
    """Why row `i` took no part, with figures."""
    config, prepared = corrected.config, corrected.prepared
    match Rejection(seen.rejection):
        case Rejection.STALE_EPHEMERIS:
            reason = selection_reason(corrected.table, seen.satellite, t_s, int(prepared.rows["ephemeris"][i]))
        case Rejection.ABSURD_PSEUDORANGE:
            reason = f"absurd pseudorange of {seen.pseudorange_m:.6g} m"
        case Rejection.BELOW_MASK if seen.elevation_rad is not None:
            reason = f"elevation {np.degrees(seen.elevation_rad):.1f}° below the mask of {config.elevation_mask_deg:g}°"
        case Rejection.UNCORRECTED:
            reason = corrected.differential.rows.get(i, REJECTION_WORDS[Rejection.UNCORRECTED])
        case Rejection.WEAK_SIGNAL:
            reason = f"{seen.strength_dbhz:.0f} dB-Hz below the mask of {config.cn0_mask_dbhz:g} dB-Hz"
        case Rejection.CONTRADICTS if seen.residual_m is not None:
            reason = f"contradicts the other satellites by {abs(seen.residual_m) / 1000.0:.1f} km"
        case Rejection.INCONSISTENT if seen.residual_m is not None:
            reason = f"{REJECTION_WORDS[Rejection.INCONSISTENT]} by {seen.residual_m:+.1f} m"
        case rejection:
            reason = REJECTION_WORDS[rejection]
    return reason


def _judged(judgement: Judgement | None, config: Config, adjusted_by_m: float | None) -> str:
    """What the detector found, in words."""
    if judgement is None:
        return "not watched"
    if judgement.change_m is None or judgement.threshold_m is None:
        return f"watched for {judgement.watched_epochs} of {config.window_epochs} epochs"
    if not judgement.flagged:
        return _CLEAN
    found = f"change {judgement.change_m:.2f} m per 0.2 s over the threshold of {judgement.threshold_m:.2f} m"
    if adjusted_by_m is not None:
        return f"{found}, adjusted by {adjusted_by_m:+.1f} m"
    if config.method == "adjust" and judgement.substitute is None:
        return f"{found}, adjusted for {config.longest_adjusting_s:g} s already: left out"
    return found + (", left out" if config.method == "remove" else "")


def _correction_age_s(corrected: Corrected, i: int) -> float | None:
    """Age of the reference station's correction of row `i`; None where it has none."""
    row = corrected.prepared.rows[i]
    return float(row["correction_age_s"]) if row["correction_sigma_m"] > 0.0 else None


def _verdict(
    corrected: Corrected, seen: _Seen, i: int, t_s: float, measured: _Measured, belief: _Belief
) -> SatelliteVerdict:
    judgement = corrected.judgements[i]
    flagged = judgement is not None and judgement.flagged
    used = seen.rejection == _USABLE and seen.residual_m is not None
    adjusted_by_m = adjusted_rate_by_mps = None
    if used and judgement and judgement.substitute and corrected.config.method == "adjust" and measured.pseudorange_m:
        adjusted_by_m = judgement.substitute.pseudorange_m - measured.pseudorange_m
        if measured.range_rate_mps is not None:
            adjusted_rate_by_mps = judgement.substitute.range_rate_mps - measured.range_rate_mps
    reason = _judged(judgement, corrected.config, adjusted_by_m)
    if seen.rejection not in (_USABLE, _MULTIPATH):
        rejected = _rejected_because(corrected, seen, i, t_s)
        reason = f"{rejected}; {reason}" if flagged else rejected
    if seen.rejection in _JUDGED and judgement is not None and belief.probability[i] >= LIKELY:
        likely = f"probably reflected: {evidence_in_words(corrected.evidence[i], belief.added[i])}"
        reason = likely if reason == _CLEAN else f"{reason}; {likely}"
    return SatelliteVerdict(
        satellite=_name(seen.satellite),
        used=used,
        flagged=flagged,
        multipath_probability=belief.probability[i] if judgement else None,
        reason=reason,
        elevation_rad=seen.elevation_rad,
        azimuth_rad=seen.azimuth_rad,
        cn0_dbhz=seen.cn0_dbhz,
        change_m=judgement.change_m if judgement else None,
        threshold_m=judgement.threshold_m if judgement else None,
        residual_m=seen.residual_m,
        adjusted_by_m=adjusted_by_m,
        adjusted_rate_by_mps=adjusted_rate_by_mps,
        correction_age_s=_correction_age_s(corrected, i),
    )


def verdicts_of(corrected: Corrected) -> list[Verdicts]:
    """Verdict of every satellite at every epoch, as it bore on the primary method's fix."""
    rows = corrected.solutions[corrected.config.method].rows
    seen = [
        _Seen(*one)
        for one in zip(
            rows["satellite"].tolist(),
            rows["rejection"].tolist(),
            *(numbers(rows[name]) for name in _Seen._fields[2:]),
            strict=True,
        )
    ]
    measured = [
        _Measured(*one)
        for one in zip(*(numbers(corrected.prepared.rows[name]) for name in _Measured._fields), strict=True)
    ]
    added = contributions(corrected.evidence)
    belief = _Belief(added, probability(added).tolist())
    first = corrected.prepared.first_row.tolist()
    t_s = corrected.prepared.t_s.tolist()
    return [
        Verdicts(
            t_ns=t_ns,
            gps_week=week,
            tow_s=tow_s,
            satellites=tuple(
                _verdict(corrected, seen[i], i, t_s[epoch], measured[i], belief)
                for i in range(first[epoch], first[epoch + 1])
            ),
        )
        for epoch, (t_ns, week, tow_s) in enumerate(
            zip(corrected.t_ns, corrected.gps_week, corrected.tow_s, strict=True)
        )
    ]
