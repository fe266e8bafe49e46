"""Probability that a pseudorange is off by multipath or a reflection alone, from all evidence: a logistic model.

log odds = BASE + sum of weight x feature, every weight positive and every feature rising with its
evidence, so that more evidence never lowers the probability. `Off` means by more than 5 m.

The weights were fitted by logistic regression to labelled recordings of a car among buildings and
of the simulated train, and rounded; docs/gnss_correction.md shows how well they carry over from the
one to the other. A missing figure is no evidence: its term is zero.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from services.gnss_correction.solver_arrays import Float64s, Records


class Term(NamedTuple):
    """One piece of evidence in the sum."""

    name: str
    weight: float
    words: str
    """How its figure is told; receives the figure."""


BASE: Final = -3.3
"""Log odds without any evidence: 4 %, a receiver between open line and town."""
RESIDUAL_M: Final = 2.0
"""Scale of residuals: what code noise and atmosphere leave of a clean pseudorange."""
TERMS: Final = (
    Term("residual_m", 0.7, "{:+.1f} m off the other satellites"),
    Term("residual_mean_m", 0.1, "{:+.1f} m off them over the last second"),
    Term("deficit_db", 0.8, "C/N0 {:.0f} dB below its elevation's profile"),
    Term("drop_db", 0.1, "C/N0 {:.0f} dB below its recent best"),
    Term("change_hold_m", 0.2, "range changed by {:.1f} m against Doppler (peak, 10 m at most)"),
    Term("divergence_hold_m", 0.05, "range changed by {:.1f} m against the carrier (peak, 10 m at most)"),
    Term("rate_hold_mps", 0.1, "Doppler {:.1f} m/s off the velocity"),
    Term("slip_hold", 0.6, "cycle slip"),
)
"""Natural log odds per unit of feature (see `features`)."""
PER_DB: Final = 0.1
PER_MPS: Final = 5.0
LIKELY: Final = 0.5
"""From here on a satellite is called probably reflected."""
TOLD: Final = 2
"""Pieces of evidence named in a reason."""
NAMED: Final = 0.5
"""Log odds that a piece of evidence beside the strongest must add to be named."""


def features(evidence: Records) -> Float64s:
    """Features of evidence (dtype EVIDENCE), shape (rows, terms): 0 without evidence, rising with it.

    Residuals: ln(1 + (r / 2 m)²), of the heavy-tailed (Cauchy) error law; levels: per 10 dB, a
    signal stronger than its profile speaks against multipath; changes: ln(1 + m).
    """
    columns = [
        np.log1p((evidence["residual_m"] / RESIDUAL_M) ** 2),
        np.log1p((evidence["residual_mean_m"] / RESIDUAL_M) ** 2),
        PER_DB * np.clip(evidence["deficit_db"], -10.0, 40.0),
        PER_DB * np.clip(evidence["drop_db"], 0.0, 40.0),
        np.log1p(evidence["change_hold_m"]),
        np.log1p(evidence["divergence_hold_m"]),
        np.log1p(PER_MPS * evidence["rate_hold_mps"]),
        evidence["slip_hold"],
    ]
    return np.asarray(np.nan_to_num(np.stack(columns, axis=-1), nan=0.0, posinf=100.0), np.float64)


def contributions(evidence: Records) -> Float64s:
    """Log odds that each term adds, shape (rows, terms)."""
    return np.asarray(features(evidence) * np.array([term.weight for term in TERMS]), np.float64)


def probability(added: Float64s) -> Float64s:
    """Probability of multipath, shape (rows,), from `contributions`."""
    return np.asarray(1.0 / (1.0 + np.exp(-(BASE + added.sum(axis=-1)))))


def evidence_in_words(evidence: np.void, added: Float64s) -> str:
    """Main pieces of one row's evidence with their figures, strongest first.

    >>> from services.gnss_correction.multipath_evidence import EVIDENCE
    >>> row = np.zeros(1, EVIDENCE)
    >>> row["residual_m"] = 40.0
    >>> evidence_in_words(row[0], contributions(row)[0])
    '+40.0 m off the other satellites'
    """
    first, *others = np.argsort(-added, kind="stable")[:TOLD].tolist()
    told = [first, *(i for i in others if added[i] >= NAMED)]
    return ", ".join(TERMS[i].words.format(float(evidence[TERMS[i].name])) for i in told)
