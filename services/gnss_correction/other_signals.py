"""A satellite's further signals, as witnesses of what reflections do to the first.

Reflections, unlike ranges, differ from frequency to frequency. With a correction for every signal, the corrected
pseudoranges of a satellite differ by reflections, noise and the receivers' delays alone; the delays are common
to a constellation's satellites and go with the median. The mean of the signals is the better pseudorange.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Final

import numpy as np

from services.gnss_correction.solver_arrays import Records
from services.gnss_receiver.observations import Observations

FEWEST: Final = 3
"""Satellites of a constellation from which on the median stands for the receivers' delays."""
LARGEST_M: Final = 20.0
"""A signal that differs by more from the others' is reflected, or another satellite's: it does not count."""
GAP_S: Final = 1.5
"""After a longer gap an average begins anew."""

Differences = dict[tuple[int, str], float]
"""By satellite code and signal: pseudorange minus that of the satellite's first signal [m]."""


def signal_differences(observations: Observations, epoch: int, rows: Records) -> Differences:
    """What the further signals of the satellites in `rows` measure at an epoch, against the first ones."""
    first, last = int(observations.first_row[epoch]), int(observations.first_row[epoch + 1])
    raw_m = observations.pseudorange_m[first:last][rows["source"] - first].tolist()
    mains = zip(rows["signal"].tolist(), raw_m, strict=True)
    chosen = dict(zip(rows["satellite"].tolist(), mains, strict=True))
    found: Differences = {}
    for code, signal, pseudorange_m in zip(
        observations.satellite[first:last].tolist(),
        observations.signal[first:last].tolist(),
        observations.pseudorange_m[first:last].tolist(),
        strict=True,
    ):
        main = chosen.get(code)
        if main is not None and signal != main[0] and abs(pseudorange_m - main[1]) < 10.0 * LARGEST_M:
            found[code, observations.signals[signal]] = pseudorange_m - main[1]
    return found


def centred(differences: Differences) -> Differences:
    """Differences less the median of constellation and signal, without those far off or of too few satellites."""
    groups: dict[tuple[int, str], list[int]] = defaultdict(list)
    for code, signal in differences:
        groups[code // 100, signal].append(code)
    found: Differences = {}
    for (_, signal), codes in groups.items():
        if len(codes) < FEWEST:
            continue
        median_m = float(np.median([differences[code, signal] for code in codes]))
        for code in codes:
            value_m = differences[code, signal] - median_m
            if abs(value_m) <= LARGEST_M:
                found[code, signal] = value_m
    return found


class SignalAverages:
    """Differences averaged over the past, satellite by satellite and signal by signal."""

    def __init__(self, averaging_s: float) -> None:
        """Know nothing; 0 takes each difference as it is."""
        self._averaging_s = averaging_s
        self._known: dict[tuple[int, str], tuple[float, float, float]] = {}

    def take(self, t_s: float, differences: Differences) -> Differences:
        """Averages of what is measured at `t_s`."""
        if self._averaging_s <= 0.0:
            return differences
        found: Differences = {}
        for name, value_m in differences.items():
            then_s, since_s, mean_m = self._known.get(name, (-np.inf, t_s, value_m))
            age_s = t_s - then_s
            if not 0.0 < age_s <= GAP_S:
                since_s, mean_m, age_s = t_s, value_m, 0.0
            span_s = min(max(t_s - since_s + age_s, 1e-9), self._averaging_s)
            mean_m += min(age_s / span_s, 1.0) * (value_m - mean_m)
            self._known[name] = (t_s, since_s, mean_m)
            found[name] = mean_m
        return found
