"""The receiver service on recorded bytes and on scripted live sources, on a bus in memory with virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest

from schemas.gnss import Ephemeris, Epoch, Ionosphere, OwnPosition
from schemas.topic import Place
from schemas.topics import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_IONOSPHERE, GNSS_OWN_POSITION
from services.byte_source.settings import TcpSource
from services.byte_source.source import READ_S, SourceError
from services.gnss_receiver.heard import Heard, StationPosition
from services.gnss_receiver.live_stream import connection, follow
from services.gnss_receiver.reception import FileSource, Reception
from services.gnss_receiver.rinex_error import RinexError
from services.gnss_receiver.rtcm_ephemerides import write_ephemeris
from services.gnss_receiver.rtcm_messages import framed
from services.gnss_receiver.rtcm_station import write_station
from services.gnss_receiver.service import SERVICE, Config
from services.runtime.clock import LiveClock, ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from tests.unit.gnss_receiver.broadcast_samples import kepler
from tests.unit.gnss_receiver.stream_samples import NEAR_NS, TOW_S, WEEK, epoch, gga, pvt, rawx, rmc, rtcm_of
from tests.unit.gnss_receiver.test_ubx_stream import ROWS

TRAIN = Place("demo", "train", "T1")
TOPICS = (GNSS_EPOCH, GNSS_EPHEMERIS, GNSS_IONOSPHERE, GNSS_OWN_POSITION)
Message = Epoch | Ephemeris | Ionosphere | OwnPosition


READER = guest("reader", "listens", reads=TOPICS)
EPOCHS = rtcm_of([epoch(TOW_S + second) for second in range(4)])
ROWS_OF_GPS = [("G03", "1C", 2.4e7), ("G04", "1C", 2.3e7)]
EPHEMERIS = framed(write_ephemeris(kepler("G05")))


def play(config: Config) -> tuple[list[tuple[float, Message]], MemoryNode]:
    """What the service puts on the bus, with the virtual time [s], until its recording ends."""

    async def main() -> tuple[list[tuple[float, Message]], MemoryNode]:
        clock = ManualClock(asyncio.get_running_loop(), NEAR_NS)
        bus = MemoryBus()
        reader, node = MemoryNode(bus, READER, TRAIN, clock), MemoryNode(bus, SERVICE, TRAIN, clock)
        arrivals = reader.arrivals(*TOPICS)
        await node.run(config)
        reader.stop()
        return [(round((one.received_ns - NEAR_NS) / 1e9, 6), one.message) async for one in arrivals], node

    return run_manual(main())


def recording(folder: Path, content: bytes, name: str = "log.bin") -> str:
    path = folder / name
    path.write_bytes(content)
    return str(path)


def test_recorded_bytes_are_played_at_their_own_pace(tmp_path: Path) -> None:
    path = recording(tmp_path, EPHEMERIS + b"".join(EPOCHS[:2]) + EPHEMERIS + b"".join(EPOCHS[2:]))
    played, node = play(Config(file=FileSource(path=path, recorded="2023-05-19"), speed=2.0))
    assert [(time_s, type(message)) for time_s, message in played] == [
        (0.0, Ephemeris),
        (0.0, Epoch),
        (0.5, Epoch),
        (1.0, Epoch),
        (1.5, Epoch),
    ]
    assert node.health.counts["epochs"] == 4
    assert node.health.counts["ephemerides_repeated"] == 1
    assert node.health.level(0.0) == ("ok", ())


def test_ubx_with_nmea_gives_epochs_and_positions(tmp_path: Path) -> None:
    stream = b"".join(rawx(ROWS, TOW_S + second) + pvt(second=20 + second) + gga() + rmc() for second in range(3))
    played, _ = play(Config(file=FileSource(path=recording(tmp_path, stream)), speed=0.0))
    kinds = [type(message) for _, message in played]
    assert kinds.count(Epoch) == 3
    positions = [message for _, message in played if isinstance(message, OwnPosition)]
    assert [one.protocol for one in positions] == ["ubx"] * 3


def test_a_navigation_file_goes_with_recorded_bytes(tmp_path: Path) -> None:
    path = recording(tmp_path, b"".join(EPOCHS))
    broadcast = recording(tmp_path, EPHEMERIS * 2, "nav.rtcm3")
    source = FileSource(path=path, recorded="2023-05-19")
    played, _ = play(Config(file=source, navigation=(broadcast,), speed=0.0))
    assert [type(message) for _, message in played] == [Ephemeris, Epoch, Epoch, Epoch, Epoch]


def test_recorded_bytes_begin_again(tmp_path: Path) -> None:
    async def main() -> dict[str, int]:
        clock = ManualClock(asyncio.get_running_loop(), NEAR_NS)
        node = MemoryNode(MemoryBus(), SERVICE, TRAIN, clock)
        source = FileSource(path=recording(tmp_path, b"".join(EPOCHS)), recorded="2023-05-19")
        running = asyncio.ensure_future(node.run(Config(file=source, repeat=True)))
        await asyncio.sleep(5.5)
        node.stop()
        await running
        return node.health.counts

    assert run_manual(main())["repetitions"] == 1


def test_what_cannot_be_read_ends_the_service(tmp_path: Path) -> None:
    with pytest.raises(RinexError, match="names the day"):
        play(Config(file=FileSource(path=recording(tmp_path, b"".join(EPOCHS)))))
    with pytest.raises(RinexError, match="holds no RTCM 3, UBX or NMEA"):
        play(Config(file=FileSource(path=recording(tmp_path, b"nothing"))))
    with pytest.raises(FileNotFoundError):
        play(Config(file=FileSource(path=str(tmp_path / "nowhere"))))


def test_a_station_in_the_stream_is_counted_only(tmp_path: Path) -> None:
    station = framed(write_station(StationPosition(7, (4_000_000.0, 0.0, 5_000_000.0))))
    source = FileSource(path=recording(tmp_path, station + b"".join(EPOCHS)), recorded="2023-05-19")
    played, node = play(Config(file=source, speed=0.0))
    assert len(played) == 4
    assert node.health.counts["station_positions"] == 1


class Script:
    """A live source that does what a list says: bytes come, nothing comes, it fails, time passes."""

    def __init__(self, *steps: bytes | SourceError | float, refusals: int = 0) -> None:
        self.name = "script"
        self.steps = list(steps)
        self.refusals = refusals
        self.now_s = 0.0
        self.closed = 0
        self.set_at_s = 0.0
        """Script's time at which the host's clock is set."""
        self.on_end: Callable[[], None] = lambda: None
        self.look: Callable[[], None] = lambda: None
        """Called when it is opened: what health says then is why."""

    def open(self) -> None:
        self.look()
        if self.refusals:
            self.refusals -= 1
            msg = "nobody answers"
            raise SourceError(msg)

    def read(self) -> bytes:
        if not self.steps:
            self.on_end()
            return b""
        step = self.steps.pop(0)
        if isinstance(step, SourceError):
            raise step
        if isinstance(step, float):
            self.now_s += step
            return b""
        return step

    def close(self) -> None:
        self.closed += 1


class ScriptClock(LiveClock):
    """The script's time, and that of the loop in its pauses."""

    def __init__(self, script: Script, loop: asyncio.AbstractEventLoop) -> None:
        self.script, self.loop = script, loop

    def monotonic_s(self) -> float:
        return self.script.now_s + self.loop.time()

    def now_ns(self) -> int:
        started_ns = NEAR_NS if self.script.now_s >= self.script.set_at_s else 0
        return started_ns + round(self.monotonic_s() * 1e9)


