"""Days of made-up passes in a store, as a bridge brings them."""

from __future__ import annotations

from collections.abc import Sequence

from schemas.bridge import BridgedRecord
from schemas.codec import encode
from schemas.radio import RadioMeasurement
from schemas.topics import RADIO_MEASUREMENT
from services.cloud_analyzer.history import Store
from services.cloud_analyzer.ingest import Ingest
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
