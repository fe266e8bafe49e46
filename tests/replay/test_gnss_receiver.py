"""The receiver service on a bus in memory, with virtual time."""

from __future__ import annotations

import asyncio
import itertools
from pathlib import Path

import numpy as np
import pytest

from schemas.gnss import Ephemeris, Epoch, Ionosphere
from schemas.gnss_time import unix_ns_from_gps
from schemas.topic import Place
from schemas.topics import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_IONOSPHERE
from services.gnss_receiver.reception_stream import LATEST_S, LONGEST_WAIT_S, PAUSE_S
from services.gnss_receiver.rinex_error import RinexError
from services.gnss_receiver.rinex_observation_file import read_observations
from services.gnss_receiver.service import SERVICE, Config
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Arrival
from tests.unit.gnss_receiver.navigation_samples import GPS, changed, record_3
from tests.unit.gnss_receiver.navigation_samples import header_3 as navigation_header
from tests.unit.gnss_receiver.samples import epoch_3, header_3, header_line, text_of

TRAIN = Place("demo", "train", "T1")
Message = Epoch | Ephemeris | Ionosphere
START_NS = 1_800_000_000 * 10**9
READER = guest("reader", "listens", reads=(GNSS_EPOCH, GNSS_EPHEMERIS, GNSS_IONOSPHERE))


class Played:
    """What a run of the service put on the bus, and when."""

    def __init__(self) -> None:
        self.arrivals: list[Arrival[Message]] = []
        self.health: dict[str, int] = {}
        self.level: tuple[str, tuple[str, ...]] = ("", ())

    def of(self, kind: type[Message]) -> list[tuple[float, Message]]:
        """Messages of one kind, with the virtual time [s] of their arrival."""
        return [
            ((arrival.received_ns - START_NS) / 1e9, arrival.message)
            for arrival in self.arrivals
            if isinstance(arrival.message, kind)
        ]

    def times(self) -> list[float]:
        """When the epochs came [s]."""
        return [round(time_s, 6) for time_s, _ in self.of(Epoch)]


def play(config: Config, until_s: float | None = None) -> Played:
    """Run the service to its end, or stop it at a virtual time."""
    played = Played()

    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop(), START_NS)
        bus = MemoryBus()
        reader = MemoryNode(bus, READER, TRAIN, clock)
        node = MemoryNode(bus, SERVICE, TRAIN, clock)
        arrivals = reader.arrivals(GNSS_EPOCH, GNSS_EPHEMERIS, GNSS_IONOSPHERE)
        running = asyncio.ensure_future(node.run(config))
        if until_s is not None:
            await asyncio.sleep(until_s)
            node.stop()
        await running
        assert node.is_ready.is_set()
        reader.stop()
        played.arrivals = [arrival async for arrival in arrivals]
        played.health = dict(node.health.counts)
        played.level = node.health.level(clock.monotonic_s())

    run_manual(main())
    return played


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "recording.rnx"
    path.write_bytes(text_of(header_3(), *(epoch_3(index) for index in range(4))))
    return path


@pytest.fixture
def broadcast(tmp_path: Path) -> Path:
    """Two ephemerides of G12, their midpoint between the second and the third epoch."""
    path = tmp_path / "broadcast.nav"
    ionosphere = [
        header_line("GPSA   1.0000E-08  0.0000E+00  0.0000E+00  0.0000E+00", "IONOSPHERIC CORR"),
        header_line("GPSB   1.0000E+05  0.0000E+00  0.0000E+00  0.0000E+00", "IONOSPHERIC CORR"),
    ]
    records = [
        record_3("G12", f"2016 06 06 {clock}", changed(GPS, 3, 0, toe_s))
        for clock, toe_s in (("10 10 42", 123_042.1), ("12 10 42", 130_242.1))
    ]
    path.write_bytes(text_of(navigation_header(*ionosphere), *records, record_3("G19", "2016 06 06 00 00 00", GPS)))
    return path


def test_epochs_come_at_their_own_pace_and_keep_their_times(recording: Path) -> None:
    played = play(Config(observations=str(recording), device="rear"))
    assert played.times() == [0.0, 0.3, 0.5, 0.7]
    observations = read_observations(recording)
    for index, (_, message) in enumerate(played.of(Epoch)):
        assert isinstance(message, Epoch)
        assert message.t_ns == unix_ns_from_gps(1900, float(observations.tow_s[index]))
        assert message.satellites == ("G12", "R20", "E05", "G19")
        assert np.array_equal(message.pseudorange_m, observations.epoch(index).pseudorange_m)
    assert {arrival.fields["device"] for arrival in played.arrivals} == {"rear"}


