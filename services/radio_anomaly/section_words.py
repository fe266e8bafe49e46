"""Sections of a pass beside what is normal there, for people to look at."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable
from typing import Literal, NamedTuple

from schemas.radio import RadioSection
from services.radio_anomaly.monitor import Judgement, by_stream
from services.radio_anomaly.passes import Bin, Journey, plain
from services.radio_anomaly.settings import Settings
from services.radio_anomaly.stream_state import View

State = Literal["learning", "normal", "above", "below", "missing", "trend"]


def section_messages(
    journey: Journey, judgement: Judgement, settings: Settings, shown: Container[tuple[str, str, int]]
) -> list[RadioSection]:
    """One message per radio, channel and section that has not been shown yet, rising."""
    found = []
    for (radio, channel), bins in by_stream(journey).items():
        quantity = "power" if any(b.quantity == "power" for b in bins) else "decoded"
        view = judgement.views.get((quantity, radio, channel))
        ratios = {b.section: plain("reception", b.value) for b in bins if b.quantity == "reception"}
        normal = {} if view is None else _normal_by_section(view, settings.k)
        heard = _mean_by_section(bins, quantity)
        silent = {
            one.start + k
            for one in judgement.silences
            if (one.radio, one.channel) == (radio, channel)
            for k in range(one.length)
        }
        for section in sorted(heard.keys() | silent):
            if (radio, channel, section) in shown:
                continue
            here = normal.get(section, _UNKNOWN)
            found.append(
                RadioSection(
                    t_ns=journey.last_ns,
                    radio=radio,
                    channel=channel,
                    direction=journey.direction or None,  # type: ignore[arg-type]  # up, down or empty
                    section_start_m=section * settings.section_m,
                    section_end_m=(section + 1) * settings.section_m,
                    state=_state(judgement, radio, channel, section),
                    value_dbm=heard.get(section),
                    lower_dbm=here.lower_dbm,
                    mean_dbm=here.mean_dbm,
                    upper_dbm=here.upper_dbm,
                    received_ratio=ratios.get(section),
                    passes=here.passes,
                    pass_id=journey.pass_id,
                )
            )
    return found


class _Normal(NamedTuple):
    """What is normal in a section, and from how many passes that is known."""

    lower_dbm: float | None
    mean_dbm: float | None
    upper_dbm: float | None
    passes: int


_UNKNOWN = _Normal(None, None, None, 0)


def _normal_by_section(view: View, k: float) -> dict[int, _Normal]:
    """Mean of what was learned, and `k` standard deviations of a pass to either side."""
    residuals = view.residuals
    found = {}
    for row, section in enumerate(residuals.sections):
        mean = float(view.values[row] - residuals.residual[row])
        width = k * math.sqrt(residuals.mean_variance[row] + residuals.variance[row])
        found[int(section)] = _Normal(mean - width, mean, mean + width, int(residuals.passes[row]))
    return found


def _mean_by_section(bins: Iterable[Bin], quantity: str) -> dict[int, float]:
    """Mean of a quantity over what was heard in each section."""
    sums: dict[int, list[float]] = {}
    for b in bins:
        if b.quantity == quantity:
            entry = sums.setdefault(b.section, [0.0, 0.0])
            entry[0] += b.count
            entry[1] += b.count * b.value
    return {section: total / count for section, (count, total) in sums.items()}


def _state(judgement: Judgement, radio: str, channel: str, section: int) -> State:
    key = (radio, channel)
    if key in judgement.learning:
        return "learning"
    for silence in judgement.silences:
        if (silence.radio, silence.channel) == key and 0 <= section - silence.start < silence.length:
            return "missing"
    for finding in judgement.findings:
        if (finding.radio, finding.channel) == key and finding.overlaps(section, 1):
            if finding.quantity == "reception" and finding.score < 0.0:
                return "missing"
            return "above" if finding.score > 0.0 else "below"
    for trend in judgement.trends:
        if (trend.radio, trend.channel) == key and (not trend.length or 0 <= section - trend.start < trend.length):
            return "trend"
    return "normal"
