"""Broadcast orbits, clocks and ionosphere from and to RINEX navigation files on disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.rinex_file import read_bytes, write_lines
from services.gnss_receiver.rinex_navigation import parse_navigation
from services.gnss_receiver.rinex_navigation_text import navigation_lines


def read_navigation(paths: Sequence[Path]) -> Navigation:
    """Everything usable in RINEX 2 and 3 navigation files; what was refused stands in `issues`.

    GPS, Galileo, BeiDou, QZSS and GLONASS; plain or packed, recognised by content. Blocks: call it
    in a thread from asyncio code.
    Raises RinexError when one is no such file, OSError when it cannot be read.
    """
    unpacked = [read_bytes(path) for path in paths]
    navigation = parse_navigation((str(path), file.content) for path, file in zip(paths, unpacked, strict=True))
    return replace(navigation, issues=tuple(issue for file in unpacked for issue in file.issues) + navigation.issues)


def write_navigation(path: Path, navigation: Navigation) -> None:
    """Write a RINEX 3.04 navigation file, whole or not at all.

    Raises ValueError for what RINEX cannot hold (see `navigation_lines`), OSError when it cannot be written.
    """
    write_lines(path, navigation_lines(navigation))
