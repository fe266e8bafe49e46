"""Observations of a RINEX observation file on disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from services.gnss_receiver.observations import Observations
from services.gnss_receiver.rinex_file import read_bytes
from services.gnss_receiver.rinex_observations import parse_observations


def read_observations(path: Path, *, progress: Callable[[float], None] | None = None) -> Observations:
    """Everything that is good in a RINEX observation file; what was refused stands in `issues`.

    RINEX 2.10-2.12 and 3.00-3.05, plain, packed or Hatanaka-compressed, recognised by content.
    `progress` gets the fraction done, rising to 1. Blocks: call it in a thread from asyncio code.
    Raises RinexError when it is no such file, OSError when it cannot be read.
    """
    return parse_observations(read_bytes(path), str(path), progress)