class Followed:
    """What came of following a script."""

    def __init__(self) -> None:
        self.heard: list[Heard] = []
        self.faults: list[str] = []
        self.counts: dict[str, int] = {}
        self.level: tuple[str, tuple[str, ...]] = ("", ())
        self.pauses_s = 0.0


def follow_script(script: Script, config: Reception | None = None) -> Followed:
    config = config or Reception(tcp=TcpSource(host="script", port=1))
    followed = Followed()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        clock = ScriptClock(script, loop)
        node = MemoryNode(MemoryBus(), SERVICE, TRAIN, clock)
        script.on_end = node.stop
        script.look = lambda: followed.faults.extend(node.health.level(clock.monotonic_s())[1])
        async for one in follow(node, config, script):
            followed.heard.append(one)
        followed.counts = node.health.counts
        followed.level = node.health.level(clock.monotonic_s())
        followed.pauses_s = loop.time()

    run_manual(main())
    return followed


def test_a_live_source_is_opened_until_it_opens() -> None:
    script = Script(b"".join(EPOCHS), refusals=3)
    followed = follow_script(script)
    assert len(followed.heard) == 4
    assert followed.faults == [f"script: nobody answers; trying again in {pause} s" for pause in (1, 2, 4)]
    assert followed.pauses_s == 7.0
    assert followed.counts["failed_openings"] == 3
    assert followed.level == ("ok", ())


