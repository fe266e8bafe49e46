"""Sections of a pass beside what is normal there, for people to look at."""

from __future__ import annotations

import math
from collections.abc import Container
from typing import Literal

from schemas.radio import RadioSection
from services.radio_anomaly.monitor import Judgement, by_stream
from services.radio_anomaly.passes import Journey, plain
from services.radio_anomaly.settings import Settings

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
        rows = {} if view is None else {int(s): k for k, s in enumerate(view.residuals.sections)}
        heard: dict[int, list[float]] = {}
        for b in bins:
            if b.quantity == quantity:
                entry = heard.setdefault(b.section, [0.0, 0.0])
                entry[0] += b.count
                entry[1] += b.count * b.value
        silent = {
            one.start + k
            for one in judgement.silences
            if (one.radio, one.channel) == (radio, channel)
            for k in range(one.length)
        }
        for section in sorted(heard.keys() | silent):
            if (radio, channel, section) in shown:
                continue
            mean = lower = upper = None
            passes = 0
            if view is not None and section in rows:
                k = rows[section]
                residuals = view.residuals
                mean = float(view.values[k] - residuals.residual[k])
                width = settings.k * math.sqrt(residuals.mean_variance[k] + residuals.variance[k])
                lower, upper, passes = mean - width, mean + width, int(residuals.passes[k])
            here = heard.get(section)
            found.append(
                RadioSection(
                    t_ns=journey.last_ns,
                    radio=radio,
                    channel=channel,
                    direction=journey.direction or None,  # type: ignore[arg-type]  # up, down or empty
                    section_start_m=section * settings.section_m,
                    section_end_m=(section + 1) * settings.section_m,
                    state=_state(judgement, radio, channel, section),
                    value_dbm=None if here is None else here[1] / here[0],
                    lower_dbm=lower,
                    mean_dbm=mean,
                    upper_dbm=upper,
                    received_ratio=ratios.get(section),
                    passes=passes,
                    pass_id=journey.pass_id,
                )
            )
    return found


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