@pytest.mark.parametrize(("speed", "times"), [(2.0, [0.0, 0.15, 0.25, 0.35]), (0.0, [0.0] * 4)])
def test_speed(recording: Path, speed: float, times: list[float]) -> None:
    assert play(Config(observations=str(recording), speed=speed)).times() == times


def test_repeated_and_unordered_epochs_follow_at_once(tmp_path: Path) -> None:
    path = tmp_path / "unordered.rnx"
    path.write_bytes(text_of(header_3(), epoch_3(0), epoch_3(2), epoch_3(2), epoch_3(1), epoch_3(3)))
    assert play(Config(observations=str(path))).times() == [0.0, 0.5, 0.5, 0.5, 0.9]


def test_long_gaps_are_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "gap.rnx"
    late = epoch_3(1)
    late[0] = late[0].replace(" 11 10", " 23 10")
    path.write_bytes(text_of(header_3(), epoch_3(0), late))
    assert play(Config(observations=str(path))).times() == [0.0, LONGEST_WAIT_S]


def test_a_recording_begins_again_until_stopped(recording: Path) -> None:
    played = play(Config(observations=str(recording), repeat=True), until_s=4.0)
    once = [0.0, 0.3, 0.5, 0.7]
    period_s = once[-1] + PAUSE_S
    assert played.times() == [round(time_s + turn * period_s, 6) for turn in range(3) for time_s in once][:11]
    assert played.health["repetitions"] == 2
    stamps = [message.t_ns for _, message in played.of(Epoch)]
    assert stamps[4:8] == stamps[:4]


def test_ephemerides_come_before_the_epochs_that_need_them(recording: Path, broadcast: Path) -> None:
    played = play(Config(observations=str(recording), navigation=(str(broadcast),)))
    kinds = [
        (type(arrival.message).__name__, arrival.fields.get("satellite"), getattr(arrival.message, "toe_s", None))
        for arrival in played.arrivals
    ]
    assert kinds == [
        ("Ionosphere", None, None),
        ("Ephemeris", "G12", 123_042.1),
        ("Ephemeris", "G19", 86_400.0),
        ("Epoch", None, None),
        ("Epoch", None, None),
        ("Ephemeris", "G12", 130_242.1),
        ("Epoch", None, None),
        ("Epoch", None, None),
    ]
    assert played.arrivals[0].message.t_ns == played.of(Epoch)[0][1].t_ns


def test_what_was_refused_in_the_files_shows_in_health(recording: Path) -> None:
    content = recording.read_bytes().replace(b"G12  20002000.125", b"G12  2000x000.125")
    recording.write_bytes(content)
    played = play(Config(observations=str(recording)))
    assert played.health == {"epochs_read": 4, "ephemerides_read": 0, "issues": 1}
    assert played.level[0] == "degraded"
    ((reason,),) = (played.level[1],)
    assert reason.startswith(f"1 things in the files were refused, the first: {recording}:")


def test_a_clean_recording_is_healthy(recording: Path) -> None:
    played = play(Config(observations=str(recording)))
    assert played.health == {"epochs_read": 4, "ephemerides_read": 0, "issues": 0}
    assert played.level == ("ok", ())


def test_files_that_cannot_be_read_end_the_service(recording: Path, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"nowhere\.obs"):
        play(Config(observations=str(tmp_path / "nowhere.obs")))
    with pytest.raises(RinexError, match="this is no navigation file that is read but 'OBSERVATION DATA'"):
        play(Config(observations=str(recording), navigation=(str(recording),)))
    recording.write_bytes(text_of(header_3()))
    with pytest.raises(ValueError, match=r"recording\.rnx holds no epoch that can be read"):
        play(Config(observations=str(recording)))


def test_a_host_that_slept_does_not_get_a_burst(recording: Path) -> None:
    # The clock leaps by an hour between two epochs; the rest keep their distances.
    async def main() -> list[float]:
        clock = SleepyClock(asyncio.get_running_loop())
        bus = MemoryBus()
        reader = MemoryNode(bus, READER, TRAIN, clock)
        arrivals = reader.arrivals(GNSS_EPOCH)
        node = MemoryNode(bus, SERVICE, TRAIN, clock)
        running = asyncio.ensure_future(node.run(Config(observations=str(recording))))
        await asyncio.sleep(0.35)
        clock.asleep_s = 3600.0
        await running
        reader.stop()
        return [arrival.received_ns / 1e9 async for arrival in arrivals]

    times = run_manual(main())
    gaps = [round(later - earlier, 6) for earlier, later in itertools.pairwise(times)]
    assert gaps == [0.3, 3600.2, 0.2]
    assert gaps[1] > LATEST_S


class SleepyClock(ManualClock):
    """A clock whose host was asleep for a while; the loop's timers did not see it."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__(loop)
        self.asleep_s = 0.0

    def monotonic_s(self) -> float:
        return super().monotonic_s() + self.asleep_s
