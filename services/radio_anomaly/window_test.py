"""Is a stretch of the line off its mean? Generalised least squares over windows of sections.

The residuals r of one pass have covariance K. What passes differ by: each section's own variance, a share common
to the whole pass (the train's day), and one that fades along the line (shadowing). And the error of the learned
mean, which neighbours share. For a change δ over the sections
of a window, marked by d, the best estimate and its variance (Aitken 1935) are

    δ = dᵀK⁻¹r / dᵀK⁻¹d,   var δ = 1 / dᵀK⁻¹d.

Both sums add up over passes, so three passes are one estimate. What they share is the error of the learned means:
its part of var δ, m = (K⁻¹d)ᵀM(K⁻¹d) / (dᵀK⁻¹d)² with M the covariance of that error, does not fade with their number.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
CLIP: Final = 5.0
"""A section says no more than this many standard deviations beyond the median of five around it: cells change, trains
stand under bridges. What three neighbours of five say is not cut."""
NEAR_SECTIONS: Final = 2
WHOLE: Final = 0
"""Length under which all of a pass is a window."""
LEAST_WHOLE: Final = 5
"""Sections of a pass for it to be one."""
MEAN_SHARE: Final = 0.8
MEAN_REACH: Final = 10.0
"""How errors of learned means hang together: their share, and the sections over which it fades."""
CHUNK: Final = 400
"""Sections that are taken together at most: the effort grows with the cube."""


class Correlation(msgspec.Struct, frozen=True, gc=False, kw_only=True):
    """How residuals of one pass hang together: shares of their variance."""

    whole: float = 0.05
    """Common to the pass."""
    near: float = 0.25
    """Fading with `reach` sections."""
    reach: float = 2.0
    inflation: float = 1.0
    """Factor on every standard deviation, from held-out passes."""


class Residuals(msgspec.Struct, frozen=True, gc=False):
    """One quantity of one radio and channel on one pass; one row per section, rising."""

    sections: NDArray[np.int64]
    residual: Floats
    mean_variance: Floats
    variance: Floats
    passes: Floats


class WindowSum(msgspec.Struct, frozen=True, gc=False):
    """What a pass says about a window: dᵀK⁻¹r and dᵀK⁻¹d."""

    start: int
    length: int
    pull: float
    information: float
    observed: int
    lasting_variance: float = 0.0
    """Of the part of δ's variance that the error of the learned means makes: it is much the same on the next pass."""
    learned_passes: float = 0.0
    """Of its sections, in the mean."""


