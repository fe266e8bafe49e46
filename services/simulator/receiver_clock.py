"""A receiver's clock: a drifting oscillator that is set back by whole steps."""

from __future__ import annotations

from math import sqrt


class ReceiverClock:
    """Bias and drift of a receiver's clock against GPS time.

    The drift walks randomly; the bias is its integral (trapezium). Once the bias is beyond half a
    step, the clock is set by one step, as receivers do by a millisecond: every pseudorange and
    carrier phase then jumps alike, and the drift does not.
    """

    def __init__(self, *, bias_s: float, drift: float, walk: float, step_s: float) -> None:
        """Start with a bias [s] and drift [s/s]; `walk` [s/s/sqrt(s)]; `step_s` 0 for a clock never set."""
        self.bias_s = bias_s
        """Receiver minus GPS time."""
        self.drift = drift
        self._walk = walk
        self._step_s = step_s

    def advance(self, interval_s: float, normal: float) -> None:
        """Let `interval_s` pass; `normal` is a draw of the standard normal distribution."""
        before = self.drift
        self.drift += self._walk * sqrt(interval_s) * normal
        self.bias_s += (before + self.drift) / 2 * interval_s
        if self._step_s and abs(self.bias_s) > self._step_s / 2:
            self.bias_s -= self._step_s * round(self.bias_s / self._step_s)
