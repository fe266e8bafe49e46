"""A road driven for twelve days, over a bridge's batches into the store: the model and the events of the same file."""

from __future__ import annotations

import os
from collections import Counter
from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from benchmarks.radio_recordings import road_passes
from schemas.bridge import BridgedRecord
from schemas.codec import encode
from schemas.radio import RadioMeasurement
from schemas.topics import RADIO_MEASUREMENT
from services.cloud_analyzer.duckdb_store import DuckDbStore
from services.cloud_analyzer.history_work import HistoryWork
from services.cloud_analyzer.ingest import Ingest
from services.radio_anomaly.file_analysis import analyse, learn
from services.radio_anomaly.radio_model import Origin
from services.radio_anomaly.reading import Reading
from services.radio_anomaly.settings import Settings
from tests.unit.cloud_analyzer.batches import DAY_NS, TRAIN, batch, record
from tests.unit.cloud_analyzer.radio_days import kept_events, kept_model

FIELD = os.environ.get("KIROTEI_FIELD_DATA")
pytestmark = pytest.mark.skipif(not FIELD, reason="KIROTEI_FIELD_DATA names no folder with recordings")


def _record(number: int, reading: Reading) -> BridgedRecord:
    message = RadioMeasurement(
        t_ns=reading.t_ns,
        radio=reading.radio,
        channel=reading.channel,
        direction=reading.direction,
        chainage_m=reading.chainage_m,
        pass_id=reading.pass_id,
        cell=reading.cell,
        channel_power_dbm=reading.power_dbm,
    )
    return record(RADIO_MEASUREMENT.at(TRAIN, device="ue1"), encode(message), number, reading.t_ns)


def test_the_store_learns_and_finds_what_the_file_shows(tmp_path: Path) -> None:
    passes = road_passes(Path(FIELD or "") / "radio" / "cork_road" / "passes.csv.gz")
    readings = sorted((one for each in passes for one in each), key=lambda one: one.t_ns)
    middle_ns, end_ns = passes[17][0].t_ns, readings[-1].t_ns + 2 * DAY_NS
    model = learn((one for each in passes[:17] for one in each), Settings(), "line", "", Counter())
    expected = analyse((one for each in passes[17:] for one in each), model).events
    with closing(DuckDbStore(tmp_path)) as store:
        ingest = Ingest("demo", store.had())
        for first in range(0, len(readings), 2000):
            records = [_record(n, one) for n, one in enumerate(readings[first : first + 2000], first)]
            taken = ingest.take(batch(records, first, sent_ns=end_ns), end_ns)
            store.published(store.commit(taken.commit))
            ingest.confirm(taken)
        assert "rows of radio" in store.tend(end_ns)
        work = HistoryWork(store, "demo")
        learned, findings = work.learn(0, middle_ns, end_ns)
        store.keep(findings)
        plain = msgspec.structs.replace(model, origin=Origin())
        assert msgspec.structs.replace(kept_model(store, learned.model), origin=Origin()) == plain
        assert learned.passes == 17
        store.keep(work.analyse("", middle_ns, end_ns, end_ns)[1])
        found = kept_events(store)
    assert found == sorted(expected, key=lambda one: one.t_ns)
    assert len(found) > 10
