"""The line method: passes in, judgements out; what was judged normal is learned at the end of its day."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Final

import msgspec

from schemas.radio import RadioAcceptance
from services.radio_anomaly.acceptance import Acceptances
from services.radio_anomaly.alarm_count import CHANCE_PASSES, AlarmCount, Cell
from services.radio_anomaly.baseline import Mask
from services.radio_anomaly.cause import snowing
from services.radio_anomaly.event_book import EventBook
from services.radio_anomaly.heard_before import HeardBefore
from services.radio_anomaly.passes import Bin, Journey, plain
from services.radio_anomaly.peeling import peel
from services.radio_anomaly.precursor import Point, Trend, TrendMemory, drifts, held_back, trend_of, trend_points
from services.radio_anomaly.presence import Presence, Silence
from services.radio_anomaly.reception_curve import ReceptionCurve
from services.radio_anomaly.settings import Settings
from services.radio_anomaly.steps import Finding, Stream, WindowMemory, agrees
from services.radio_anomaly.stream_state import FOLLOWED, TESTED, StreamState, View, mean_temperature, view_of
from services.radio_anomaly.weather_map import Sky, no_weather
from services.radio_anomaly.window_test import Correlation, WindowSum

RadioChannel = tuple[str, str]
ACCEPTED_PASSES: Final = 2.0
"""After a new normal was accepted, before a section is judged again."""


class Judgement(msgspec.Struct, frozen=True, kw_only=True):
    """All that a pass says. Nothing is changed by making one."""

    views: dict[Stream, View]
    findings: tuple[Finding, ...]
    silences: tuple[Silence, ...]
    trends: tuple[Trend, ...]
    """Worth an event,"""
    held: tuple[Trend, ...]
    """and those that may become so."""
    sums: dict[Stream, list[WindowSum]]
    points: dict[Stream, dict[tuple[int, int], Point]]
    learning: tuple[RadioChannel, ...]
    """Radios and channels about which too little is known."""

    @property
    def cells(self) -> set[Cell]:
        """Sections of radios and channels that were judged."""
        return {(stream[1:], int(s)) for stream, view in self.views.items() for s in view.residuals.sections}

    @property
    def reported(self) -> set[Cell]:
        """Sections in confirmed findings."""
        return {
            ((one.radio, one.channel), one.start + k)
            for one in self.findings
            if one.confirmed
            for k in range(one.length)
        }


class _Found:
    """What has been found on a pass so far."""

    def __init__(self) -> None:
        self.views: dict[Stream, View] = {}
        self.sums: dict[Stream, list[WindowSum]] = {}
        self.points: dict[Stream, dict[tuple[int, int], Point]] = {}
        self.findings: list[Finding] = []
        self.trends: list[Trend] = []


class Monitor:
    """What was learned, what is remembered of the last passes, and the events that are open."""

    def __init__(self, settings: Settings, correlation: Correlation | None = None) -> None:
        """Nothing learned."""
        self.settings = settings
        self.correlation = correlation or Correlation()
        self.streams: defaultdict[RadioChannel, StreamState] = defaultdict(StreamState)
        self.presence = Presence()
        self.windows = WindowMemory()
        self.trend_memory = TrendMemory()
        self.events = EventBook()
        self.acceptances = Acceptances()
        self.curve = ReceptionCurve()
        self.alarms = AlarmCount()
        self.heard = HeardBefore()
        self.pending: list[tuple[Journey, dict[RadioChannel, frozenset[int]]]] = []

    def mask(self, key: RadioChannel) -> Mask | None:
        """What counts of its sums."""
        return self.acceptances.mask(*key, self.settings.section_m)

    def accept(self, word: RadioAcceptance) -> bool:
        """Take a person's word; False for one heard before. What was found there before it is forgotten."""
        if not self.acceptances.take(word):
            return False
        first = int(word.section_start_m // self.settings.section_m)
        past = int(-(-word.section_end_m // self.settings.section_m))
        for key, state in self.streams.items():
            if key[0] != word.radio or word.channel not in ("", key[1]):
                continue
            state.forget_fit()
            for kept in (self.windows.kept, self.trend_memory.kept):
                for window in [w for w in kept if w[1:3] == key and _touches(w[3], w[4], first, past)]:
                    del kept[window]
            self.events.open = [
                event
                for event in self.events.open
                if (event.radio, event.channel) != key or not _touches(event.start, event.length, first, past)
            ]
        return True

    def learn(self, journey: Journey, withheld: dict[RadioChannel, frozenset[int]] | None = None) -> None:
        """Add a pass to what is normal, but for sections to be kept apart."""
        for key, bins in by_stream(journey).items():
            state = self.streams[key]
            apart = (withheld or {}).get(key, frozenset())
            state.learn(journey, bins, apart)
            state.forget_fit()
            self._learn_curve(bins, apart)
        if not withheld:
            self.presence.learn(journey)

    def _learn_curve(self, bins: Sequence[Bin], apart: frozenset[int]) -> None:
        powers = {(b.section, b.cell): b.value for q in ("power", "decoded") for b in bins if b.quantity == q}
        for bin_ in bins:
            power = powers.get((bin_.section, bin_.cell))
            if bin_.quantity == "reception" and power is not None and bin_.section not in apart:
                ratio = plain("reception", bin_.value)
                self.curve.add(power, ratio, self.settings.least_received_ratio)

    def learn_temperature(self, journey: Journey) -> None:
        """How the level of whole passes hangs on the device's temperature; the pass itself was learned before."""
        for key, bins in by_stream(journey).items():
            warm_c = mean_temperature(bins)
            for quantity in ("power", "decoded"):
                if warm_c is None:
                    continue
                view = self.view(key, quantity, bins, journey)
                if view is not None:
                    state = self.streams[key]
                    level = float(view.residuals.residual.mean()) + state.temperature.at(warm_c)
                    state.temperature.add(warm_c, level)
                    break

    def view(self, key: RadioChannel, quantity: str, bins: Sequence[Bin], journey: Journey) -> View | None:
        """A pass's residuals and tests of one quantity."""
        mask = self.mask(key)
        state = self.streams[key]
        if mask is not None:
            baseline = state.baseline(quantity, self.settings.half_life_days, mask, site=not journey.direction)
            bins = [
                b
                for b in bins
                if mask(journey.direction, b.section, journey.day) != "accepted"
                or baseline.predict(journey.direction, b.section, b.cell).passes >= ACCEPTED_PASSES
            ]
        return view_of(state, quantity, bins, journey.direction, self.settings, self.correlation, mask)

    def judge(self, journey: Journey) -> Judgement:
        """What is off its mean, missing or drifting on this pass."""
        found = _Found()
        learning: list[RadioChannel] = []
        for key, bins in by_stream(journey).items():
            if key not in self.streams or self.streams[key].passes < self.settings.least_passes:
                learning.append(key)
                continue
            for quantity in FOLLOWED:
                view = self.view(key, quantity, bins, journey)
                if view is not None:
                    self._look_at((quantity, *key), view, journey, found)
        return Judgement(
            views=found.views,
            findings=tuple(found.findings),
            silences=tuple(
                one for one in self.presence.missing(journey, self.settings) if not self._silence_accepted(journey, one)
            ),
            trends=tuple(trend for trend in found.trends if drifts(trend, self.settings)),
            held=tuple(trend for trend in found.trends if held_back(trend, self.settings)),
            sums=found.sums,
            points=found.points,
            learning=tuple(learning),
        )

    def _look_at(self, stream: Stream, view: View, journey: Journey, found: _Found) -> None:
        """Windows that are off their mean, and those that drift, of one quantity."""
        found.views[stream] = view
        followed = view.tests
        if self._tested(stream, found.views):
            site = not journey.direction
            peeled = peel(stream, view.residuals, view.tests, self.windows, self.settings, self.correlation, site=site)
            found.sums[stream] = peeled.sums
            found.findings += peeled.findings
            followed = peeled.rest
        elif stream[0] == "decoded":
            return
        points = trend_points(view.tests, followed, journey.first_ns, self.settings)
        found.points[stream] = points
        found.trends += [
            trend
            for window, point in points.items()
            if (trend := self._trend(stream, window, point)) is not None
            and (not window[1] or agrees(view.residuals, window, trend.level))
        ]

    def _silence_accepted(self, journey: Journey, silence: Silence) -> bool:
        """Whether a new normal was accepted there and nothing has been heard since."""
        key = (silence.radio, silence.channel)
        mask = self.mask(key)
        if mask is None or mask(journey.direction, silence.start, journey.day) != "accepted":
            return False
        days, site = self.settings.half_life_days, not journey.direction
        baselines = [self.streams[key].baseline(q, days, mask, site=site) for q in ("power", "decoded")]
        heard = max(one.predict(journey.direction, silence.start, "").passes for one in baselines)
        return heard < ACCEPTED_PASSES

    def _tested(self, stream: Stream, views: dict[Stream, View]) -> bool:
        """Whether its windows are: one power a radio, channel power before decoded power, and reception."""
        if stream[0] == "decoded":
            return ("power", *stream[1:]) not in views
        return stream[0] in TESTED

    def _trend(self, stream: Stream, window: tuple[int, int], point: Point) -> Trend | None:
        series = self.trend_memory.series(stream, *window, point)
        return trend_of(stream, window, series, self.settings)

    def commit(self, journey: Journey, judgement: Judgement, sky: Sky = no_weather) -> None:
        """Remember the pass for the ones to come, and lay it aside for learning at the end of the day.

        To be called once the events of the pass are in the book. What weather explains is not learned.
        """
        for stream, sums in judgement.sums.items():
            self.windows.put(stream, sums)
        for stream, points in judgement.points.items():
            self.trend_memory.put(stream, points)
        self.presence.remember(journey, judgement.silences)
        cells = judgement.cells
        lasting = [one for one in self.events.open if one.confirmed and one.passes > CHANCE_PASSES]
        held = {
            cell for cell in cells for one in lasting if (one.radio, one.channel) == cell[0] and one.covers(cell[1])
        }
        self.alarms.add(cells, judgement.reported, held)
        if self.pending and self.pending[-1][0].day != journey.day:
            self.end_day()
        self.pending.append((journey, self._withheld(journey, judgement, sky)))

    def _withheld(self, journey: Journey, judgement: Judgement, sky: Sky) -> dict[RadioChannel, frozenset[int]]:
        """Sections that may not be normal, by radio and channel."""
        found: defaultdict[RadioChannel, set[int]] = defaultdict(set)
        snowed = [section for section in journey.passed if snowing(sky(self.middle_m(journey, section)))]
        for finding in judgement.findings:
            found[(finding.radio, finding.channel)].update(range(finding.start, finding.start + finding.length))
        for silence in judgement.silences:
            found[(silence.radio, silence.channel)].update(range(silence.start, silence.start + silence.length))
        for trend in judgement.held:
            if trend.quantity in TESTED:
                whole = range(trend.start, trend.start + trend.length) if trend.length else journey.passed
                found[(trend.radio, trend.channel)].update(whole)
        for key in by_stream(journey):
            found[key].update(section for section in journey.passed if self.events.held(*key, section))
            found[key].update(snowed)
        return {key: frozenset(sections) for key, sections in found.items() if sections}

    def middle_m(self, journey: Journey, section: int) -> float | None:
        """Kilometrage of a section's middle; None at a site."""
        return (section + 0.5) * self.settings.section_m if journey.direction else None

    def end_day(self) -> None:
        """Learn what was laid aside."""
        for journey, withheld in self.pending:
            self.learn(journey, withheld)
            if not withheld:
                self.learn_temperature(journey)
        self.pending.clear()


def by_stream(journey: Journey) -> dict[RadioChannel, list[Bin]]:
    """A pass's bins by radio and channel."""
    found: dict[RadioChannel, list[Bin]] = {}
    for bin_ in journey.bins:
        found.setdefault((bin_.radio, bin_.channel), []).append(bin_)
    return dict(sorted(found.items()))


def _touches(start: int, length: int, first: int, past: int) -> bool:
    return length == 0 or (start < past and first < start + length)
