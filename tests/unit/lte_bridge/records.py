"""Records as a bus of the demo line would give them."""

from __future__ import annotations

import random
from pathlib import Path

from schemas.bridge import BridgeBatch, BridgedRecord
from schemas.topic import Place
from schemas.topics import RADIO_MEASUREMENT, SLIP_EPISODE
from services.lte_bridge.batch import packed
from services.runtime.attachment import Attachment, encode_attachment

QUICK_DISK = "/dev/shm" if Path("/dev/shm").is_dir() else None  # noqa: S108 - made by tempfile, removed by tempfile
"""Where the system has it, a disk in memory: hundreds of commits then take no time."""
TRAIN = Place("demo", "train", "T1")
BULK_KEY = RADIO_MEASUREMENT.at(TRAIN, device="roof")
EVENT_KEY = SLIP_EPISODE.at(TRAIN)


def record(number: int, key: str = BULK_KEY, boot: str = "b1", payload: bytes | None = None) -> BridgedRecord:
    """Record `number` of a stream; its payload says which."""
    attachment = encode_attachment(Attachment("demo/train/T1/radio_probe", boot, number, number))
    return BridgedRecord(
        key=key,
        payload=f"{key} {number}".encode() if payload is None else payload,
        attachment=attachment,
        heard_ns=1_000_000_000 + number,
    )


def noise(size: int, seed: int = 0) -> bytes:
    """Bytes that do not compress."""
    return random.Random(seed).randbytes(size)  # noqa: S311 - no secret


def batch(first: int, records: list[BridgedRecord], spool_id: str = "s1") -> BridgeBatch:
    return BridgeBatch(
        t_ns=0,
        bridge="demo/train/T1/lte_bridge",
        lane="bulk",
        spool_id=spool_id,
        first=first,
        count=len(records),
        compressed=packed(records),
    )
