"""Thresholds from the clean stretches of a recording: the paper's open question (Yoshinaga et al. 2008, section 6).

A change Pc counts as clean when everything but the changes of the pseudorange itself (residual,
C/N0, Doppler, slips) gives multipath a small probability. The threshold is what leaves the wanted
share of false alarms: the quantile of the clean changes or, where that is smaller, the quantile of
a normal distribution with their median, because in town reflections that nothing else betrays
remain among them and spoil the tail, but hardly the median. So it follows from the receiver's
code noise, its interval and the elevation, not from trial.

With white code noise of standard deviation s, changes against the mean of the past n have the
standard deviation s sqrt((1 + 1/n)² + 1 + 1/n²), for n = 5 about 1.57 s.
"""

from __future__ import annotations

import math
from itertools import pairwise
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np

from schemas.thresholds import EDGES_DEG, ZENITH_DEG, Band
from services.gnss_correction.fix_messages import Corrected
from services.gnss_correction.multipath_probability import TERMS, contributions, probability
from services.gnss_correction.solver_arrays import Float64s, Ints
from services.gnss_receiver.observations import SYSTEMS

CLEAN_BELOW: Final = 0.15
"""Probability of multipath by the other evidence below which a change counts as clean."""
FEWEST_CLEAN: Final = 200
"""Clean changes that a quantile of 99 % needs: two of them lie above it."""
LEAST_CLEAN: Final = 0.1
"""Share of what was judged: where fewer changes pass for clean, those that do are reflections that nothing betrays."""
OF_THE_CHANGE: Final = ("change_hold_m", "divergence_hold_m")
"""Evidence that is the change itself and may not decide which changes are clean."""
NORMAL_QUARTILE: Final = 0.67449
"""Median of |x| of the standard normal distribution."""


class Changes(NamedTuple):
    """Judged changes of a recording, one element each."""

    system: Ints
    """Index in SYSTEMS."""
    elevation_deg: Float64s
    change_m: Float64s
    clean: Float64s
    """1 where nothing else speaks against the pseudorange, else 0."""


def changes_of(corrected: Corrected) -> Changes:
    """Judged changes of a block."""
    rows = corrected.solutions["original"].rows
    change_m = np.array(
        [one.change_m if one and one.change_m is not None else math.nan for one in corrected.judgements], np.float64
    )
    added = contributions(corrected.evidence)
    added[:, [i for i, term in enumerate(TERMS) if term.name in OF_THE_CHANGE]] = 0.0
    judged = np.isfinite(change_m) & np.isfinite(rows["elevation_rad"]) & np.isfinite(corrected.evidence["residual_m"])
    clean = (probability(added) < CLEAN_BELOW).astype(np.float64)
    return Changes(rows["system"][judged], np.degrees(rows["elevation_rad"][judged]), change_m[judged], clean[judged])


def joined(parts: list[Changes]) -> Changes:
    """Changes of several blocks."""
    return Changes(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def noise_factor(window_epochs: int) -> float:
    """Standard deviation of Pc over that of one pseudorange, for white code noise.

    >>> round(noise_factor(5), 3)
    1.575
    """
    share = 1.0 / window_epochs
    return math.sqrt((1.0 + share) ** 2 + 1.0 + share**2)


def _threshold_m(sample: Float64s, false_alarms: float) -> float:
    """Smaller one of the sample's own quantile and that of a normal distribution with its median."""
    by_median_m = float(np.median(sample)) / NORMAL_QUARTILE * NormalDist().inv_cdf(1.0 - 0.5 * false_alarms)
    return min(float(np.quantile(sample, 1.0 - false_alarms)), by_median_m)


def bands_of(changes: Changes, *, false_alarms: float, window_epochs: int) -> tuple[Band, ...]:
    """Bands of every constellation that was seen. Raises ValueError when too little is clean."""
    clean = changes.clean > 0.0
    if clean.sum() < FEWEST_CLEAN:
        msg = (
            f"{int(clean.sum())} clean changes of {clean.size}, {FEWEST_CLEAN} needed: "
            "record longer, or where the sky is open"
        )
        raise ValueError(msg)
    bands = []
    for system in np.unique(changes.system).tolist():
        own = changes.system == system
        for lowest_deg, highest_deg in pairwise(EDGES_DEG):
            below = (changes.elevation_deg < highest_deg) | (highest_deg == ZENITH_DEG)
            inside = own & (changes.elevation_deg >= lowest_deg) & below
            bands.append(
                _band(changes, SYSTEMS[system], (lowest_deg, highest_deg), own, inside, false_alarms, window_epochs)
            )
    return tuple(bands)


def _band(
    changes: Changes,
    system: str,
    edges_deg: tuple[float, float],
    own: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
    inside: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
    false_alarms: float,
    window_epochs: int,
) -> Band:
    clean = changes.clean > 0.0
    found = changes.change_m[inside & clean]
    basis, sample = next(
        (name, changes.change_m[chosen & clean])
        for name, chosen in (("band", inside), ("constellation", own), ("receiver", np.ones_like(own)))
        if name == "receiver" or (chosen & clean).sum() >= max(FEWEST_CLEAN, LEAST_CLEAN * chosen.sum())
    )
    figures: dict[str, float | None] = dict.fromkeys(("p50_m", "p90_m", "p99_m", "noise_m"))
    if found.size:
        p50_m, p90_m, p99_m = (round(float(q), 4) for q in np.quantile(found, (0.5, 0.9, 0.99)))
        noise_m = round(p50_m / NORMAL_QUARTILE / noise_factor(window_epochs), 4)
        figures = {"p50_m": p50_m, "p90_m": p90_m, "p99_m": p99_m, "noise_m": noise_m}
    return Band(
        system=system,  # type: ignore[arg-type]  # a letter of SYSTEMS that the settings let through
        lowest_deg=edges_deg[0],
        highest_deg=edges_deg[1],
        threshold_m=max(round(_threshold_m(sample, false_alarms), 4), 1e-4),
        basis=basis,  # type: ignore[arg-type]  # one of the three names above
        judged=int(inside.sum()),
        clean=int(found.size),
        **figures,
    )
