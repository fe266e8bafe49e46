"""Why an event was told, in words and figures, on the scales that people know: dBm, per cent, bits, hertz, °C."""

from __future__ import annotations

from typing import Final

from services.radio_anomaly.passes import plain
from services.radio_anomaly.precursor import Trend
from services.radio_anomaly.steps import Finding

NAMES: Final = {
    "power": "power",
    "decoded": "decoded power",
    "reception": "reception",
    "bits": "corrected bits",
    "frequency": "frequency offset",
    "temperature": "device temperature",
}
SCALES: Final = {
    "power": (1.0, 1, "dB", " dBm"),
    "decoded": (1.0, 1, "dB", " dBm"),
    "reception": (100.0, 0, "points", "%"),
    "bits": (1.0, 1, "bits a frame", " bits a frame"),
    "frequency": (1.0, 0, "Hz", " Hz"),
    "temperature": (1.0, 1, "°C", " °C"),
}
"""Factor, decimals, unit of a change and of a level."""


def level_words(quantity: str, value: float, *, unit: bool = True) -> str:
    """A value of the analysis' scale as people know it.

    >>> level_words("reception", 3.141592653589793)
    '100%'
    """
    factor, decimals, _, name = SCALES[quantity]
    return f"{factor * plain(quantity, value):.{decimals}f}{name if unit else ''}"


def change_words(quantity: str, reference: float, change: float) -> str:
    """A change from a reference, both on the analysis' scale.

    >>> change_words("power", -70.0, -12.34)
    '-12.3 dB'
    >>> change_words("reception", 3.141592653589793, -1.5707963267948966)
    '-50 points'
    """
    factor, decimals, unit, _ = SCALES[quantity]
    return f"{factor * (plain(quantity, reference + change) - plain(quantity, reference)):+.{decimals}f} {unit}"


def step_words(finding: Finding, shown: tuple[float, float, float], passes: int, length_m: float) -> str:
    """A stretch off its mean; `shown` are the mean measured and a section's usual limits."""
    value, lower, upper = shown
    of = finding.quantity
    usual = f"{level_words(of, lower, unit=False)} to {level_words(of, upper)}"
    seen = "this pass alone" if finding.passes == 1 else f"{finding.passes} passes together"
    sure = "" if finding.confirmed else ", not yet confirmed by a second pass"
    return (
        f"{NAMES[of]} {level_words(of, value)} over {length_m:.0f} m where a section has {usual}: "
        f"{change_words(of, (lower + upper) / 2.0, finding.change)}, {abs(finding.score):.1f} standard deviations from "
        f"{seen}, learned from {passes} passes{sure}"
    )


def trend_words(trend: Trend, reference: float, length_m: float) -> str:
    """A stretch that drifts; `reference` is its learned mean, length 0 the whole line."""
    of = trend.quantity
    factor, decimals, unit, _ = SCALES[of]
    where = f"{length_m:.0f} m" if length_m else "the whole line"
    now = reference + trend.level
    # A slope on the analysis' scale is one on people's scale by the size of a step there.
    step = factor * abs(plain(of, now + STEP) - plain(of, now - STEP)) / (2.0 * STEP)
    return (
        f"{NAMES[of]} of {where} is {change_words(of, reference, trend.level)} off its mean over the last passes and "
        f"goes on by {step * trend.slope_per_day:+.{decimals + 1}f} ± {step * trend.slope_deviation:.{decimals + 1}f} "
        f"{unit} a day"
    )


STEP: Final = 0.01
