"""Observations from and to RINEX observation files on disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from schemas.gnss import Epoch
from services.gnss_receiver.observations import Observations, observations_of
from services.gnss_receiver.recording_file import is_stream, read_recording
from services.gnss_receiver.rinex_file import read_bytes, write_lines
from services.gnss_receiver.rinex_observation_text import RecordingHeader, observation_lines
from services.gnss_receiver.rinex_observations import parse_observations


def read_observations(
    path: Path, *, progress: Callable[[float], None] | None = None, beside_ns: int | None = None
) -> Observations:
    """Everything that is good in a recording of observations; what was refused stands in `issues`.

    RINEX 2.10-2.12 and 3.00-3.05, plain, packed or Hatanaka-compressed, and RTCM 3 or UBX as a
    receiver sent them, recognised by content.
    `beside_ns` is the time (UTC) of a recording made beside it, for one that does not name its day.
    `progress` gets the fraction done, rising to 1. Blocks: call it in a thread from asyncio code.
    Raises RinexError when it is no such file, OSError when it cannot be read.
    """
    unpacked = read_bytes(path)
    if is_stream(unpacked.content):
        return read_recording(path, beside_ns=beside_ns).observations
    observations = parse_observations(unpacked.content, str(path), progress)
    return replace(observations, issues=unpacked.issues + observations.issues)


def write_observations(
    path: Path, epochs: Observations | Iterable[Epoch], header: RecordingHeader | None = None
) -> None:
    """Write a RINEX 3.04 observation file, whole or not at all.

    Raises ValueError for what RINEX cannot hold (see `observation_lines`), OSError when it cannot be written.
    """
    observations = epochs if isinstance(epochs, Observations) else observations_of(epochs)
    write_lines(path, observation_lines(observations, header or RecordingHeader()))
