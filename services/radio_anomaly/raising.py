"""From what a pass shows to events: merged with what is open, with cause, figures and a reason in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal

import msgspec
import numpy as np

from schemas.radio import Kind, RadioEvent, Weather
from services.radio_anomaly.cause import Circumstances, cause_of
from services.radio_anomaly.event_book import OpenEvent
from services.radio_anomaly.monitor import Judgement, Monitor, by_stream
from services.radio_anomaly.passes import Journey, plain
from services.radio_anomaly.precursor import Loss, Trend, expected_loss
from services.radio_anomaly.presence import Silence
from services.radio_anomaly.steps import Finding, Stream
from services.radio_anomaly.stream_state import POWERS, View, transmit_change

OFF_SCORE: Final = 1.0
"""A section this many standard deviations off the same way counts as going with an event."""
UNITS: Final = {
    "power": "dB",
    "decoded": "dB",
    "reception": "of 3.14 (angular reception)",
    "bits": "ln bits",
    "frequency": "Hz",
    "temperature": "°C",
}
NAMES: Final = {
    "power": "power",
    "decoded": "decoded power",
    "reception": "reception",
    "bits": "corrected bits",
    "frequency": "frequency offset",
    "temperature": "device temperature",
}


class Evidence(msgspec.Struct, frozen=True, kw_only=True):
    """What the model rests on, shown with each of its events."""

    false_alarm_rate: float | None = None
    """Share of held-out normal pass-sections that were reported as confirmed."""
    cells: int = 0
    """Pass-sections that the share is of."""


class Raiser:
    """Makes events of judgements. The monitor's book of events is brought up to date on the way."""

    def __init__(self, monitor: Monitor, evidence: Evidence) -> None:
        """For a monitor and the evidence of its model."""
        self._monitor, self._evidence = monitor, evidence

    def take(self, journey: Journey, weather: Weather | None = None) -> tuple[list[RadioEvent], Judgement]:
        """Judge a pass, tell its events (also those that ended), and remember it."""
        judgement = self._monitor.judge(journey)
        told = self.events_of(journey, judgement, weather)
        told += [self._ended(journey, one) for one in self._monitor.events.close(journey)]
        self._monitor.commit(journey, judgement, weather)
        return told, judgement

    def events_of(self, journey: Journey, judgement: Judgement, weather: Weather | None = None) -> list[RadioEvent]:
        """Events of a pass, or of the part of it that was driven."""
        told = [
            self._step(journey, judgement, finding, weather)
            for finding in judgement.findings
            if not self._said_better(finding, judgement)
        ]
        told += [self._missing(journey, judgement, silence, weather) for silence in judgement.silences]
        return told + [self._trend(journey, judgement, trend, weather) for trend in clearest(judgement.trends)]

    def _said_better(self, finding: Finding, judgement: Judgement) -> bool:
        """A fall of one quantity that a clearer finding of another tells of already."""
        return any(
            other is not finding
            and (other.radio, other.channel) == (finding.radio, finding.channel)
            and (_kind(other) == _kind(finding))
            and (other.confirmed, abs(other.score)) > (finding.confirmed, abs(finding.score))
            and other.quantity != finding.quantity
            and other.overlaps(finding.start, finding.length)
            for other in judgement.findings
        )

    def _step(self, journey: Journey, judgement: Judgement, finding: Finding, weather: Weather | None) -> RadioEvent:
        kind = _kind(finding)
        stretch = (finding.start, finding.length)
        event, phase = self._monitor.events.see(
            journey, finding.radio, finding.channel, kind, stretch, confirmed=finding.confirmed
        )
        view = judgement.views[(finding.quantity, finding.radio, finding.channel)]
        rows = view.over(*stretch)
        value, lower, upper = band(view, rows, self._monitor.settings.k)
        seen = self.circumstances(journey, judgement, kind, finding.radio, finding.channel, stretch, weather)
        cause, why = cause_of(seen)
        passes = int(view.residuals.passes[rows].mean().round())
        words = self._step_words(finding, (value, lower, upper), passes)
        return self._event(
            journey,
            event,
            phase,
            stretch=stretch,
            cause=cause,
            value_dbm=value if finding.quantity in POWERS else None,
            lower_dbm=lower if finding.quantity in POWERS else None,
            upper_dbm=upper if finding.quantity in POWERS else None,
            score=finding.score,
            confirmed=finding.confirmed or event.confirmed,
            learned_passes=passes,
            reason=f"{words}; {why}",
        )

    def _step_words(self, finding: Finding, shown: tuple[float, float, float], passes: int) -> str:
        value, lower, upper = (plain(finding.quantity, one) for one in shown)
        metres = finding.length * self._monitor.settings.section_m
        unit = " dBm" if finding.quantity in POWERS else ""
        level = f"{value:.2f}" if not unit else f"{value:.1f}"
        usual = f"{lower:.2f} to {upper:.2f}" if not unit else f"{lower:.1f} to {upper:.1f}"
        seen = "this pass alone" if finding.passes == 1 else f"{finding.passes} passes together"
        sure = "" if finding.confirmed else ", not yet confirmed by a second pass"
        return (
            f"{NAMES[finding.quantity]} {level}{unit} over {metres:.0f} m where a section has {usual}{unit}: "
            f"{finding.change:+.1f} {UNITS[finding.quantity]}, {abs(finding.score):.1f} standard deviations from "
            f"{seen}, learned from {passes} passes{sure}"
        )

    def _missing(self, journey: Journey, judgement: Judgement, silence: Silence, weather: Weather | None) -> RadioEvent:
        stretch = (silence.start, silence.length)
        event, phase = self._monitor.events.see(
            journey, silence.radio, silence.channel, "missing", stretch, confirmed=silence.confirmed
        )
        seen = self.circumstances(journey, judgement, "missing", silence.radio, silence.channel, stretch, weather)
        cause, why = cause_of(seen)
        metres = silence.length * self._monitor.settings.section_m
        # As if each section were silent by chance, at most as often as it was before; one in n+2 where it never was.
        chance = 1.0 - min(silence.expected, (silence.passes + 1.0) / (silence.passes + 2.0))
        score = math.sqrt(-2.0 * math.log(max(chance, 1e-6)) * silence.length)
        return self._event(
            journey,
            event,
            phase,
            stretch=stretch,
            cause=cause,
            score=-score,
            confirmed=silence.confirmed or event.confirmed,
            learned_passes=silence.passes,
            reason=(
                f"no sample over {metres:.0f} m where {silence.expected:.0%} of {silence.passes} passes had some; {why}"
            ),
        )

    def _trend(self, journey: Journey, judgement: Judgement, trend: Trend, weather: Weather | None) -> RadioEvent:
        stretch = (trend.start, trend.length)
        event, phase = self._monitor.events.see(journey, trend.radio, trend.channel, "trend", stretch, confirmed=True)
        stream = (trend.quantity, trend.radio, trend.channel)
        view = judgement.views[stream]
        rows = view.over(*stretch) if trend.length else slice(0, len(view.values))
        value, lower, upper = band(view, rows, self._monitor.settings.k)
        kind: Kind = "below" if trend.level < 0.0 else "above"
        seen = self.circumstances(journey, judgement, kind, trend.radio, trend.channel, stretch, weather)
        cause, why = cause_of(msgspec.structs.replace(seen, whole_line=trend.length == 0))
        loss, forecast = self.forecast(journey, view, rows, trend)
        unit = UNITS[trend.quantity]
        where = "the whole line" if not trend.length else f"{trend.length * self._monitor.settings.section_m:.0f} m"
        power = trend.quantity in POWERS
        return self._event(
            journey,
            event,
            phase,
            stretch=self._stretch_of(view, stretch),
            cause=cause,
            value_dbm=value if power else None,
            lower_dbm=lower if power else None,
            upper_dbm=upper if power else None,
            score=trend.score,
            confirmed=True,
            learned_passes=int(view.residuals.passes[rows].mean().round()),
            expected_loss_ns=loss and loss.expected_ns,
            expected_loss_early_ns=loss and loss.early_ns,
            expected_loss_late_ns=loss and loss.late_ns,
            reason=(
                f"{NAMES[trend.quantity]} of {where} is {trend.level:+.1f} {unit} off its mean over the last passes "
                f"and goes on by {trend.slope_per_day:+.2f} ± {trend.slope_deviation:.2f} {unit} a day{forecast}; {why}"
            ),
        )

    def _stretch_of(self, view: View, stretch: tuple[int, int]) -> tuple[int, int]:
        if stretch[1]:
            return stretch
        sections = view.residuals.sections
        return int(sections[0]), int(sections[-1] - sections[0]) + 1

    def forecast(self, journey: Journey, view: View, rows: slice, trend: Trend) -> tuple[Loss | None, str]:
        """When the weakest section of a falling stretch will be too weak, and in words."""
        if trend.quantity not in POWERS:
            return None, ""
        settings = self._monitor.settings
        learned = self._monitor.curve.loss_power_dbm()
        known = (settings.loss_power_dbm, True) if settings.loss_power_dbm is not None else learned
        if known is None:
            return None, ""
        expected = view.values[rows] - view.residuals.residual[rows]
        loss = expected_loss(trend, float(expected.min()) + trend.level - known[0], journey.last_ns)
        if loss is None:
            return None, ""
        days, early = ((one - journey.last_ns) / 86_400e9 for one in (loss.expected_ns, loss.early_ns))
        late = "" if loss.late_ns is None else f" to {(loss.late_ns - journey.last_ns) / 86_400e9:.0f}"
        seen = "" if known[1] else ", or later: it was never heard to fail"
        ratio = settings.least_received_ratio
        return loss, (
            f", so that reception is expected below {ratio:.0%} (at {known[0]:.0f} dBm) in {days:.0f} days "
            f"({early:.0f}{late}){seen}"
        )

    def circumstances(
        self,
        journey: Journey,
        judgement: Judgement,
        kind: Kind,
        radio: str,
        channel: str,
        stretch: tuple[int, int],
        weather: Weather | None,
    ) -> Circumstances:
        """What goes with a stretch on this pass."""
        monitor = self._monitor
        sign = 1.0 if kind == "above" else -1.0
        changes = {q: _change(judgement.views.get((q, radio, channel)), stretch) for q in (*POWERS, "reception")}
        reception = judgement.views.get(("reception", radio, channel))
        ratio = normal = None
        if reception is not None and changes["reception"] is not None:
            rows = reception.over(*stretch) if stretch[1] else slice(0, len(reception.values))
            now = float(reception.values[rows].mean())
            ratio = plain("reception", now)
            normal = plain("reception", now - float(reception.residuals.residual[rows].mean()))
        share, sections = _share_off(judgement, {(radio, channel)}, sign)
        missing = {(s.radio, s.channel) for s in judgement.silences}
        others = {s[1:] for s in judgement.views} | missing
        others.discard((radio, channel))
        transmit = transmit_change(
            monitor.streams[(radio, channel)],
            by_stream(journey).get((radio, channel), []),
            monitor.settings,
            monitor.mask((radio, channel)),
        )
        return Circumstances(
            kind=kind,
            length_m=stretch[1] * monitor.settings.section_m,
            at_site=not journey.direction,
            power_db=changes["power"],
            decoded_db=changes["decoded"],
            received_ratio=0.0 if kind == "missing" else ratio,
            normal_ratio=normal,
            strength_db=self._strength(judgement.views.get(("decoded", radio, channel)), stretch),
            transmit_db=transmit,
            radio_share=share,
            radio_sections=sections,
            other_share=_others_off(judgement, others, missing, sign) if others else None,
            other_radios=len(others),
            weather=weather,
        )

    def _strength(self, view: View | None, stretch: tuple[int, int]) -> float | None:
        known = self._monitor.settings.loss_power_dbm
        if known is None:
            learned = self._monitor.curve.loss_power_dbm()
            known = learned[0] if learned is not None and learned[1] else None
        if view is None or known is None:
            return None
        rows = view.over(*stretch) if stretch[1] else slice(0, len(view.values))
        return float(view.values[rows].mean()) - known if rows.stop > rows.start else None

    def _ended(self, journey: Journey, one: OpenEvent) -> RadioEvent:
        return self._event(
            journey,
            one,
            "ended",
            stretch=(one.start, one.length) if one.length else (min(journey.passed), len(journey.passed)),
            cause="unknown",
            score=0.0,
            confirmed=one.confirmed,
            reason="the last two passes were normal here",
        )

    def _event(
        self,
        journey: Journey,
        event: OpenEvent,
        phase: Literal["began", "goes_on", "ended"],
        *,
        stretch: tuple[int, int],
        **fields: object,
    ) -> RadioEvent:
        section_m = self._monitor.settings.section_m
        return RadioEvent(
            t_ns=journey.last_ns,
            event_id=event.event_id,
            phase=phase,
            radio=event.radio,
            channel=event.channel,
            direction=journey.direction or None,  # type: ignore[arg-type]  # up, down or empty
            section_start_m=stretch[0] * section_m,
            section_end_m=(stretch[0] + stretch[1]) * section_m,
            kind=event.kind,
            pass_id=journey.pass_id,
            first_seen_ns=event.first_seen_ns,
            false_alarm_rate=self._evidence.false_alarm_rate,
            **fields,  # type: ignore[arg-type]  # named after the event's fields by the callers above
        )


