"""How good positions were: error against bound, and the margin from reference to reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LONGEST_STEP_S: Final = 1.0
"""Truth is not interpolated over longer gaps."""
RESET_SHARE: Final = 0.8
"""A margin that falls below this share within a second was reset."""
JUMP_M: Final = 30.0
"""Truth that moves by more within a step stands at another end of the train: it is not interpolated."""


@dataclass(frozen=True, slots=True, eq=False)
class Positions:
    """Positions one after the other; every column has shape (n,), NaN without a place."""

    name: str
    t_s: Floats
    axis_m: Floats
    ahead_m: Floats
    behind_m: Floats
    sign: Floats
    """+1 where the front end looks towards rising `axis_m`, else -1."""
    slip: NDArray[np.bool_]
    status: tuple[str, ...]

    @property
    def margin_m(self) -> Floats:
        """The larger of the bounds ahead and behind: the safety margin of Iwata et al."""
        return np.maximum(self.ahead_m, self.behind_m)


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Where the front end really was."""

    t_s: Floats
    axis_m: Floats

    def at(self, t_s: Floats) -> Floats:
        """Place at times; NaN outside, over gaps and where the front end became the other end of the train."""
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        step_s = self.t_s[after] - self.t_s[after - 1]
        step_m = np.abs(self.axis_m[after] - self.axis_m[after - 1])
        found = np.interp(t_s, self.t_s, self.axis_m, left=np.nan, right=np.nan)
        return np.asarray(np.where((step_s <= LONGEST_STEP_S) & (step_m <= JUMP_M), found, np.nan))


@dataclass(frozen=True, slots=True, eq=False)
class Passes:
    """References passed."""

    t_s: Floats
    names: tuple[str, ...]
    kinds: tuple[str, ...] = ()
    """`landmark` or `balise` each; empty where that is not known."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """Figures of one run."""

    name: str
    rows: int
    compared: int
    """Rows with a place and a truth."""
    valid_percent: float
    degraded_percent: float
    lost_percent: float
    within: int
    within_percent: float
    median_error_m: float
    p95_error_m: float
    largest_error_m: float
    largest_excess_m: float
    """By how much an error exceeded its bound at most; not positive when none did."""
    median_margin_m: float
    largest_margin_m: float
    resets: int
    margin_maxima_m: tuple[float, ...]
    """Largest margin between one reset and the next."""
    median_of_maxima_m: float


def judge(positions: Positions, truth: Truth) -> Judgement:
    """Hold positions against the truth. Raises ValueError when none can be."""
    true_m = truth.at(positions.t_s)
    error_m = positions.axis_m - true_m
    known = np.isfinite(error_m)
    if not known.any():
        msg = f"{positions.name}: no position at a time with truth"
        raise ValueError(msg)
    error_m, margin_m = error_m[known], positions.margin_m[known]
    # A front end further on than the estimate is bounded ahead; positive error is an estimate too far along the axis.
    along_m = error_m * positions.sign[known]
    bound_m = np.where(along_m > 0.0, positions.behind_m[known], positions.ahead_m[known])
    over_m = np.abs(error_m) - bound_m
    maxima_m = margin_maxima(positions.t_s[known], margin_m)
    count = len(positions.t_s)
    shares = {
        name: 100.0 * sum(one == name for one in positions.status) / count for name in ("valid", "degraded", "lost")
    }
    return Judgement(
        name=positions.name,
        rows=count,
        compared=int(known.sum()),
        valid_percent=shares["valid"],
        degraded_percent=shares["degraded"],
        lost_percent=shares["lost"],
        within=int((over_m <= 0.0).sum()),
        within_percent=100.0 * float((over_m <= 0.0).mean()),
        median_error_m=float(np.median(np.abs(error_m))),
        p95_error_m=float(np.percentile(np.abs(error_m), 95)),
        largest_error_m=float(np.abs(error_m).max()),
        largest_excess_m=float(over_m.max()),
        median_margin_m=float(np.median(margin_m)),
        largest_margin_m=float(margin_m.max()),
        resets=len(maxima_m) - 1,
        margin_maxima_m=maxima_m,
        median_of_maxima_m=float(np.median(maxima_m)),
    )


def margin_maxima(t_s: Floats, margin_m: Floats) -> tuple[float, ...]:
    """Largest margin between resets, in order: the teeth of the saw.

    >>> margin_maxima(np.arange(6.0), np.array([10.0, 20.0, 30.0, 5.0, 9.0, 12.0]))
    (30.0, 12.0)
    """
    maxima: list[float] = []
    peak_m = float(margin_m[0])
    for i in range(1, len(margin_m)):
        if margin_m[i] < RESET_SHARE * margin_m[i - 1] and t_s[i] - t_s[i - 1] <= LONGEST_STEP_S:
            maxima.append(peak_m)
            peak_m = float(margin_m[i])
        peak_m = max(peak_m, float(margin_m[i]))
    return (*maxima, peak_m)
