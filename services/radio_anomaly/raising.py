"""From what a pass shows to events: merged with what is open, with cause, figures and a reason in words."""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from schemas.radio import Cause, Kind, RadioEvent
from services.radio_anomaly.cause import Circumstances, cause_of
from services.radio_anomaly.circumstances import Scene
from services.radio_anomaly.event_book import OpenEvent
from services.radio_anomaly.incidents import put_together, words_of
from services.radio_anomaly.monitor import Judgement, Monitor
from services.radio_anomaly.passes import Journey, plain, transformed
from services.radio_anomaly.precursor import WORSE, Loss, Trend, expected_loss
from services.radio_anomaly.presence import Silence
from services.radio_anomaly.reasons import step_words, trend_words
from services.radio_anomaly.steps import Finding
from services.radio_anomaly.stream_state import POWERS, View
from services.radio_anomaly.stretch_figures import band, clearest
from services.radio_anomaly.weather_map import Sky, no_weather


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

    @property
    def false_alarm_rate(self) -> float | None:
        """Of the passes that were held out of the model, else of those judged before they were learned."""
        held_out = self._evidence.false_alarm_rate
        return self._monitor.alarms.rate if held_out is None else held_out

    def take(self, journey: Journey, sky: Sky = no_weather) -> tuple[list[RadioEvent], Judgement]:
        """Judge a pass, tell its events (also those that ended), and remember it."""
        judgement = self._monitor.judge(journey)
        told = self.events_of(journey, judgement, sky)
        told += [self._ended(journey, one) for one in self._monitor.events.close(journey)]
        self._monitor.commit(journey, judgement, sky)
        return told, judgement

    def events_of(self, journey: Journey, judgement: Judgement, sky: Sky = no_weather) -> list[RadioEvent]:
        """Events of a pass, or of the part of it that was driven."""
        scene = Scene(self._monitor, journey, judgement, sky)
        told = [
            self._step(journey, judgement, finding, scene)
            for finding in judgement.findings
            if not self._said_better(finding, judgement) and not self._harmless(finding, judgement)
        ]
        told += [self._missing(journey, silence, scene) for silence in judgement.silences]
        told += [
            self._trend(journey, judgement, trend, scene)
            for trend in clearest(judgement.trends)
            if not self._stepped(journey, trend)
        ]
        return self._together(told)

    def _together(self, told: list[RadioEvent]) -> list[RadioEvent]:
        """The same, each with the incident that it is a part of."""
        known, section_m = self._monitor.events.open, self._monitor.settings.section_m
        by_id = {one.event_id: one for one in known}
        put_together(list({event.event_id: by_id[event.event_id] for event in told}.values()), known, section_m)
        words = {
            name: words_of(name, known, section_m) for name in {by_id[event.event_id].incident_id for event in told}
        }
        return [
            msgspec.structs.replace(event, incident_id=name, incident=words[name])
            for event in told
            for name in (by_id[event.event_id].incident_id,)
        ]

    def _cause(self, seen: Circumstances, event: OpenEvent) -> tuple[Cause, str]:
        """Cause of an event on this pass; what was told of it before stands until something else is told."""
        cause, why = cause_of(seen)
        if cause == "unknown" and event.cause != "unknown":
            return event.cause, f"{why}; told as {event.cause} before"
        event.cause = cause
        return cause, why

    def _stepped(self, journey: Journey, trend: Trend) -> bool:
        """Whether half of its stretch is in a confirmed step that is known already, and it was no trend before."""
        mine = [one for one in self._monitor.events.open if (one.radio, one.channel) == (trend.radio, trend.channel)]
        sections = range(trend.start, trend.start + trend.length) if trend.length else journey.passed
        if any(one.kind == "trend" and (not one.length or one.covers(sections[0])) for one in mine):
            return False
        steps = [one for one in mine if one.kind in ("above", "below") and one.confirmed]
        covered = sum(any(one.covers(section) for one in steps) for section in sections)
        return 2 * covered >= len(sections)

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

    def _harmless(self, finding: Finding, judgement: Judgement) -> bool:
        """Reception that changed, but is better than before or still good enough."""
        if finding.quantity != "reception":
            return False
        view = judgement.views[(finding.quantity, finding.radio, finding.channel)]
        now = float(view.values[view.over(finding.start, finding.length)].mean())
        return finding.score > 0.0 or plain("reception", now) >= self._monitor.settings.least_received_ratio

    def _step(self, journey: Journey, judgement: Judgement, finding: Finding, scene: Scene) -> RadioEvent:
        kind = _kind(finding)
        stretch = (finding.start, finding.length)
        event, phase = self._monitor.events.see(
            journey, finding.radio, finding.channel, kind, stretch, confirmed=finding.confirmed
        )
        view = judgement.views[(finding.quantity, finding.radio, finding.channel)]
        rows = view.over(*stretch)
        value, lower, upper = band(view, rows, self._monitor.settings.k)
        cause, why = self._cause(scene.at(kind, finding.radio, finding.channel, stretch), event)
        passes = int(view.residuals.passes[rows].mean().round())
        words = step_words(finding, (value, lower, upper), passes, finding.length * self._monitor.settings.section_m)
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

    def _missing(self, journey: Journey, silence: Silence, scene: Scene) -> RadioEvent:
        stretch = (silence.start, silence.length)
        event, phase = self._monitor.events.see(
            journey, silence.radio, silence.channel, "missing", stretch, confirmed=silence.confirmed
        )
        cause, why = self._cause(scene.at("missing", silence.radio, silence.channel, stretch), event)
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

    def _trend(self, journey: Journey, judgement: Judgement, trend: Trend, scene: Scene) -> RadioEvent:
        stretch = (trend.start, trend.length)
        event, phase = self._monitor.events.see(journey, trend.radio, trend.channel, "trend", stretch, confirmed=True)
        stream = (trend.quantity, trend.radio, trend.channel)
        view = judgement.views[stream]
        rows = view.over(*stretch) if trend.length else slice(0, len(view.values))
        value, lower, upper = band(view, rows, self._monitor.settings.k)
        # More corrected bits are for the worse, as less power is.
        kind: Kind = "above" if trend.level * WORSE.get(trend.quantity, -1.0) < 0.0 else "below"
        seen = scene.at(kind, trend.radio, trend.channel, stretch)
        seen = msgspec.structs.replace(seen, whole_line=trend.length == 0, quantity=trend.quantity)
        cause, why = self._cause(seen, event)
        loss, forecast = self.forecast(journey, view, rows, trend)
        words = trend_words(trend, (lower + upper) / 2.0, trend.length * self._monitor.settings.section_m)
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
            reason=f"{words}{forecast}; {why}",
        )

    def _stretch_of(self, view: View, stretch: tuple[int, int]) -> tuple[int, int]:
        if stretch[1]:
            return stretch
        return view.extent

    def forecast(self, journey: Journey, view: View, rows: slice, trend: Trend) -> tuple[Loss | None, str]:
        """When the weakest section of a falling stretch will be too weak, or too badly received, and in words."""
        settings = self._monitor.settings
        ratio = settings.least_received_ratio
        if trend.quantity == "reception":
            limit, where, seen = transformed("reception", ratio), f"{ratio:.0%}", True
        elif trend.quantity in POWERS:
            learned = self._monitor.curve.loss_power_dbm()
            known = (settings.loss_power_dbm, True) if settings.loss_power_dbm is not None else learned
            if known is None:
                return None, ""
            limit, where, seen = known[0], f"{ratio:.0%} (at {known[0]:.0f} dBm)", known[1]
        else:
            return None, ""
        expected = view.values[rows] - view.residuals.residual[rows]
        loss = expected_loss(trend, float(expected.min()) + trend.level - limit, journey.last_ns)
        if loss is None:
            return None, ""
        days, early = ((one - journey.last_ns) / 86_400e9 for one in (loss.expected_ns, loss.early_ns))
        late = "" if loss.late_ns is None else f" to {(loss.late_ns - journey.last_ns) / 86_400e9:.0f}"
        later = "" if seen else ", or later: it was never heard to fail"
        return loss, f", so that reception is expected below {where} in {days:.0f} days ({early:.0f}{late}){later}"

    def _ended(self, journey: Journey, one: OpenEvent) -> RadioEvent:
        return self._event(
            journey,
            one,
            "ended",
            stretch=(one.start, one.length) if one.length else (min(journey.passed), len(journey.passed)),
            cause=one.cause,
            score=0.0,
            confirmed=one.confirmed,
            incident_id=one.incident_id,
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
            false_alarm_rate=self.false_alarm_rate,
            **fields,  # type: ignore[arg-type]  # named after the event's fields by the callers above
        )


def _kind(finding: Finding) -> Kind:
    if finding.quantity == "reception" and finding.score < 0.0:
        return "missing"
    return "above" if finding.score > 0.0 else "below"
