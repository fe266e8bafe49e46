"""A recording of one receiver on disk: its bytes as they came, in RTCM 3, UBX or NMEA."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from schemas.gnss import Ephemeris, Epoch, Ionosphere
from services.gnss_receiver.heard import Heard, StationPosition
from services.gnss_receiver.observations import FileIssue, Navigation, Observations, observations_of
from services.gnss_receiver.receiver_stream import ReceiverStream
from services.gnss_receiver.rinex_error import RinexError
from services.gnss_receiver.rinex_file import read_bytes
from services.gnss_receiver.stream_date import date_of
from services.gnss_receiver.stream_frames import Framer

_CHUNK: Final = 4096
_TASTED: Final = 65_536
_FEWEST_FRAMES: Final = 2
_NO_FAULT: Final = (
    "bytes",
    "epochs",
    "own_positions",
    "ephemerides_repeated",
    "repeated_messages",
    "fnav_left_out",
)
_NO_FAULT_BEGINNINGS: Final = (
    "not_read_",
    "unsupported_",
    "rtcm3_frames",
    "ubx_frames",
    "nmea_frames",
    "positions_twice",
)


class UndatedError(RinexError):
    """A recording that does not name its day."""


@dataclass(frozen=True, slots=True)
class Recording:
    """Everything of use in a recording."""

    observations: Observations
    navigation: Navigation
    station: StationPosition | None = None


def is_stream(content: bytes) -> bool:
    """Whether bytes hold messages of a receiver: at least two that pass their checks near the beginning."""
    return len(Framer().feed(content[:_TASTED])) >= _FEWEST_FRAMES


def heard_in(content: bytes, stream: ReceiverStream) -> Iterator[Heard]:
    """Everything that a recording says, in its order."""
    for at in range(0, len(content), _CHUNK):
        yield from stream.feed(content[at : at + _CHUNK])
    yield from stream.cut()


def open_recording(
    path: Path, recorded_ns: int | None = None, *, beside_ns: int | None = None
) -> tuple[bytes, ReceiverStream]:
    """Bytes of a recording, and the stream that reads them; `recorded_ns` is a time (UTC) within three days of it.

    Without that the messages themselves must name the day; where they do not, it is that of
    `beside_ns`, the time of a recording made beside it. Of weeks counted modulo 1024 the one nearest to
    `beside_ns` is taken, or else to the file's own date. Raises UndatedError when nothing names the day,
    RinexError when it is no recording at all; OSError when the file cannot be read.
    """
    content = read_bytes(path).content
    if not is_stream(content):
        raise RinexError(str(path), 0, "it holds no RTCM 3, UBX or NMEA messages; give a receiver's recording")
    near_ns = recorded_ns
    if near_ns is None:
        near_ns = date_of(content, path.stat().st_mtime_ns if beside_ns is None else beside_ns)
    if near_ns is None:
        near_ns = beside_ns
    if near_ns is None:
        raise UndatedError(str(path), 0, "no message in it names the day; say when it was recorded")
    return content, ReceiverStream(near_ns)


def read_recording(path: Path, recorded_ns: int | None = None, *, beside_ns: int | None = None) -> Recording:
    """Everything of use in a recording; what was refused stands as issues. See `open_recording`."""
    content, stream = open_recording(path, recorded_ns, beside_ns=beside_ns)
    epochs: list[Epoch] = []
    ephemerides: list[Ephemeris] = []
    ionosphere: Ionosphere | None = None
    station: StationPosition | None = None
    for heard in heard_in(content, stream):
        match heard:
            case Epoch():
                epochs.append(heard)
            case Ephemeris():
                ephemerides.append(heard)
            case Ionosphere():
                ionosphere = heard
            case StationPosition():
                station = heard
            case _:
                pass
    issues = _issues(path, stream)
    navigation = Navigation(tuple(ephemerides), ionosphere, issues)
    return Recording(replace(observations_of(epochs), issues=issues), navigation, station)


def _issues(path: Path, stream: ReceiverStream) -> tuple[FileIssue, ...]:
    """What was refused, by reason; messages that are simply of no use are no issue."""
    counts = sorted(stream.counts.items())
    faults = [(n, what) for what, n in counts if what not in _NO_FAULT and not what.startswith(_NO_FAULT_BEGINNINGS)]
    return tuple(FileIssue(str(path), 0, f"{count} {what.replace('_', ' ')}") for count, what in faults)
