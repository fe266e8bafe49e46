"""Learning and analysing in the store: what the same history in a file gives, once for every pass, and kept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import msgspec
import pytest

from schemas.bridge import HistoryTask, HistoryTaskDone
from services.cloud_analyzer.duckdb_store import DuckDbStore
from services.cloud_analyzer.history import StoreError
from services.cloud_analyzer.history_passes import passes_between
from services.cloud_analyzer.history_work import HistoryWork
from services.cloud_analyzer.ingest import Ingest
from services.cloud_analyzer.model_rows import IncompleteModelError, content_of
from services.cloud_analyzer.result_tables import MODELS, REANALYSED
from services.radio_anomaly.file_analysis import analyse, learn
from services.radio_anomaly.radio_model import Origin, RadioModel
from services.radio_anomaly.settings import Settings
from tests.unit.cloud_analyzer.batches import batch, measurement
from tests.unit.cloud_analyzer.radio_days import (
    END_NS,
    FAULT_NS,
    FIRST_DAY_NS,
    READINGS,
    bring,
    kept_events,
    kept_model,
    rows,
)
from tests.unit.radio_anomaly.made_up import DAY_NS

NOW_NS = END_NS + DAY_NS


@contextmanager
def history(folder: Path) -> Iterator[DuckDbStore]:
    with closing(DuckDbStore(folder)) as store:
        bring(store)
        yield store


def done(store: DuckDbStore, task: str, until_ns: int = END_NS, from_ns: int = 0, model: str = "") -> HistoryTaskDone:
    asked = HistoryTask(t_ns=0, task=task, from_ns=from_ns, until_ns=until_ns, model=model)  # type: ignore[arg-type]  # one of them
    found, findings = HistoryWork(store, "demo").do(asked, NOW_NS)
    store.keep(findings)
    return found


def without_origin(model: RadioModel) -> RadioModel:
    return msgspec.structs.replace(model, origin=Origin())


def test_a_model_of_the_history_is_that_of_the_same_passes_in_a_file(tmp_path: Path) -> None:
    before = [one for one in READINGS if one.t_ns < FAULT_NS]
    expected = learn(before, Settings(), "line", "", Counter())
    with history(tmp_path) as store:
        first = done(store, "learn", FAULT_NS)
        assert without_origin(kept_model(store, first.model)) == without_origin(expected)
        (about,) = rows(store, "models")
        assert tuple(about) == MODELS.names
        assert (about["passes"], about["readings"]) == (12, len(before))
        assert (about["first_utc"], about["last_utc"]) == ("2026-01-05", "2026-01-10")
        assert about["false_alarm_rate"] == first.false_alarm_rate
        assert first.false_alarm_rate is not None
        # Days that have moved into files say the same.
        assert "rows of radio" in store.tend(END_NS + 9 * DAY_NS)
        assert done(store, "learn", FAULT_NS).model == first.model


def test_an_analysis_finds_what_the_file_shows_marks_it_and_repeats_itself(tmp_path: Path) -> None:
    learned = learn([one for one in READINGS if one.t_ns < FAULT_NS], Settings(), "line", "", Counter())
    expected = analyse([one for one in READINGS if one.t_ns >= FAULT_NS], learned).events
    with history(tmp_path) as store:
        model = done(store, "learn", FAULT_NS).model
        first = done(store, "analyse", from_ns=FAULT_NS)
        assert first.model == model
        assert kept_events(store) == expected
        assert {event.kind for event in expected if event.confirmed} == {"below"}
        marked = rows(store, "reanalysed", model)
        assert tuple(marked[0]) == REANALYSED.names
        assert {(row["model"], row["analysis"]) for row in marked} == {(model, first.analysis)}
        assert done(store, "analyse", from_ns=FAULT_NS, model=model).analysis == first.analysis
        assert kept_events(store) == expected
        assert rows(store, "reanalysed", "another") == []


def test_passes_that_were_learned_are_judged_and_not_learned_again(tmp_path: Path) -> None:
    with history(tmp_path) as store:
        whole = done(store, "learn", FAULT_NS)
        again = done(store, "analyse", FAULT_NS)
        assert (again.passes, again.events) == (12, 0)
        sums = kept_model(store, whole.model).sums
        assert sum(one.n for one in sums if one.quantity == "power") == 12 * 40


def test_daily_updates_see_every_pass_once_and_find_what_one_analysis_finds(tmp_path: Path) -> None:
    with history(tmp_path / "daily") as store:
        learned = done(store, "update", FIRST_DAY_NS + 5 * DAY_NS + 12345, from_ns=FIRST_DAY_NS)
        assert learned.passes == 10
        versions = [learned.model]
        for day in range(6, 9):
            one = done(store, "update", FIRST_DAY_NS + day * DAY_NS)
            assert one.passes == 2
            versions.append(one.model)
        assert done(store, "update").passes == 0
        # Days on which nobody drove make no model.
        assert done(store, "update", END_NS + 3 * DAY_NS).passes == 0
        assert [(row["version"], row["based_on"]) for row in rows(store, "models")] == sorted(
            zip(versions, ["", *versions], strict=False)
        )
        daily, model = kept_events(store), kept_model(store, versions[-1])
    assert model.origin.passes == 16
    with history(tmp_path / "once") as store:
        done(store, "update", FIRST_DAY_NS + 5 * DAY_NS, from_ns=FIRST_DAY_NS)
        at_once = done(store, "update")
        assert at_once.passes == 6
        assert kept_events(store) == daily
        assert kept_model(store, at_once.model) == model
    assert {event.kind for event in daily if event.confirmed} == {"below"}
    # What the fault shows is not learned.
    assert model.withheld


@pytest.mark.parametrize("number", [0, 1, 57, 500, len(READINGS) - 1])
def test_times_that_meet_within_a_pass_give_every_pass_once(tmp_path: Path, number: int) -> None:
    cut_ns = READINGS[number].t_ns
    with history(tmp_path) as store:
        whole = passes_between(store, 0, END_NS, Settings())
        parts = [passes_between(store, *times, Settings()) for times in ((0, cut_ns), (cut_ns, END_NS))]
    assert [one for part in parts for one in part.journeys] == whole.journeys
    assert sum(part.readings for part in parts) == whole.readings == len(READINGS)


def test_what_cannot_be_used_is_counted_and_work_ends_when_the_service_does(tmp_path: Path) -> None:
    with history(tmp_path) as store:
        odd = [
            measurement(10_000, t_ns=0),
            measurement(10_001, t_ns=FAULT_NS, chainage_m=1e9),
            measurement(10_002, t_ns=FAULT_NS, channel_power_dbm=None, decoded_power_dbm=None),
            measurement(10_003, t_ns=FAULT_NS, side="onboard", chainage_m=None),
        ]
        odd = [msgspec.structs.replace(one, heard_ns=FAULT_NS) for one in odd]
        ingest = Ingest("demo", store.had())
        store.commit(ingest.take(batch(odd, len(READINGS), sent_ns=END_NS), END_NS).commit)
        assert done(store, "learn").left_out == {
            "a clock that was not believed": 1,
            "chainage_m out of its range": 1,
            "measured on board, and no place is known": 1,
            "neither a power nor a reception ratio": 1,
        }
        with pytest.raises(StoreError, match="stopping"):
            HistoryWork(store, "demo", stopped=lambda: True).learn(0, END_NS, NOW_NS)


def test_models_and_findings_go_when_their_days_do(tmp_path: Path) -> None:
    with closing(DuckDbStore(tmp_path, keep_days=10.0)) as store:
        bring(store)
        done(store, "learn", FAULT_NS)
        done(store, "analyse")
        store.tend(END_NS + 5 * DAY_NS)
        assert [len(rows(store, about)) > 0 for about in ("models", "model_parts", "reanalysed")] == [True] * 3
        store.tend(NOW_NS + 11 * DAY_NS)
        assert [rows(store, about) for about in ("models", "model_parts", "reanalysed")] == [[]] * 3


def test_an_empty_history_teaches_nothing_and_a_model_that_is_none_is_refused(tmp_path: Path) -> None:
    with closing(DuckDbStore(tmp_path)) as store:
        assert done(store, "learn").model == ""
        assert rows(store, "models") == []
        with pytest.raises(ValueError, match="learn one first"):
            done(store, "analyse")
        with pytest.raises(ValueError, match="no model v1"):
            done(store, "analyse", model="v1")
        with pytest.raises(ValueError, match="ends before it begins"):
            done(store, "learn", until_ns=5, from_ns=6)


@pytest.mark.parametrize("parts", [["////"], ["AA"], ["!"], []])
def test_parts_that_are_not_the_model_are_told(parts: list[str]) -> None:
    with pytest.raises(IncompleteModelError):
        content_of(parts, "0" * 64)
