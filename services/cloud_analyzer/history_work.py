"""Work over the store's history: a model of the radio learned, the history analysed by one, whole days added to it.

Nothing is written here: what came of it goes back to the store's one writer. The same history and model give the same
version, the same events and the same name of the analysis, on whichever engine the history stands.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, TypeVar

import msgspec

from schemas.bridge import HistoryTask, HistoryTaskDone, StoreQuestion
from schemas.codec import decode_json
from schemas.message import Message
from schemas.radio import RadioAcceptance, Weather
from services.cloud_analyzer.history import DAY_NS, Store, StoreError
from services.cloud_analyzer.history_passes import Passes, never, pages, passes_between
from services.cloud_analyzer.model_rows import (
    IncompleteModelError,
    Learning,
    content_of,
    event_rows,
    model_rows,
    version_of,
)
from services.cloud_analyzer.result_tables import MODELS, Findings
from services.cloud_analyzer.tables import Value
from services.radio_anomaly.file_analysis import Analysis, analyse_journeys, learn_journeys
from services.radio_anomaly.passes import day_of
from services.radio_anomaly.radio_model import Origin, RadioModel
from services.radio_anomaly.radio_model_file import decoded_model
from services.radio_anomaly.settings import Settings

M = TypeVar("M", bound=Message)
NOTHING: Final = Findings()


@dataclass(frozen=True, slots=True)
class HistoryWork:
    """A store's history, of one line, to be worked on."""

    store: Store
    line: str
    settings: Settings = field(default_factory=Settings)
    """Of models that are learned anew; a model brings its own."""
    stopped: Callable[[], bool] = never

    def do(self, task: HistoryTask, now_ns: int) -> tuple[HistoryTaskDone, Findings]:
        """What comes of a task, and what is to be kept of it. Raises StoreError; ValueError for a task that is none."""
        from_ns, until_ns = task.from_ns or 0, now_ns if task.until_ns is None else task.until_ns
        if from_ns >= until_ns:
            msg = "the time ends before it begins"
            raise ValueError(msg)
        if task.task == "learn":
            return self.learn(from_ns, until_ns, now_ns)
        if task.task == "update":
            return self.update(from_ns, until_ns // DAY_NS * DAY_NS, now_ns)
        return self.analyse(task.model, from_ns, until_ns, now_ns)

    def learn(self, from_ns: int, until_ns: int, now_ns: int) -> tuple[HistoryTaskDone, Findings]:
        """A model of the passes that began in a time, learned anew. Raises StoreError, also when a shard is away."""
        passes = self._whole(from_ns, until_ns, self.settings)
        if not passes.journeys:
            return _done("", passes), NOTHING
        words = self._said("radio_acceptance", RadioAcceptance, 0, until_ns)
        model = learn_journeys(passes.journeys, self.settings, self._origin(passes), words)
        return self._kept(Learning(model=model, from_ns=from_ns, through_ns=until_ns), passes, now_ns)

    def update(self, from_ns: int, until_ns: int, now_ns: int) -> tuple[HistoryTaskDone, Findings]:
        """The newest model with the days until `until_ns` that it has not seen: analysed, and learned where normal.

        Without a model one is learned from `from_ns` on. Raises StoreError, also when a shard is away.
        """
        newest = self._about_model("")
        if newest is None:
            return self.learn(from_ns, until_ns, now_ns)
        version, through_ns = str(newest["version"]), int(newest["through_ns"] or 0)
        if through_ns >= until_ns:
            return HistoryTaskDone(t_ns=now_ns, model=version), NOTHING
        before = self._content(newest)
        passes = self._whole(through_ns, until_ns, before.settings)
        if not passes.journeys:
            return _done(version, passes), NOTHING
        found = self._analysed(before, passes, through_ns, until_ns, learned_until_ns=through_ns)
        model = msgspec.structs.replace(found.model, origin=_grown(found.model.origin, self._origin(passes)))
        learning = Learning(model=model, from_ns=int(newest["from_ns"] or 0), through_ns=until_ns, based_on=version)
        done, findings = self._kept(learning, passes, now_ns)
        analysis = _name(version, through_ns, until_ns, found, passes)
        events = event_rows(found.events, self.line, version, analysis)
        return (
            msgspec.structs.replace(done, analysis=analysis, events=len(events)),
            Findings(findings.models, findings.model_parts, events),
        )

    def analyse(self, version: str, from_ns: int, until_ns: int, now_ns: int) -> tuple[HistoryTaskDone, Findings]:
        """What a model, or the newest one, finds in the passes that began in a time. Raises StoreError, ValueError.

        Passes that the model has learned are judged and not learned again; later ones are, day by day, in memory alone.
        """
        about = self._known(version)
        model = self._content(about)
        passes = passes_between(self.store, from_ns, until_ns, model.settings, self.stopped)
        # What it remembers of the last passes it saw is not what was before these.
        bare = msgspec.structs.replace(model, windows=(), trends=(), events=(), silent=(), pending=())
        found = self._analysed(bare, passes, from_ns, until_ns, learned_until_ns=int(about["through_ns"] or 0))
        version = str(about["version"])
        analysis = _name(version, from_ns, until_ns, found, passes)
        events = event_rows(found.events, self.line, version, analysis)
        done = _done(version, passes, found.model)
        done = msgspec.structs.replace(done, t_ns=now_ns, analysis=analysis, events=len(events))
        return done, Findings(reanalysed=events)

    def _analysed(
        self, model: RadioModel, passes: Passes, from_ns: int, until_ns: int, *, learned_until_ns: int
    ) -> Analysis:
        return analyse_journeys(
            passes.journeys,
            model,
            self._said("weather", Weather, max(from_ns - DAY_NS, 0), until_ns + DAY_NS),
            self._said("radio_acceptance", RadioAcceptance, 0, until_ns),
            left_out=passes.left_out,
            learned_until_ns=learned_until_ns,
        )

    def _whole(self, from_ns: int, until_ns: int, settings: Settings) -> Passes:
        """Passes of a time with nothing missing: what is learned from a part would be wrong for good."""
        passes = passes_between(self.store, from_ns, until_ns, settings, self.stopped)
        if passes.partial:
            msg = f"nothing is learned from a part of the history: {passes.partial}"
            raise StoreError(msg)
        return passes

    def _origin(self, passes: Passes) -> Origin:
        return Origin(
            source=f"history of {self.line}",
            first_utc=day_of(passes.journeys[0].first_ns),
            last_utc=day_of(max(one.last_ns for one in passes.journeys)),
            passes=len(passes.journeys),
            readings=passes.readings,
            refused=dict(sorted((+passes.left_out).items())),
        )

    def _kept(self, learning: Learning, passes: Passes, now_ns: int) -> tuple[HistoryTaskDone, Findings]:
        about, parts = model_rows(learning, self.line, now_ns)
        done = _done(version_of(learning.model), passes, learning.model)
        return msgspec.structs.replace(done, t_ns=now_ns), Findings((about,), parts)

    def _said(self, topic: str, message: type[M], from_ns: int, until_ns: int) -> list[M]:
        """What was said on a topic, in order of the store's time."""
        question = StoreQuestion(t_ns=0, about="events", topic=topic, from_ns=from_ns, until_ns=until_ns)
        return [
            decode_json(message, str(row[answer.columns.index("message")]))
            for answer in pages(self.store, question, self.stopped)
            for row in answer.rows
        ]

    def _about_model(self, version: str) -> dict[str, Value] | None:
        """Row of a model, of the newest for an empty version; None when there is none. Raises StoreError for a part."""
        newest: dict[str, Value] | None = None
        for answer in pages(self.store, StoreQuestion(t_ns=0, about="models", model=version), self.stopped):
            if answer.partial:
                raise StoreError(answer.partial)
            if answer.rows:
                newest = dict(zip(MODELS.names, answer.rows[-1], strict=True))
        return newest

    def _known(self, version: str) -> dict[str, Value]:
        about = self._about_model(version)
        if about is None:
            msg = f"there is no model {version}" if version else "there is no model: learn one first"
            raise ValueError(msg)
        return about

    def _content(self, about: dict[str, Value]) -> RadioModel:
        version = str(about["version"])
        question = StoreQuestion(t_ns=0, about="model_parts", model=version)
        rows = [row for answer in pages(self.store, question, self.stopped) for row in answer.rows]
        try:
            return decoded_model(content_of((str(row[-1]) for row in rows), str(about["sha256"])), f"model {version}")
        except IncompleteModelError as error:
            raise StoreError(str(error)) from error


def _done(version: str, passes: Passes, model: RadioModel | None = None) -> HistoryTaskDone:
    return HistoryTaskDone(
        t_ns=0,
        model=version,
        passes=len(passes.journeys),
        false_alarm_rate=None if model is None or model.evidence is None else model.evidence.rate,
        left_out=dict(sorted((+passes.left_out).items())),
        partial=passes.partial,
    )


def _grown(before: Origin, more: Origin) -> Origin:
    refused = {
        reason: before.refused.get(reason, 0) + more.refused.get(reason, 0) for reason in before.refused | more.refused
    }
    return Origin(
        source=before.source,
        first_utc=before.first_utc,
        last_utc=more.last_utc,
        passes=before.passes + more.passes,
        readings=before.readings + more.readings,
        refused=dict(sorted(refused.items())),
    )


def _name(version: str, from_ns: int, until_ns: int, found: Analysis, passes: Passes) -> str:
    """Of an analysis: model, time and what came of it."""
    text = msgspec.json.encode((version, from_ns, until_ns, len(passes.journeys), passes.readings, found.events))
    return hashlib.sha256(text).hexdigest()[:12]
