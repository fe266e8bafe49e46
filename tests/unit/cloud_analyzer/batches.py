"""Batches of radio measurements and events, as a bridge brings them."""

from __future__ import annotations

from collections.abc import Sequence

from schemas.bridge import BridgeBatch, BridgedRecord
from schemas.codec import encode
from schemas.health import ServiceEvent
from schemas.radio import RadioMeasurement
from schemas.topic import Place
from schemas.topics import RADIO_MEASUREMENT, SERVICE_EVENT
from services.lte_bridge.batch import packed
from services.runtime.attachment import Attachment, encode_attachment

NOW_NS = 1_790_000_000_000_000_000
"""2026-09-21T14:13:20Z."""
STEP_NS = 500_000_000
DAY_NS = 86_400_000_000_000
TRAIN = Place("demo", "train", "T1")
BRIDGE = "demo/train/T1/lte_bridge"


def measurement(number: int, *, t_ns: int | None = None, place: Place = TRAIN, **fields: object) -> BridgedRecord:
    """The train's measurement `number`: 6.25 m and half a second after the one before, powers by a fixed pattern."""
    heard_ns = NOW_NS + number * STEP_NS
    message = RadioMeasurement(
        t_ns=heard_ns if t_ns is None else t_ns,
        **{
            "radio": f"R{number % 5}",
            "channel": "2412",
            "channel_power_dbm": -70.0 - number % 7,
            "decoded_power_dbm": None if number % 3 == 0 else -71.0,
            "chainage_m": number * 6.25 % 10_000,
            "direction": "up",
            "pass_id": f"T1-{number // 1600}",
        }
        | fields,  # type: ignore[arg-type]  # fields of the message
    )
    key = RADIO_MEASUREMENT.at(place, device="r1")
    return record(key, encode(message), number, heard_ns)


def service_event(number: int, text: str = "") -> BridgedRecord:
    """An event of the train."""
    heard_ns = NOW_NS + number * STEP_NS
    message = ServiceEvent(t_ns=heard_ns, service="gnss", boot_id="b1", kind="level", text=text)
    return record(SERVICE_EVENT.at(TRAIN, service="gnss"), encode(message), number, heard_ns)


def record(key: str, payload: bytes, number: int, heard_ns: int) -> BridgedRecord:
    """A record with its sender's mark."""
    mark = encode_attachment(Attachment("demo/train/T1/radio_probe", "b1", number, heard_ns))
    return BridgedRecord(key=key, payload=payload, attachment=mark, heard_ns=heard_ns)


def batch(records: Sequence[BridgedRecord], first: int = 0, bridge: str = BRIDGE, sent_ns: int = NOW_NS) -> BridgeBatch:
    """A batch of records."""
    return BridgeBatch(
        t_ns=sent_ns,
        bridge=bridge,
        lane="bulk",
        spool_id="s1",
        first=first,
        count=len(records),
        compressed=packed(records),
    )
