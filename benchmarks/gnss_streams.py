"""Receivers' streams: epochs and ephemerides out of RTCM 3 and UBX, beside pyrtcm and pyubx2.

The peers frame, check and name the fields of every message; Kirotei does, and makes epochs of them besides.
Both read the same bytes out of memory; the last message may be cut. pyrtcm and pyubx2 come with Kirotei.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from pyrtcm import RTCMReader
from pyubx2 import UBXReader

from benchmarks.comparison import Result, alternate, seconds
from schemas.gnss import Epoch
from schemas.gnss_time import unix_ns_from_gps
from services.gnss_receiver.receiver_stream import ReceiverStream
from services.gnss_receiver.recording_file import heard_in
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations
from services.gnss_reference.rtcm_output import RtcmOutput

MOST_BYTES = 1_000_000
"""So much of a recording is read: pyrtcm takes some seconds for it."""
SHANGHAI_NS = unix_ns_from_gps(2262, 455_000.0)
"""Within three days of its recording, whose messages name no week. UBX names its weeks itself."""
STATION_M = (-3_960_000.0, 3_350_000.0, 3_700_000.0)


@dataclass(frozen=True, slots=True)
class Stream:
    """Bytes as a receiver sent them, and who else reads them."""

    name: str
    content: bytes
    near_ns: int
    peer: str
    read: Callable[[bytes], int]
    """The peer's reading; gives the number of messages."""


def read_by_pyrtcm(content: bytes) -> int:
    """Number of messages that pyrtcm reads."""
    return sum(message is not None for _, message in RTCMReader(BytesIO(content), quitonerror=0))


def read_by_pyubx2(content: bytes) -> int:
    """Number of messages that pyubx2 reads."""
    return sum(message is not None for _, message in UBXReader(BytesIO(content), quitonerror=0))


def read_by_kirotei(stream: Stream) -> int:
    """Number of epochs in a stream."""
    receiver = ReceiverStream(stream.near_ns)
    return sum(isinstance(heard, Epoch) for heard in heard_in(stream.content, receiver))


def streams(simulated: Path) -> list[Stream]:
    """Recorded streams where KIROTEI_FIELD_DATA names their folder, else the simulated run written as MSM7."""
    field = os.environ.get("KIROTEI_FIELD_DATA")
    if field and (Path(field) / "gnss").is_dir():
        gnss = Path(field) / "gnss"
        walk = gnss / "shanghai_dgps"
        return [
            _rtcm("Shanghai rover (RTCM 3, MSM7)", (walk / "rover.rtcm3").read_bytes(), SHANGHAI_NS),
            _rtcm("Shanghai base (RTCM 3, MSM4)", (walk / "base.rtcm3").read_bytes(), SHANGHAI_NS),
            Stream(
                "Boulder 4 Hz (UBX)",
                (gnss / "boulder_4hz" / "rover.ubx").read_bytes()[:MOST_BYTES],
                SHANGHAI_NS,
                "pyubx2",
                read_by_pyubx2,
            ),
        ]
    observations = read_observations(simulated / "rover.obs")
    output = RtcmOutput(0, 7, Counter())
    frames = [output.ephemeris(one) for one in read_navigation([simulated / "nav.rnx"]).ephemerides]
    frames += [output.epoch(observations.epoch(index), STATION_M) for index in range(len(observations))]
    return [_rtcm("simulated 5 Hz (RTCM 3, MSM7)", b"".join(frames), observations.epoch(0).t_ns)]


def _rtcm(name: str, content: bytes, near_ns: int) -> Stream:
    return Stream(name, content[:MOST_BYTES], near_ns, "pyrtcm", read_by_pyrtcm)


def measure_streams(simulated: Path, rounds: int) -> list[Result]:
    """Every stream on both sides. Raises RuntimeError when one of them reads nothing."""
    results = []
    for stream in streams(simulated):
        if not (read_by_kirotei(stream) and stream.read(stream.content[:100_000])):
            msg = f"{stream.name}: nothing was read"
            raise RuntimeError(msg)
        own_s, peer_s = alternate(
            rounds,
            lambda stream=stream: seconds(lambda: read_by_kirotei(stream)),  # type: ignore[misc] # bound for this round
            lambda stream=stream: seconds(lambda: stream.read(stream.content)),  # type: ignore[misc] # likewise
        )
        size_mb = len(stream.content) / 1e6
        theirs = None if peer_s is None else size_mb / peer_s
        ratio = None if peer_s is None else peer_s / own_s
        results.append(Result("read a stream", stream.name, "MB/s", size_mb / own_s, stream.peer, theirs, ratio))
    return results
