"""A GLONASS record whose time is no reference time: its orbit would be that of another instant."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.rinex_navigation_file import read_navigation, write_navigation
from tests.unit.gnss_receiver.broadcast_samples import glonass

LEAP_S = 18
"""GPS time less UTC in May 2023."""


@pytest.mark.parametrize(("off_s", "kept"), [(0, 1), (900, 1), (-1800, 1), (LEAP_S, 0), (60, 0), (1, 0)])
def test_only_quarters_of_an_hour_are_reference_times(tmp_path: Path, off_s: int, kept: int) -> None:
    path = tmp_path / "glonass.rnx"
    moved = msgspec.structs.replace(glonass(), toe_s=glonass().toe_s + off_s, toc_s=glonass().toc_s + off_s)
    write_navigation(path, Navigation((moved,), None, ()))
    read = read_navigation([path])
    assert len(read.ephemerides) == kept
    words = f"GLONASS has no reference time {off_s} s behind a quarter of an hour"
    assert [words in str(issue) for issue in read.issues] == [True] * (1 - kept)
