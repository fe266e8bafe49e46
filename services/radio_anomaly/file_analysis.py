"""Readings of a file learned and analysed: what the commands do, without the files."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Sequence

import msgspec

from schemas.radio import BinSums, RadioAcceptance, RadioEvent, Weather
from services.radio_anomaly import paper
from services.radio_anomaly.baseline import Sums
from services.radio_anomaly.held_out import held_out
from services.radio_anomaly.monitor import Monitor
from services.radio_anomaly.passes import Journey, binned, day_of, sorted_passes
from services.radio_anomaly.radio_model import Origin, RadioModel, evidence_of, model_of, monitor_of
from services.radio_anomaly.raising import Raiser
from services.radio_anomaly.reading import Reading
from services.radio_anomaly.settings import Method, Settings
from services.radio_anomaly.weather_map import WeatherDiary

SAMPLE = "sample"
"""Quantity under which the paper's sums are kept: of samples, not of passes."""


class Analysis(msgspec.Struct, kw_only=True):
    """What a file showed."""

    events: list[RadioEvent]
    model: RadioModel
    """With what was learned meanwhile."""
    passes: int
    left_out: Counter[str]
    learning: Counter[str]
    """Passes of radios and channels about which too little is known yet."""
    journeys: list[Journey]


def learn(
    readings: Iterable[Reading], settings: Settings, method: Method, source: str, refused: Counter[str]
) -> RadioModel:
    """A model of normal passes."""
    passes, left = sorted_passes(readings, settings)
    origin = origin_of(passes, source, refused + left)
    if method == "paper":
        return _paper_model(passes, settings, origin)
    return learn_journeys([binned(one, settings) for one in passes], settings, origin)


def learn_journeys(
    journeys: Sequence[Journey], settings: Settings, origin: Origin, acceptances: Iterable[RadioAcceptance] = ()
) -> RadioModel:
    """A model of the line method from passes in order of time, with what people accepted as new normals."""
    evidence = held_out(journeys, settings)
    monitor = Monitor(settings, evidence.correlation)
    for word in acceptances:
        monitor.accept(word)
    for journey in journeys:
        monitor.learn(journey)
    for journey in journeys:
        monitor.learn_temperature(journey)
    return model_of(monitor, origin, evidence)


def origin_of(passes: Sequence[Sequence[Reading]], source: str, refused: Counter[str]) -> Origin:
    """Where a model comes from."""
    return Origin(
        source=source,
        first_utc=day_of(passes[0][0].t_ns) if passes else "",
        last_utc=day_of(passes[-1][-1].t_ns) if passes else "",
        passes=len(passes),
        readings=sum(len(one) for one in passes),
        refused={reason: count for reason, count in sorted(refused.items()) if count},
    )


def analyse(readings: Iterable[Reading], model: RadioModel, weather: Iterable[Weather] = ()) -> Analysis:
    """Events of passes in their order of time, each learned from at the end of its day where it was normal.

    `weather` in order of time; its places are taken for kilometrage.
    """
    passes, left = sorted_passes(readings, model.settings)
    if model.method == "paper":
        return Analysis(
            events=_paper_events(passes, model),
            model=model,
            passes=len(passes),
            left_out=left,
            learning=Counter(),
            journeys=[binned(one, model.settings) for one in passes],
        )
    return analyse_journeys([binned(one, model.settings) for one in passes], model, weather, left_out=left)


def analyse_journeys(
    journeys: list[Journey],
    model: RadioModel,
    weather: Iterable[Weather] = (),
    acceptances: Iterable[RadioAcceptance] = (),
    *,
    left_out: Counter[str],
    learned_until_ns: int = 0,
) -> Analysis:
    """The same of passes that are binned already; words of acceptance, in order of time, count from when they came.

    Passes that began before `learned_until_ns` are in the model: they are judged, and not learned once more.
    """
    monitor = monitor_of(model)
    raiser = Raiser(monitor, evidence_of(model))
    events: list[RadioEvent] = []
    learning: Counter[str] = Counter()
    diary = WeatherDiary(weather)
    words = deque(acceptances)
    for journey in journeys:
        while words and words[0].t_ns <= journey.first_ns:
            monitor.accept(words.popleft())
        told, judgement = raiser.take(journey, diary.sky(journey.last_ns))
        if journey.first_ns < learned_until_ns:
            monitor.pending.clear()
        events += told
        learning.update(f"{radio} {channel}" for radio, channel in judgement.learning)
    return Analysis(
        events=events,
        model=model_of(monitor, model.origin, model.evidence),
        passes=len(journeys),
        left_out=left_out,
        learning=learning,
        journeys=journeys,
    )


def _paper_model(passes: Sequence[Sequence[Reading]], settings: Settings, origin: Origin) -> RadioModel:
    sums = paper.sums_of((one for each in passes for one in each), settings.section_m)
    rows = tuple(
        BinSums(
            quantity=SAMPLE,
            day=origin.first_utc,
            radio=radio,
            channel=channel,
            direction="",
            section=section,
            n=one.n,
            sum=one.total,
            sum_squares=one.squares,
        )
        for (radio, channel, section), one in sorted(sums.items())
    )
    return RadioModel(method="paper", settings=settings, origin=origin, sums=rows)


def paper_thresholds(model: RadioModel) -> dict[paper.Key, paper.Threshold]:
    """Of a model of the paper's method."""
    sums = {(row.radio, row.channel, row.section): Sums(row.n, row.sum, row.sum_squares) for row in model.sums}
    return paper.thresholds_of(sums, model.settings.k)


def _paper_events(passes: Sequence[Sequence[Reading]], model: RadioModel) -> list[RadioEvent]:
    """The rule knows one pass at a time: every excess is certain at once, and none goes on."""
    thresholds = paper_thresholds(model)
    section_m = model.settings.section_m
    return [
        RadioEvent(
            t_ns=readings[-1].t_ns,
            event_id=f"{one.kind}:{one.radio}:{one.channel}:{one.start}:{readings[0].t_ns // 1_000_000_000}",
            phase="began",
            radio=one.radio,
            channel=one.channel,
            direction=readings[0].direction,
            section_start_m=one.start * section_m,
            section_end_m=(one.start + one.length) * section_m,
            kind=one.kind,
            cause=one.cause,
            value_dbm=one.value_dbm,
            lower_dbm=one.lower_dbm,
            upper_dbm=one.upper_dbm,
            score=one.score,
            confirmed=True,
            pass_id=readings[0].pass_id,
            first_seen_ns=readings[0].t_ns,
            reason=one.reason,
        )
        for readings in passes
        for one in paper.analyse(readings, thresholds, section_m, model.settings.k)
    ]
