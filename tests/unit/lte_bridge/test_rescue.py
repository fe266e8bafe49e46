"""A damaged spool is put aside, and what can be read of it goes on."""

from __future__ import annotations

import random
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from schemas.bridge import BridgedRecord
from services.lte_bridge.batch import packed, unpacked
from services.lte_bridge.lane import LANES
from services.lte_bridge.spool_store import SpoolFaultError
from tests.unit.lte_bridge.records import BULK_KEY, EVENT_KEY, QUICK_DISK, noise, record
from tests.unit.lte_bridge.test_spool import drained, opened

ROWS = 120
PER_ROW = 20
PAGE = 4096


def everything() -> list[BridgedRecord]:
    return [record(number, payload=noise(1000, number)) for number in range(ROWS * PER_ROW)]


def filled(folder: Path) -> list[BridgedRecord]:
    """A spool of batches that are too large to be folded, closed as it should be; what of it is not acknowledged."""
    records = everything()
    with opened(folder) as spool:
        for start in range(0, len(records), PER_ROW):
            spool.put(records[start : start + PER_ROW])
        spool.put([record(0, EVENT_KEY)])
        assert spool.acknowledge("bulk", PER_ROW + 4) == PER_ROW + 5
    return records[PER_ROW + 5 :]


def overwrite(path: Path, offset: int, size: int, seed: int = 1) -> None:
    with path.open("r+b") as file:
        file.seek(offset)
        file.write(random.Random(seed).randbytes(size))  # noqa: S311 - no secret


def saved(folder: Path) -> list[BridgedRecord]:
    """What is left of the bulk, through a spool that may only find out while reading."""
    with opened(folder) as spool:
        found: list[BridgedRecord] = []
        for _ in range(5):
            try:
                found += drained(spool, "bulk", 100_000)
            except SpoolFaultError:
                continue
            break
        spool.put([record(10_000_000)])
        assert drained(spool, "bulk") == [record(10_000_000)]
        return found


def test_a_lost_first_page_costs_nothing(tmp_path: Path) -> None:
    left = filled(tmp_path)
    overwrite(tmp_path / "spool.sqlite", 0, PAGE)
    with opened(tmp_path) as spool:
        assert spool.notes[0].endswith(f"{len(left) + 1} records saved, 0 lost")
        assert "spool.damaged-1.sqlite" in spool.notes[0]
        assert drained(spool, "bulk") == left
        assert drained(spool, "events") == [record(0, EVENT_KEY)]


def test_a_file_that_is_none_is_put_aside(tmp_path: Path) -> None:
    (tmp_path / "spool.sqlite").write_bytes(noise(100_000))
    with opened(tmp_path) as spool:
        assert "how many more it held is unknown" in spool.notes[0]
        spool.put([record(0)])
        assert drained(spool, "bulk") == [record(0)]
    assert (tmp_path / "spool.damaged-1.sqlite").exists()


def test_a_damaged_body_is_quarantined_and_the_rest_goes_out(tmp_path: Path) -> None:
    left = filled(tmp_path)
    with closing(sqlite3.connect(tmp_path / "spool.sqlite")) as file:
        body = file.execute("SELECT body FROM batch WHERE first = 60").fetchone()[0]
        file.execute("UPDATE batch SET body = ? WHERE first = 60", (body[:-9] + bytes(9),))
        file.commit()
    with opened(tmp_path) as spool:
        assert drained(spool, "bulk") == [one for one in left if not 60 <= one.heard_ns - 1_000_000_000 < 80]
        assert spool.held().quarantined == PER_ROW
        assert "20 records of the lane bulk cannot be read and are in quarantine" in spool.notes[0]
    with closing(sqlite3.connect(tmp_path / "spool.sqlite")) as file:
        assert file.execute("SELECT first, count FROM damaged").fetchall() == [(60, PER_ROW)]


class Whole(NamedTuple):
    """A sound spool and what is in it. Shown without its megabytes when an example fails."""

    folder: Path
    left: list[BridgedRecord]

    def __repr__(self) -> str:
        return f"<{len(self.left)} records>"


@pytest.fixture(scope="module")
def model() -> Iterator[Whole]:
    with tempfile.TemporaryDirectory(dir=QUICK_DISK) as name:
        yield Whole(Path(name), filled(Path(name)))


@settings(max_examples=25)
@example(pages={3}, seed=0)
@given(pages=st.sets(st.integers(1, 700), min_size=1, max_size=4), seed=st.integers(0, 1000))
def test_whatever_pages_are_lost_what_is_left_is_right_and_in_order(model: Whole, pages: set[int], seed: int) -> None:
    whole, left = model
    with tempfile.TemporaryDirectory(dir=QUICK_DISK) as name:
        path = Path(name) / "spool.sqlite"
        shutil.copy(whole / path.name, path)
        for page in pages:
            overwrite(path, page * PAGE % path.stat().st_size, PAGE, seed)
        found = saved(Path(name))
    # Without the page that says what was acknowledged, the rest of a half acknowledged batch comes once more.
    by_number = {one.heard_ns: one for one in (*everything()[PER_ROW : PER_ROW + 5], *left)}
    assert all(by_number[one.heard_ns] == one for one in found)
    numbers = [one.heard_ns for one in found]
    assert numbers == sorted(numbers)
    assert len(set(numbers)) == len(numbers)


def test_a_rescue_that_is_cut_short_begins_anew(tmp_path: Path) -> None:
    left = filled(tmp_path)
    (tmp_path / "spool.sqlite").rename(tmp_path / "spool.damaged-3.sqlite")
    (tmp_path / "spool.sqlite.part").write_bytes(b"half")
    with opened(tmp_path) as spool:
        assert drained(spool, "bulk") == left
    overwrite(tmp_path / "spool.sqlite", 0, PAGE)
    with opened(tmp_path):
        pass
    assert (tmp_path / "spool.damaged-4.sqlite").exists()


def test_what_is_damaged_while_it_is_used_is_put_aside_too(tmp_path: Path) -> None:
    with opened(tmp_path) as spool:
        everything = [record(number, payload=noise(1000, number)) for number in range(200)]
        spool.put(everything)
        spool.close()
        path = tmp_path / "spool.sqlite"
        spool.open()
        overwrite(path, 0, path.stat().st_size)  # everything, under the open connection
        with pytest.raises(SpoolFaultError, match="put aside"):
            drained(spool, "bulk")
        spool.put([record(9999)])
        assert drained(spool, "bulk")[-1] == record(9999)
        assert all(spool.dropped(lane) == 0 for lane in LANES)


def test_a_batch_says_what_it_holds() -> None:
    records = [record(number, BULK_KEY) for number in range(10)]
    assert unpacked(packed(records), 10) == records
