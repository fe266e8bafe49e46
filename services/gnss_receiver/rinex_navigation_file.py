"""Broadcast orbits, clocks and ionosphere from and to RINEX navigation files on disk."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.recording_file import is_stream, read_recording
from services.gnss_receiver.rinex_file import read_bytes, write_lines
from services.gnss_receiver.rinex_navigation import parse_navigation
from services.gnss_receiver.rinex_navigation_text import navigation_lines


def read_navigation(paths: Sequence[Path], *, beside_ns: int | None = None) -> Navigation:
    """Everything usable in navigation files; what was refused stands in `issues`.

    GPS, Galileo, BeiDou, QZSS and GLONASS, from RINEX 2 and 3, plain or packed, and from RTCM 3 or
    UBX as a receiver sent them; recognised by content. `beside_ns` is the time (UTC) of a recording made
    beside them, for one that does not name its day. Blocks: call it in a thread from asyncio code.
    Raises RinexError when one is no such file, OSError when it cannot be read.
    """
    unpacked = {path: read_bytes(path) for path in paths}
    texts = {path: file for path, file in unpacked.items() if not is_stream(file.content)}
    navigation = parse_navigation((str(path), file.content) for path, file in texts.items())
    issues = tuple(issue for file in texts.values() for issue in file.issues) + navigation.issues
    ephemerides, ionosphere = navigation.ephemerides, navigation.ionosphere
    for path in [path for path in unpacked if path not in texts]:
        recorded = read_recording(path, beside_ns=beside_ns).navigation
        ephemerides, issues = ephemerides + recorded.ephemerides, issues + recorded.issues
        ionosphere = ionosphere or recorded.ionosphere
    return Navigation(ephemerides, ionosphere, issues)


def write_navigation(path: Path, navigation: Navigation) -> None:
    """Write a RINEX 3.04 navigation file, whole or not at all.

    Raises ValueError for what RINEX cannot hold (see `navigation_lines`), OSError when it cannot be written.
    """
    write_lines(path, navigation_lines(navigation))
