"""Files on disk: packings, and what is no file."""

from __future__ import annotations

import bz2
import gzip
from pathlib import Path

import hatanaka
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from services.gnss_receiver.rinex_error import RinexError
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations
from tests.unit.gnss_receiver.navigation_samples import GPS, record_3
from tests.unit.gnss_receiver.navigation_samples import header_3 as navigation_header
from tests.unit.gnss_receiver.samples import (
    epoch_2,
    epoch_3,
    expected,
    header_2,
    header_3,
    header_line,
    rows_of,
    text_of,
)

# Hatanaka's programs want a complete header.
_MORE = [
    header_line("kirotei", "PGM / RUN BY / DATE"),
    header_line("unknown", "MARKER NAME"),
]
TWO = text_of(header_2()[:1], _MORE, header_2()[1:], epoch_2(0), epoch_2(1))
THREE = text_of(header_3()[:1], _MORE, header_3()[1:], epoch_3(0), epoch_3(1))


@pytest.mark.parametrize("content", [TWO, THREE], ids=["2", "3"])
@pytest.mark.parametrize("name", ["recording", "recording.nav", "recording.zip"])
def test_files_are_known_by_their_content(tmp_path: Path, content: bytes, name: str) -> None:
    compact = hatanaka.rnx2crx(content)
    packings = (
        content,
        gzip.compress(content),
        gzip.compress(content[:700]) + gzip.compress(content[700:]) + bytes(20),
        bz2.compress(content),
        hatanaka.compress(content, compression="Z"),
        compact,
        gzip.compress(compact),
        hatanaka.compress(content, compression="gz"),
    )
    for packing in packings:
        path = tmp_path / name
        path.write_bytes(packing)
        observations = read_observations(path)
        assert observations.issues == ()
        assert rows_of(observations) == expected(2)


def test_a_packed_navigation_file(tmp_path: Path) -> None:
    content = text_of(navigation_header(), record_3("G01", "2016 06 06 00 00 00", GPS))
    plain, packed = tmp_path / "plain", tmp_path / "packed"
    plain.write_bytes(content)
    packed.write_bytes(gzip.compress(content))
    assert read_navigation([plain]).ephemerides == read_navigation([packed, plain]).ephemerides != ()


def test_a_gzip_file_cut_short_gives_its_whole_epochs(tmp_path: Path) -> None:
    path = tmp_path / "cut.rnx.gz"
    path.write_bytes(gzip.compress(text_of(header_3(), *(epoch_3(index) for index in range(4))), 0)[:-300])
    observations = read_observations(path)
    assert str(observations.issues[0]) == f"{path}: the gzip packing is cut short"
    rows = rows_of(observations)
    assert expected(2).items() <= rows.items()
    assert len(rows) < len(expected(4))


def test_a_damaged_packing_says_so(tmp_path: Path) -> None:
    path = tmp_path / "bad.gz"
    packed = bytearray(gzip.compress(THREE))
    packed[40] ^= 0xFF
    path.write_bytes(packed)
    with pytest.raises(RinexError, match=r"bad\.gz: the gzip packing is damaged .*; get the file again"):
        read_observations(path)
    compact = hatanaka.rnx2crx(THREE)
    path.write_bytes(compact[: len(compact) - 30])
    with pytest.raises(RinexError, match=r"bad\.gz: it cannot be unpacked .*truncated in the middle"):
        read_observations(path)


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])  # one file each
@given(
    magic=st.sampled_from((b"\x1f\x8b", b"\x1f\x9d", b"BZh", b"PK\x03\x04", hatanaka.rnx2crx(THREE)[:200])),
    rest=st.binary(max_size=300),
)
def test_a_packing_full_of_garbage_says_so(tmp_path: Path, magic: bytes, rest: bytes) -> None:
    path = tmp_path / "garbage"
    path.write_bytes(magic + rest)
    with pytest.raises(RinexError, match="garbage"):
        read_observations(path)


def test_epochs_that_the_compact_form_lost_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "lost.crx"
    lines = hatanaka.rnx2crx(text_of(header_3()[:1], _MORE, header_3()[1:], *(epoch_3(index) for index in range(4))))
    parts = lines.splitlines(keepends=True)
    path.write_bytes(b"".join(parts[:-9] + parts[-7:]))
    observations = read_observations(path)
    assert observations.issues
    assert rows_of(observations).items() <= expected(4).items()


def test_a_file_that_is_not_there_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"nowhere\.obs"):
        read_observations(tmp_path / "nowhere.obs")
    with pytest.raises(FileNotFoundError, match=r"nowhere\.nav"):
        read_navigation([tmp_path / "nowhere.nav"])
