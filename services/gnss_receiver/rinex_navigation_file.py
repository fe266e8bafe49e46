"""Broadcast orbits, clocks and ionosphere of RINEX navigation files on disk."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.rinex_file import read_bytes
from services.gnss_receiver.rinex_navigation import parse_navigation


def read_navigation(paths: Sequence[Path]) -> Navigation:
    """Everything usable in RINEX 2 and 3 navigation files; what was refused stands in `issues`.

    GPS, Galileo, BeiDou, QZSS and GLONASS; plain or packed, recognised by content. Blocks: call it
    in a thread from asyncio code.
    Raises RinexError when one is no such file, OSError when it cannot be read.
    """
    return parse_navigation((str(path), read_bytes(path)) for path in paths)
