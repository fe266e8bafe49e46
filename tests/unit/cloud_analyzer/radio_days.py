"""Days of made-up passes in a store, as a bridge brings them."""

from __future__ import annotations

from collections.abc import Sequence

from schemas.bridge import BridgedRecord, StoreQuestion
from schemas.codec import decode_json, encode
from schemas.radio import RadioEvent, RadioMeasurement
from schemas.topics import RADIO_MEASUREMENT
from services.cloud_analyzer.history import Store
from services.cloud_analyzer.ingest import Ingest
from services.cloud_analyzer.model_rows import content_of
from services.radio_anomaly.radio_model import RadioModel
from services.radio_anomaly.radio_model_file import decoded_model
from services.radio_anomaly.reading import Reading
from tests.unit.cloud_analyzer.batches import TRAIN, batch, record
from tests.unit.radio_anomaly.made_up import BEGIN_NS, DAY_NS, one_pass

FAULTY = range(12, 16)
"""Two passes a day: from the seventh day on ten sections are 12 dB weaker."""
READINGS = [
    reading
    for number in range(16)
    for reading in one_pass(number, change_db=-12.0 if number in FAULTY else 0.0, stretch=(10, 20))
]
FIRST_DAY_NS = BEGIN_NS // DAY_NS * DAY_NS
FAULT_NS = FIRST_DAY_NS + 6 * DAY_NS
END_NS = FIRST_DAY_NS + 8 * DAY_NS


def bring(store: Store, readings: Sequence[Reading] = READINGS, line: str = "demo") -> None:
    """Readings as the train's measurements, committed."""
    ingest = Ingest(line, store.had())
    records = [_record(number, one, line) for number, one in enumerate(readings)]
    brought = batch(records, bridge=f"{line}/train/T1/lte_bridge", sent_ns=END_NS + DAY_NS)
    taken = ingest.take(brought, END_NS + DAY_NS)
    store.published(store.commit(taken.commit))


def rows(store: Store, about: str, model: str = "") -> list[dict[str, object]]:
    """What a store tells."""
    answer = store.ask(StoreQuestion(t_ns=0, about=about, model=model, limit=50_000), 10.0)  # type: ignore[arg-type]  # one of them
    return [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]


def kept_model(store: Store, version: str) -> RadioModel:
    """A model out of its parts."""
    (about,) = rows(store, "models", version)
    parts = [str(row["content"]) for row in rows(store, "model_parts", version)]
    assert len(parts) == about["parts"]
    return decoded_model(content_of(parts, str(about["sha256"])), version)


def kept_events(store: Store, model: str = "") -> list[RadioEvent]:
    """What models found."""
    return [decode_json(RadioEvent, str(row["message"])) for row in rows(store, "reanalysed", model)]


def _record(number: int, reading: Reading, line: str) -> BridgedRecord:
    message = RadioMeasurement(
        t_ns=reading.t_ns,
        radio=reading.radio,
        channel=reading.channel,
        direction=reading.direction,
        chainage_m=reading.chainage_m,
        pass_id=reading.pass_id,
        channel_power_dbm=reading.power_dbm,
        received_ratio=reading.received_ratio,
    )
    key = RADIO_MEASUREMENT.at(TRAIN, device="r1").replace("/demo/", f"/{line}/")
    return record(key, encode(message), number, reading.t_ns)