@pytest.mark.parametrize("cut", range(0, len(EPOCHS[1]), 29))
def test_a_connection_that_breaks_mid_frame_is_taken_up_again(cut: int) -> None:
    script = Script(EPOCHS[0], EPOCHS[1][:cut], SourceError("it broke"), EPOCHS[2] + EPOCHS[3])
    followed = follow_script(script)
    epochs = [one for one in followed.heard if isinstance(one, Epoch)]
    whole = [one.tow_s for one in epochs if len(one.satellites) == len(epochs[0].satellites)]
    assert whole == [TOW_S, TOW_S + 2, TOW_S + 3]
    assert followed.faults == ["script: it broke; trying again in 1 s"]
    assert followed.counts["connections"] == 2
    assert script.closed == 2


def test_silence_is_a_failure() -> None:
    silent = [0.25] * 39
    script = Script(EPOCHS[0], *silent, EPOCHS[1], *silent, 0.25, EPOCHS[2])
    followed = follow_script(script)
    assert len(followed.heard) == 3
    assert followed.faults == ["script: nothing came for 10 s; trying again in 1 s"]
    assert followed.counts["connections"] == 2


def test_pauses_begin_anew_once_something_was_understood() -> None:
    lost = SourceError("gone")
    script = Script(lost, lost, EPOCHS[0], lost, EPOCHS[1])
    pauses = [fault.split("in ")[-1] for fault in follow_script(script).faults]
    assert pauses == ["1 s", "2 s", "1 s"]


def test_another_rate_of_the_line_is_told() -> None:
    script = Script(*[b"\x00\xff" * 500] * 5)
    followed = follow_script(script)
    words = "5000 bytes came without a message: check the protocol and the rate of the line"
    assert followed.level == ("degraded", (words,))
    followed = follow_script(Script(*[b"\x00\xff" * 500] * 5, EPOCHS[0]))
    assert followed.level == ("ok", ())


def test_a_wrong_rate_is_told() -> None:
    config = Reception(tcp=TcpSource(host="script", port=1), rate_hz=1.0)
    half = [step for frame in rtcm_of([epoch(TOW_S + 2 * second) for second in range(10)]) for step in (frame, 2.0)]
    followed = follow_script(Script(*half), config)
    assert followed.level == ("degraded", ("0.4 epochs per second instead of 1",))
    right = [step for frame in EPOCHS * 3 for step in (frame, 1.0)]
    assert follow_script(Script(*right), config).level == ("ok", ())


def test_raw_bytes_are_kept_as_they_come(tmp_path: Path) -> None:
    config = Reception(tcp=TcpSource(host="script", port=1), raw_log=str(tmp_path / "raw.bin"))
    stream = b"\x01" + b"".join(EPOCHS)
    follow_script(Script(stream[:100], stream[100:]), config)
    assert (tmp_path / "raw.bin").read_bytes() == stream
    broken = Reception(tcp=TcpSource(host="script", port=1), raw_log=str(tmp_path / "raw.bin" / "x"))
    followed = follow_script(Script(*EPOCHS), broken)
    assert len(followed.heard) == 4
    assert followed.level[0] == "degraded"


def test_a_receiver_that_begins_anew_goes_on() -> None:
    earlier = rtcm_of([epoch(TOW_S - 1000.0 + second) for second in range(2)])
    followed = follow_script(Script(*EPOCHS, SourceError("restarted"), *earlier))
    epochs = [one for one in followed.heard if isinstance(one, Epoch)]
    assert [one.tow_s for one in epochs] == [TOW_S + second for second in (0, 1, 2, 3, -1000, -999)]
    assert epochs[4].lock_lost.all()


def test_a_clock_that_is_set_meanwhile_dates_what_follows() -> None:
    # The host starts at 1970 and gets the time from the network after the second epoch.
    # (Without GLONASS, whose leap seconds of 1970 would part it from the others.)
    frames = rtcm_of([epoch(TOW_S + second, rows=ROWS_OF_GPS) for second in range(4)])
    script = Script(frames[0], frames[1], 1.0, frames[2], frames[3])
    script.set_at_s = 1.0
    followed = follow_script(script)
    epochs = [one for one in followed.heard if isinstance(one, Epoch)]
    assert [one.gps_week == WEEK for one in epochs] == [False, False, True, True]
    # What is dated before GPS began is refused by whoever reads it, and health had said so.
    assert all(one.gps_week < 0 for one in epochs[:2])
    assert followed.level == ("ok", ())
    script = Script(EPOCHS[0])
    script.set_at_s = 1.0
    words = "the host's clock is not set: messages that do not name their week are dated wrong"
    assert follow_script(script).level == ("degraded", (words,))


def test_a_recording_is_no_live_source() -> None:
    with pytest.raises(TypeError, match="FileSource is no live source"):
        connection(FileSource(path="x"), LiveClock())


def test_reading_waits_no_longer_than_stopping_may() -> None:
    # A service that is asked to stop must have read its last within what systemd and the supervisor allow.
    assert READ_S <= 0.5