def band(view: View, rows: slice, k: float) -> tuple[float, float, float]:
    """Mean measured over a window, and the mean of its sections' A - kσ and A + kσ."""
    residuals = view.residuals
    expected = view.values[rows] - residuals.residual[rows]
    deviation = np.sqrt(residuals.mean_variance[rows] + residuals.variance[rows])
    return (
        float(view.values[rows].mean()),
        float((expected - k * deviation).mean()),
        float((expected + k * deviation).mean()),
    )


def clearest(trends: Sequence[Trend]) -> list[Trend]:
    """One trend a stretch: the whole line rather than its parts, else the clearer of two that overlap."""
    ordered = sorted(trends, key=lambda one: (one.length != 0, -abs(one.score), one.quantity, one.start))
    kept: list[Trend] = []
    for one in ordered:
        if not any(
            (other.radio, other.channel) == (one.radio, one.channel)
            and (other.length == 0 or (one.start < other.start + other.length and other.start < one.start + one.length))
            for other in kept
        ):
            kept.append(one)
    return kept


def _kind(finding: Finding) -> Kind:
    if finding.quantity == "reception" and finding.score < 0.0:
        return "missing"
    return "above" if finding.score > 0.0 else "below"


def _change(view: View | None, stretch: tuple[int, int]) -> float | None:
    if view is None:
        return None
    rows = view.over(*stretch) if stretch[1] else slice(0, len(view.values))
    return float(view.residuals.residual[rows].mean()) if rows.stop > rows.start else None


def _off(view: View, sign: float) -> tuple[int, int]:
    scores = sign * np.concatenate([test.z for test in view.tests])
    return int((scores >= OFF_SCORE).sum()), len(scores)


def _share_off(judgement: Judgement, keys: set[tuple[str, str]], sign: float) -> tuple[float, int]:
    """Share of sections of some radios that are off the same way, and how many there are."""
    off = count = 0
    for stream, view in judgement.views.items():
        if stream[1:] in keys and stream[0] == _leading(judgement, stream):
            more, sections = _off(view, sign)
            off, count = off + more, count + sections
    return (off / count if count else 0.0), count


def _leading(judgement: Judgement, stream: Stream) -> str:
    return "power" if ("power", *stream[1:]) in judgement.views else "decoded"


def _others_off(
    judgement: Judgement, others: set[tuple[str, str]], missing: set[tuple[str, str]], sign: float
) -> float:
    """Share of other radios most of whose sections are off the same way, or silent."""
    off = sum(key in missing or _share_off(judgement, {key}, sign)[0] >= OTHERS_OFF_SHARE for key in others)
    return off / len(others)


OTHERS_OFF_SHARE: Final = 0.5
