"""Bridged records as rows: who said it, when it is taken to have been, and what cannot be taken."""

from __future__ import annotations

import msgspec
import pytest

from schemas.bridge import BridgedRecord
from schemas.codec import decode_json, encode
from schemas.health import ServiceEvent
from schemas.radio import RadioEvent
from schemas.topic import Place, mirrored_key
from schemas.topics import GNSS_FIX, RADIO_EVENT
from services.cloud_analyzer.tables import EVENTS, RADIO, Value, rows_of
from tests.unit.cloud_analyzer.batches import DAY_NS, NOW_NS, STEP_NS, TRAIN, measurement, record, service_event
from tests.unit.schemas.examples import EXAMPLES

T1 = frozenset({str(TRAIN)})
HOUR_NS = 3_600_000_000_000


def radio_row(one: BridgedRecord, now_ns: int = NOW_NS) -> dict[str, Value]:
    rows = rows_of([one], now_ns, T1)
    assert len(rows) == len(rows.radio) == 1
    return dict(zip(RADIO.names, rows.radio[0], strict=True))


def test_a_measurement_keeps_its_figures_and_its_sender() -> None:
    row = radio_row(measurement(3), NOW_NS + DAY_NS)
    t_ns = NOW_NS + 3 * STEP_NS
    assert (row["taken_ns"], row["t_ns"], row["clock"]) == (t_ns, t_ns, "")
    assert (row["line"], row["place"], row["source"], row["sequence"]) == (
        "demo",
        "train/T1",
        "demo/train/T1/radio_probe",
        3,
    )
    assert (row["radio"], row["channel_power_dbm"], row["decoded_power_dbm"], row["chainage_m"]) == (
        "R3",
        -73.0,
        None,
        18.75,
    )


@pytest.mark.parametrize("year_ns", [315_532_800_000_000_000, 2_082_758_400_000_000_000, -5, 2**62])
def test_a_device_whose_clock_was_reset_is_stored_by_the_bridge_s_clock(year_ns: int) -> None:
    row = radio_row(measurement(0, t_ns=year_ns))
    assert (row["taken_ns"], row["t_ns"], row["clock"]) == (NOW_NS, year_ns, "device")


def test_a_train_whose_clock_is_an_hour_ahead_is_stored_by_ours() -> None:
    ahead = msgspec.structs.replace(measurement(0, t_ns=NOW_NS + HOUR_NS), heard_ns=NOW_NS + HOUR_NS)
    row = radio_row(ahead)
    assert (row["taken_ns"], row["clock"]) == (NOW_NS, "device and bridge")
    only_bridge = msgspec.structs.replace(measurement(0), heard_ns=NOW_NS + HOUR_NS)
    row = radio_row(only_bridge)
    assert (row["taken_ns"], row["clock"]) == (NOW_NS, "bridge")


def test_an_event_is_kept_whole_with_what_people_ask_by() -> None:
    message = EXAMPLES[RadioEvent]
    assert isinstance(message, RadioEvent)
    key = RADIO_EVENT.at(TRAIN, device="R3")
    rows = rows_of([record(key, encode(message), 0, message.t_ns)], message.t_ns, T1)
    row = dict(zip(EVENTS.names, rows.events[0], strict=True))
    assert (row["topic"], row["kind"], row["radio"], row["chainage_m"]) == ("radio/event", "above", "R3", 4200.0)
    assert decode_json(RadioEvent, str(row["message"])) == message
    row = dict(zip(EVENTS.names, rows_of([service_event(1, "x")], NOW_NS, T1).events[0], strict=True))
    assert (row["topic"], row["kind"], row["chainage_m"]) == ("event", "level", None)


def test_what_cannot_be_taken_is_kept_aside_with_the_reason() -> None:
    good = measurement(0)
    other = Place("demo", "train", "T2")
    faults = {
        "no topic of this version": msgspec.structs.replace(good, key="kirotei/v1/demo/train/T1/news/of/tomorrow"),
        "is not bridged again": msgspec.structs.replace(good, key=mirrored_key(good.key)),
        "may not speak for demo/train/T2": measurement(0, place=other),
        "RadioMeasurement": msgspec.structs.replace(good, payload=b"\xc1"),
        "": good,
    }
    rows = rows_of(list(faults.values()), NOW_NS, T1)
    assert len(rows.radio) == 1
    for reason, (_, key, told, payload) in zip(faults, rows.refused, strict=False):
        assert reason in str(told)
        assert key == faults[reason].key
        assert bytes.fromhex(str(payload)) == faults[reason].payload
    assert len(rows_of([measurement(0, place=other)], NOW_NS, None).radio) == 1


def test_a_newer_sender_s_further_fields_are_no_fault() -> None:
    fields = msgspec.msgpack.decode(measurement(0).payload) | {"polarisation": "vertical"}
    newer = msgspec.structs.replace(measurement(0), payload=msgspec.msgpack.encode(fields))
    assert radio_row(newer)["radio"] == "R0"


def test_a_foreign_sender_without_mark_is_taken() -> None:
    row = radio_row(msgspec.structs.replace(measurement(0), attachment=b""))
    assert (row["source"], row["sequence"]) == ("", -1)


def test_other_messages_are_events_whatever_they_are() -> None:
    event = service_event(0)
    assert msgspec.msgpack.decode(event.payload, type=ServiceEvent).service == "gnss"
    fix_key = GNSS_FIX.at(TRAIN, device="front")
    rows = rows_of([record(fix_key, encode(EXAMPLES[GNSS_FIX.message]), 0, NOW_NS)], NOW_NS, T1)
    assert dict(zip(EVENTS.names, rows.events[0], strict=True))["topic"] == "gnss/fix"
