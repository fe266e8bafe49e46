"""Clocks that are wrong, of a bridge or of a device: filed by the right time, marked, and never learned from."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from schemas.bridge import BridgedRecord
from services.cloud_analyzer.duckdb_store import DuckDbStore
from services.cloud_analyzer.ingest import Ingest, Taken
from services.cloud_analyzer.tables import RADIO, Value
from tests.unit.cloud_analyzer.batches import NOW_NS, STEP_NS, batch, measurement

HOUR_NS = 3_600_000_000_000
IN_1980_NS = 315_532_800_000_000_000 - NOW_NS
IN_2036_NS = 2_082_758_400_000_000_000 - NOW_NS
SENT_NS = NOW_NS + HOUR_NS
"""An hour after the first measurement, by the right time."""
OFF = pytest.mark.parametrize("off_ns", [HOUR_NS, -HOUR_NS, IN_1980_NS, IN_2036_NS])
TRUE_NS = [NOW_NS + n * STEP_NS for n in range(5)]


def taken(off_ns: int, stamps: list[int]) -> Taken:
    """Of a bridge whose clock is off, and a device's own stamps."""
    records: list[BridgedRecord] = [
        msgspec.structs.replace(measurement(n, t_ns=t_ns), heard_ns=TRUE_NS[n] + off_ns)
        for n, t_ns in enumerate(stamps)
    ]
    return Ingest("demo", ()).take(batch(records, sent_ns=SENT_NS + off_ns), SENT_NS)


def column(found: Taken, name: str) -> list[Value]:
    return [row[RADIO.names.index(name)] for row in found.commit.rows.radio]


@OFF
def test_a_train_s_clock_that_is_off_is_told_by_when_it_sends_and_set_right(off_ns: int, tmp_path: Path) -> None:
    said = [t_ns + off_ns for t_ns in TRUE_NS]
    found = taken(off_ns, said)
    assert found.ahead_ns == off_ns
    assert (column(found, "taken_ns"), column(found, "t_ns")) == (TRUE_NS, said)
    assert set(column(found, "clock")) == {"bridge"}
    with closing(DuckDbStore(tmp_path)) as store:
        store.commit(found.commit)
        assert store.learn().sums == ()


@OFF
def test_a_device_with_the_right_time_behind_a_bridge_with_the_wrong_one_keeps_its_own(off_ns: int) -> None:
    found = taken(off_ns, TRUE_NS)
    assert (column(found, "taken_ns"), column(found, "t_ns")) == (TRUE_NS, TRUE_NS)


@OFF
def test_a_device_in_1970_behind_a_bridge_that_is_off_is_filed_by_when_it_was_heard(off_ns: int) -> None:
    found = taken(off_ns, list(range(5)))
    assert column(found, "taken_ns") == TRUE_NS
    assert set(column(found, "clock")) == {"device and bridge"}


def test_a_batch_that_took_minutes_to_come_is_no_wrong_clock() -> None:
    found = taken(-240_000_000_000, TRUE_NS)
    assert found.ahead_ns == 0
    late_spool = taken(0, TRUE_NS)
    assert set(column(late_spool, "clock")) == {""}
    assert column(late_spool, "taken_ns") == TRUE_NS
