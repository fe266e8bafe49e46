"""All that is learned of one radio on one channel."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from services.radio_anomaly.baseline import Baseline, Book, Mask, one
from services.radio_anomaly.passes import Bin, Journey, transformed
from services.radio_anomaly.settings import Settings
from services.radio_anomaly.window_test import Correlation, Floats, PassTest, Residuals, pass_tests

POWERS: Final = ("power", "decoded")
TESTED: Final = ("power", "decoded", "reception")
"""Quantities whose windows are tested."""
FOLLOWED: Final = (*TESTED, "bits", "frequency", "temperature")
"""Those that precursors follow. Transmit power is no test of its own: it explains the others."""
SLOPE_PRIOR: Final = 400.0
"""Weight of `no effect of temperature`, in passes times square degrees: four passes at 10 °C from the mean."""


CONTROLLED_DB2: Final = 1.5
"""Variance of transmit power between passes above which it is controlled on purpose."""


class TemperatureEffect(msgspec.Struct):
    """How the power of whole passes hangs on the device's temperature: sums for a straight line."""

    n: float = 0.0
    sum_t: float = 0.0
    sum_r: float = 0.0
    sum_tt: float = 0.0
    sum_tr: float = 0.0

    def add(self, temperature_c: float, residual_db: float) -> None:
        """Merge a pass."""
        self.n += 1.0
        self.sum_t += temperature_c
        self.sum_r += residual_db
        self.sum_tt += temperature_c**2
        self.sum_tr += temperature_c * residual_db

    def at(self, temperature_c: float) -> float:
        """What the temperature explains [dB], shrunk to none while little is known."""
        if self.n < 2.0:  # noqa: PLR2004 - a line needs two points
            return 0.0
        spread = self.sum_tt - self.sum_t**2 / self.n
        slope = (self.sum_tr - self.sum_t * self.sum_r / self.n) / (spread + SLOPE_PRIOR)
        return slope * (temperature_c - self.sum_t / self.n)


class StreamState:
    """One radio on one channel."""

    def __init__(self) -> None:
        """Nothing learned."""
        self.passes = 0.0
        self.books: defaultdict[str, Book] = defaultdict(Book)
        self.temperature = TemperatureEffect()
        self._fitted: dict[tuple[str, bool], Baseline] = {}

    def baseline(self, quantity: str, half_life_days: float, mask: Mask | None, *, site: bool = False) -> Baseline:
        """Fitted on the first question after learning; of the line, or of what was heard without a place at a site.

        A wayside radio knows the place of some trains only: the one history says nothing of the other.
        """
        if (quantity, site) not in self._fitted:
            merged = self.books[quantity].merged(half_life_days, mask)
            groups = {group: sums for group, sums in merged.items() if (group[0] == "") is site}
            self._fitted[(quantity, site)] = Baseline(quantity, groups)
        return self._fitted[(quantity, site)]

    def forget_fit(self) -> None:
        """Fit anew when asked next."""
        self._fitted.clear()

    def learn(self, journey: Journey, bins: Sequence[Bin], withheld: frozenset[int]) -> None:
        """Add a pass; sections in `withheld` stay apart."""
        self.passes += 1.0
        for bin_ in bins:
            group = (journey.direction, bin_.section, bin_.cell)
            self.books[bin_.quantity].add(journey.day, group, one(bin_.value), withheld=bin_.section in withheld)


class View(msgspec.Struct, frozen=True):
    """One quantity of one radio and channel on one pass, against what was learned."""

    residuals: Residuals
    values: Floats
    """Measured, per section, beside the residuals."""
    tests: tuple[PassTest, ...]

    @property
    def extent(self) -> tuple[int, int]:
        """First section, and how many to the last."""
        sections = self.residuals.sections
        return int(sections[0]), int(sections[-1] - sections[0]) + 1

    def over(self, start: int, length: int) -> slice:
        """Rows of a window of sections."""
        first, past = np.searchsorted(self.residuals.sections, (start, start + length))
        return slice(int(first), int(past))


def view_of(
    state: StreamState,
    quantity: str,
    bins: Sequence[Bin],
    direction: str,
    settings: Settings,
    correlation: Correlation,
    mask: Mask | None,
) -> View | None:
    """A pass's residuals and tests of one quantity; None without any."""
    mine = [bin_ for bin_ in bins if bin_.quantity == quantity]
    baseline = state.baseline(quantity, settings.half_life_days, mask, site=not direction)
    if not mine or not baseline.sections():
        return None
    explained = _explained(state, quantity, bins, settings, mask, site=not direction)
    # Where reception was bad already, a bad pass is nothing new, and scatters more than the line's spread tells.
    least_mean = transformed(quantity, settings.least_received_ratio) if quantity == "reception" else -math.inf
    rows: dict[int, list[float]] = {}
    for bin_ in mine:
        expected = baseline.predict(direction, bin_.section, bin_.cell)
        if expected.mean < least_mean:
            continue
        entry = rows.setdefault(bin_.section, [0.0, 0.0, 0.0, 0.0, expected.variance, expected.passes])
        entry[0] += bin_.count
        entry[1] += bin_.count * (bin_.value - expected.mean - explained)
        entry[2] += bin_.count * expected.mean_variance
        entry[3] += bin_.count * bin_.value
    if not rows:
        return None
    sections = np.array(sorted(rows), dtype=np.int64)
    table = np.array([rows[int(section)] for section in sections])
    residuals = Residuals(
        sections, table[:, 1] / table[:, 0], table[:, 2] / table[:, 0], table[:, 4].copy(), table[:, 5].copy()
    )
    tests = pass_tests(residuals, correlation, site=not direction)
    return View(residuals, table[:, 3] / table[:, 0], tests)


def transmit_change(
    state: StreamState, bins: Sequence[Bin], settings: Settings, mask: Mask | None, *, site: bool
) -> float | None:
    """Transmit power against its mean, dB; None where it is not told."""
    told = [bin_ for bin_ in bins if bin_.quantity == "transmit"]
    if not told or "transmit" not in state.books:
        return None
    mean = sum(bin_.count * bin_.value for bin_ in told) / sum(bin_.count for bin_ in told)
    return mean - state.baseline("transmit", settings.half_life_days, mask, site=site).line_mean


def mean_temperature(bins: Sequence[Bin]) -> float | None:
    """Of the device over the pass, °C."""
    told = [bin_ for bin_ in bins if bin_.quantity == "temperature"]
    return sum(b.count * b.value for b in told) / sum(b.count for b in told) if told else None


def _explained(
    state: StreamState, quantity: str, bins: Sequence[Bin], settings: Settings, mask: Mask | None, *, site: bool
) -> float:
    """What the device's temperature explains of a power [dB], and its transmit power where that is controlled."""
    if quantity not in POWERS:
        return 0.0
    warm_c = mean_temperature(bins)
    warm_db = 0.0 if warm_c is None else state.temperature.at(warm_c)
    change_db = transmit_change(state, bins, settings, mask, site=site)
    if change_db is None:
        return warm_db
    spread_db2 = state.baseline("transmit", settings.half_life_days, mask, site=site).line_variance
    # A transmitter whose power was steady while it was learned has no business to change it: that is for an event.
    return warm_db + (change_db if spread_db2 > CONTROLLED_DB2 else 0.0)
