"""The paper's method as it stands: A ± kσ per section, radio and channel, learned once.

Source: Nakaune, Radio Wave Monitor in the Wireless Train Control System Utilizing AI, section 3: from normal
data the mean A_x and standard deviation σ_x of the power in section x of D metres,

    T_up(x) = A_x + kσ_x,   T_down(x) = A_x - kσ_x,

and a measurement at or above the one, or at or below the other, is abnormal (Table 1).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import msgspec

from schemas.radio import Cause, Kind
from services.radio_anomaly.baseline import Sums
from services.radio_anomaly.passes import section_of
from services.radio_anomaly.reading import Reading

Key = tuple[str, str, int]
"""Radio, channel, section."""
LEAST = 2
"""Samples for a standard deviation."""


class Threshold(msgspec.Struct, frozen=True):
    """A section's mean and limits, dBm."""

    mean_dbm: float
    lower_dbm: float
    upper_dbm: float
    samples: int


class Excess(msgspec.Struct, frozen=True, kw_only=True):
    """Neighbouring sections in which a pass had samples beyond the same limit."""

    radio: str
    channel: str
    start: int
    length: int
    kind: Kind
    cause: Cause
    value_dbm: float
    """The farthest sample,"""
    lower_dbm: float
    upper_dbm: float
    score: float
    """and how many standard deviations it is off its section's mean."""
    reason: str


def power_of(reading: Reading) -> float | None:
    """Channel power, else that of what was decoded."""
    return reading.power_dbm if reading.power_dbm is not None else reading.decoded_power_dbm


def sums_of(readings: Iterable[Reading], section_m: float) -> dict[Key, Sums]:
    """n, Σ, Σ² of the samples of every section."""
    found: dict[Key, Sums] = {}
    for one in readings:
        power = power_of(one)
        if power is not None:
            section = 0 if one.chainage_m is None else section_of(one.chainage_m, section_m)
            found.setdefault((one.radio, one.channel, section), Sums()).add(1.0, power, power * power)
    return found


def thresholds_of(sums: dict[Key, Sums], k: float) -> dict[Key, Threshold]:
    """T_up and T_down of every section with two samples.

    >>> sums = Sums(); [sums.add(1.0, p, p * p) for p in (-81.0, -79.0)] and None
    >>> thresholds_of({("r", "c", 0): sums}, 3.0)[("r", "c", 0)].upper_dbm
    -77.0
    """
    found = {}
    for key, one in sums.items():
        if one.n < LEAST:
            continue
        # The paper says standard deviation, not which: of the population.
        deviation = math.sqrt(max(one.squares / one.n - one.mean**2, 0.0))
        found[key] = Threshold(one.mean, one.mean - k * deviation, one.mean + k * deviation, int(one.n))
    return found


def analyse(readings: Sequence[Reading], thresholds: dict[Key, Threshold], section_m: float, k: float) -> list[Excess]:
    """Sections of one pass with a sample at or beyond a limit, neighbours of the same kind put together."""
    worst: dict[tuple[str, str, str, int], float] = {}
    for one in readings:
        power = power_of(one)
        section = 0 if one.chainage_m is None else section_of(one.chainage_m, section_m)
        limit = thresholds.get((one.radio, one.channel, section))
        if power is None or limit is None:
            continue
        if power >= limit.upper_dbm:
            key = (one.radio, one.channel, "above", section)
            worst[key] = max(worst.get(key, power), power)
        elif power <= limit.lower_dbm:
            key = (one.radio, one.channel, "below", section)
            worst[key] = min(worst.get(key, power), power)
    runs: list[list[tuple[str, str, str, int]]] = []
    for key in sorted(worst):
        if runs and runs[-1][-1][:3] == key[:3] and runs[-1][-1][3] + 1 == key[3]:
            runs[-1].append(key)
        else:
            runs.append([key])
    return [_excess(run, worst, thresholds, k, section_m) for run in runs]


def _excess(
    run: list[tuple[str, str, str, int]],
    worst: dict[tuple[str, str, str, int], float],
    thresholds: dict[Key, Threshold],
    k: float,
    section_m: float,
) -> Excess:
    def score(key: tuple[str, str, str, int]) -> float:
        limit = thresholds[(key[0], key[1], key[3])]
        deviation = (limit.upper_dbm - limit.mean_dbm) / k
        return (worst[key] - limit.mean_dbm) / deviation if deviation > 0.0 else math.copysign(99.0, worst[key])

    farthest = max(run, key=lambda key: abs(score(key)))
    limit = thresholds[(farthest[0], farthest[1], farthest[3])]
    above = run[0][2] == "above"
    side, bound = ("upper", limit.upper_dbm) if above else ("lower", limit.lower_dbm)
    causes = "interference possible" if above else "dead zone, device failure or snow possible"
    return Excess(
        radio=run[0][0],
        channel=run[0][1],
        start=run[0][3],
        length=len(run),
        kind="above" if above else "below",
        cause="interference" if above else "unknown",
        value_dbm=worst[farthest],
        lower_dbm=limit.lower_dbm,
        upper_dbm=limit.upper_dbm,
        score=score(farthest),
        reason=(
            f"{worst[farthest]:.1f} dBm is beyond the {side} threshold {bound:.1f} dBm of the section at "
            f"{farthest[3] * section_m:.0f} m, learned from {limit.samples} samples; {causes}"
        ),
    )
