"""What a far end keeps: the journal of what it received, and documents."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Literal

import pytest
import zstandard

from schemas.bridge import Document
from services.lte_bridge.batch import MOST_PLAIN_BYTES, BatchError, packed, pieces, unpacked
from services.lte_bridge.document_store import DocumentError, keep, newest
from services.lte_bridge.journal_store import Journal, JournalFaultError
from tests.unit.lte_bridge.records import EVENT_KEY, batch, noise, record


def opened(folder: Path) -> Journal:
    journal = Journal(folder / "journal.sqlite")
    journal.open()
    return journal


def said(journal: Journal) -> list[bytes]:
    """Payloads that wait to be said, marked as said."""
    found: list[bytes] = []
    while (unsaid := journal.next_unsaid()) is not None:
        found += [one.payload for one in unsaid.records]
        journal.said(unsaid)
    return found


def test_what_is_taken_survives_and_is_said_until_it_is_settled(tmp_path: Path) -> None:
    journal = opened(tmp_path)
    first = [record(n) for n in range(3)]
    taken = journal.take(batch(0, first))
    assert (taken.fresh, taken.repeated, taken.through) == (3, 0, 2)
    payloads = [one.payload for one in first]
    assert journal.unsaid_bytes > 0
    assert said(journal) == payloads
    assert journal.unsaid_bytes == 0
    journal.settle()  # said just now: a restart says it once more
    journal.close()
    journal = opened(tmp_path)
    assert said(journal) == payloads
    journal.settle()
    journal.settle()
    journal.close()
    journal = opened(tmp_path)
    assert said(journal) == []
    assert journal.take(batch(0, first)).repeated == 3
    journal.close()


def test_events_are_said_before_bulk(tmp_path: Path) -> None:
    journal = opened(tmp_path)
    journal.take(batch(0, [record(0)]))
    events = batch(0, [record(0, EVENT_KEY)])
    journal.take(
        type(events)(**{name: getattr(events, name) for name in events.__struct_fields__} | {"lane": "events"})
    )
    assert said(journal) == [record(0, EVENT_KEY).payload, record(0).payload]
    journal.close()


def test_a_damaged_journal_is_put_aside_and_goes_on(tmp_path: Path) -> None:
    journal = opened(tmp_path)
    journal.take(batch(0, [record(0)]))
    journal.close()
    (tmp_path / "journal.sqlite").write_bytes(noise(20_000))
    journal = opened(tmp_path)
    assert "put aside" in journal.notes[0]
    assert journal.take(batch(0, [record(0)])).fresh == 1
    journal.close()
    assert (tmp_path / "journal.damaged-1.sqlite").exists()


def test_a_journal_that_cannot_be_written_acknowledges_nothing(tmp_path: Path) -> None:
    journal = opened(tmp_path)
    journal.close()
    (tmp_path / "journal.sqlite").unlink()
    (tmp_path / "journal.sqlite").mkdir()
    with pytest.raises(JournalFaultError):
        journal.take(batch(0, [record(0)]))


@pytest.mark.parametrize(
    ("compressed", "words"),
    [
        (b"", "no zstd frame"),
        (b"nonsense", "no zstd frame"),
        (packed([record(0)])[:-3], "no zstd frame"),
        (packed([record(0)])[:-1] + b"\x00", "checksum"),
        (zstandard.compress(b"\xc1"), "no array"),
        (packed([record(0), record(1)]), "2 records in a batch that says 1"),
        (zstandard.compress(bytes(MOST_PLAIN_BYTES + 1)), "a batch of 8388609 bytes"),
    ],
)
def test_bytes_that_are_no_batch_are_refused_in_words(compressed: bytes, words: str) -> None:
    for read in (unpacked, pieces):
        with pytest.raises(BatchError, match=words):
            read(compressed, 1)


def document(t_ns: int, content: bytes, name: str = "demo", kind: Literal["line", "radio_model"] = "line") -> Document:
    digest = hashlib.sha256(content).hexdigest()
    return Document(t_ns=t_ns, kind=kind, name=name, version=str(t_ns), content=content, sha256=digest)


def test_the_newest_document_is_current_whatever_comes_later(tmp_path: Path) -> None:
    place = tmp_path / "line" / "demo"
    assert newest(place) is None
    assert keep(tmp_path, document(5, b"five"))
    assert not keep(tmp_path, document(3, b"three"))
    assert keep(tmp_path, document(5, b"five"))
    assert keep(tmp_path, document(7, b"seven"))
    assert keep(tmp_path, document(1, b"else", kind="radio_model"))
    assert (place / "current").read_bytes() == b"seven"
    assert sum(1 for path in place.iterdir() if len(path.name) == 64) == 2


def test_a_crash_while_storing_leaves_the_old_one_whole(tmp_path: Path) -> None:
    keep(tmp_path, document(5, b"five"))
    place = tmp_path / "line" / "demo"
    (place / f"{hashlib.sha256(b'six').hexdigest()}.part").write_bytes(b"s")
    (place / "current.part").symlink_to("nowhere")
    os.truncate(place / "newest.json", 3)
    assert (place / "current").read_bytes() == b"five"
    assert keep(tmp_path, document(6, b"six"))
    assert (place / "current").read_bytes() == b"six"


@pytest.mark.parametrize("name", ["../escape", "a/b", "..", "nul\0"])
def test_a_name_that_leads_elsewhere_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(DocumentError, match="cannot be the name of a file"):
        keep(tmp_path, document(1, b"x", name=name))
    assert list(tmp_path.iterdir()) == []