class PassTest:
    """K⁻¹r and K⁻¹ of a pass as running sums, from which every window follows at once."""

    def __init__(self, residuals: Residuals, correlation: Correlation, *, site: bool = False) -> None:
        """Up to CHUNK sections; at a site, with its one section, nothing is cut."""
        self.sections = residuals.sections
        deviation = correlation.inflation * np.sqrt(residuals.mean_variance + residuals.variance)
        self.z = residuals.residual / deviation
        clipped = (self.z if site else cut(self.z)) * deviation
        apart = np.abs(self.sections[:, None] - self.sections[None, :])
        shape = correlation.whole + correlation.near * np.exp(-apart / correlation.reach)
        shape[np.diag_indices(len(self.sections))] = 1.0
        # A mean is wrong alike over sections: they know the same few passes, or the same cell from elsewhere.
        mean_shape = MEAN_SHARE * np.exp(-apart / MEAN_REACH)
        mean_shape[np.diag_indices(len(self.sections))] = 1.0
        passing = correlation.inflation * np.sqrt(residuals.variance)
        mean_error = correlation.inflation * np.sqrt(residuals.mean_variance)
        mean_covariance = mean_shape * np.outer(mean_error, mean_error)
        inverse = np.linalg.inv(shape * np.outer(passing, passing) + mean_covariance)
        count = len(self.sections)
        self._pull = np.concatenate([[0.0], np.cumsum(inverse @ clipped)])
        self._information = np.zeros((count + 1, count + 1))
        self._information[1:, 1:] = inverse.cumsum(0).cumsum(1)
        self._passes = np.concatenate([[0.0], np.cumsum(residuals.passes)])
        self._lasting = np.zeros((count + 1, count + 1))
        self._lasting[1:, 1:] = (inverse @ mean_covariance @ inverse).cumsum(0).cumsum(1)
        shared = residuals.mean_variance.mean() / count + correlation.whole * residuals.variance.mean() / max(
            float(residuals.passes.mean()), 1.0
        )
        self.shared_variance = float(shared)
        """Of the learned mean over the whole pass: the same error on every later pass."""

    def over(self, first: int, past: int) -> tuple[float, float]:
        """Pull and information of the sections with these indices."""
        info = self._information
        return (
            float(self._pull[past] - self._pull[first]),
            float(info[past, past] - info[first, past] - info[past, first] + info[first, first]),
        )

    def lasting(self, first: int, past: int) -> float:
        """Their (K⁻¹d)ᵀM(K⁻¹d): over the square of the information it is what lasts of the variance."""
        sums = self._lasting
        return float(sums[past, past] - sums[first, past] - sums[past, first] + sums[first, first])

    def learned(self, first: int, past: int) -> float:
        """Sum of the passes that each of them was learned from."""
        return float(self._passes[past] - self._passes[first])

    def window(self, start: int, length: int) -> WindowSum | None:
        """Sums of a window of sections; None unless half of it was observed."""
        first, past = np.searchsorted(self.sections, (start, start + length))
        if past - first < max(1, (length + 1) // 2):
            return None
        pull, information = self.over(int(first), int(past))
        lasting = self.lasting(int(first), int(past)) / information**2
        passes = self.learned(int(first), int(past)) / float(past - first)
        return WindowSum(start, length, pull, information, int(past - first), lasting, passes)

    def windows(self, lengths: tuple[int, ...]) -> Iterator[WindowSum]:
        """Every window that half was observed of."""
        low, high = int(self.sections[0]), int(self.sections[-1])
        for length in lengths:
            # A hole of the line between two stretches is not walked section by section.
            starts = np.unique((self.sections[:, None] - np.arange(length)[None, :]).ravel())
            starts = starts[(starts >= low - length + 1) & (starts <= high)]
            first = np.searchsorted(self.sections, starts)
            past = np.searchsorted(self.sections, starts + length)
            enough = past - first >= max(1, (length + 1) // 2)
            starts, first, past = starts[enough], first[enough], past[enough]
            pull = self._pull[past] - self._pull[first]
            information = _block(self._information, first, past)
            lasting = _block(self._lasting, first, past) / information**2
            passes = (self._passes[past] - self._passes[first]) / (past - first)
            for k in range(len(starts)):
                yield WindowSum(
                    int(starts[k]),
                    length,
                    float(pull[k]),
                    float(information[k]),
                    int(past[k] - first[k]),
                    float(lasting[k]),
                    float(passes[k]),
                )


def _block(sums: Floats, first: NDArray[np.int64], past: NDArray[np.int64]) -> Floats:
    """Of running sums over rows and columns, what lies between."""
    found: Floats = sums[past, past] - sums[first, past] - sums[past, first] + sums[first, first]
    return found


def cut(scores: Floats) -> Floats:
    """Scores without what single sections say beyond their neighbours.

    >>> cut(np.array([0.0, 0.0, 9.0, 0.0, 0.0])).tolist()
    [0.0, 0.0, 5.0, 0.0, 0.0]
    >>> cut(np.array([0.0, 9.0, 9.0, 9.0, 0.0])).tolist()
    [0.0, 9.0, 9.0, 9.0, 0.0]
    """
    padded = np.pad(scores, NEAR_SECTIONS, constant_values=0.0)
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * NEAR_SECTIONS + 1), axis=1)
    return np.clip(scores, np.minimum(middle, 0.0) - CLIP, np.maximum(middle, 0.0) + CLIP)


def whole_sum(tests: Sequence[PassTest]) -> WindowSum | None:
    """All of a pass as one window; None for a short one."""
    count = sum(len(test.sections) for test in tests)
    if count < LEAST_WHOLE:
        return None
    sums = [test.over(0, len(test.sections)) for test in tests]
    information = sum(info for _, info in sums)
    lasting = sum(test.lasting(0, len(test.sections)) for test in tests) / information**2
    passes = sum(test.learned(0, len(test.sections)) for test in tests) / count
    return WindowSum(0, WHOLE, sum(pull for pull, _ in sums), information, count, lasting, passes)


def pass_tests(residuals: Residuals, correlation: Correlation, *, site: bool) -> tuple[PassTest, ...]:
    """Tests of a pass, a long one in pieces."""
    return tuple(PassTest(part, correlation, site=site) for part in chunks(residuals))


def without(residuals: Residuals, start: int, length: int) -> Residuals:
    """The rows outside a stretch of sections."""
    rest = (residuals.sections < start) | (residuals.sections >= start + length)
    return _rows(residuals, rest)


def chunks(residuals: Residuals) -> Iterator[Residuals]:
    """A long pass in pieces."""
    for begin in range(0, len(residuals.sections), CHUNK):
        yield _rows(residuals, slice(begin, begin + CHUNK))


def _rows(residuals: Residuals, rows: slice | NDArray[np.bool_]) -> Residuals:
    return Residuals(
        residuals.sections[rows],
        residuals.residual[rows],
        residuals.mean_variance[rows],
        residuals.variance[rows],
        residuals.passes[rows],
    )
