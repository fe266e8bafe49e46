"""A whole train on a real bus: simulated sensors in, one bounded position out, while things go wrong."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import numpy as np

from schemas.line import LandmarkDatabase
from schemas.message import Message
from schemas.motion import SlipEpisode
from schemas.position import LandmarkMatch, MotionTruth, PositionEvent, TrainPosition
from schemas.topic import Place
from schemas.topics import (
    HEALTH,
    LANDMARK_MATCH,
    MOTION_TRUTH,
    POSITION_EVENT,
    SLIP_EPISODE,
    TRAIN_POSITION,
)
from services.line.alignment import alignment_of
from services.line.built_in_file import built_in_line
from services.line.landmarks import landmarks_of
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig
from services.runtime.node import Node
from services.runtime.zenoh_node import ZenohNode
from tests.wire.ports import free_port
from tests.wire.processes import Running, running, write_profile

CLI = ("-m", "services.cli")
CHAIN = ("simulator", "gnss_correction", "odometry_fusion", "landmark_matching", "train_position")
TABLES = """
[simulator]
scenario = "demo_line"
under_way_s = 40.0
[gnss_correction]
method = "robust"
compare = []
line_file = "demo"
[odometry_fusion]
imu_latency_s = 0.3
[landmark_matching]
line_file = "demo"
[train_position]
line_file = "demo"
facing = "up"
antennas = { front = {} }
"""
PATIENCE_S = 40.0
"""For anything to happen on a busy machine; a run of it all takes half of that."""
LOST_S = 8.0
STALLED = (
    "no odometry: ",
    "no inertial sensor",
    "sensors were",
    " s late: ",
)
"""A part of what is truly said when a busy machine holds a process up for more than a second."""
LEAST_POSITIONS = 200
"""Twenty seconds, from before the slide until after the restart."""


class Ear:
    """Everything that was said of the train, and by which start of a service."""

    def __init__(self) -> None:
        self.heard: list[tuple[Message, str]] = []
        self._more = asyncio.Event()

    async def listen(self, node: Node) -> None:
        async for arrival in node.arrivals(TRAIN_POSITION, MOTION_TRUTH, SLIP_EPISODE, POSITION_EVENT, anywhere=True):
            self.heard.append((arrival.message, arrival.boot_id))
            self._more.set()

    async def until(self, what: str, condition: Callable[[Message, str], bool], since: int = 0) -> int:
        """Number of the first message from `since` on that is as wished. AssertionError when none comes."""
        at = since
        try:
            async with asyncio.timeout(PATIENCE_S):
                while True:
                    while at < len(self.heard):
                        if condition(*self.heard[at]):
                            return at
                        at += 1
                    self._more.clear()
                    await self._more.wait()
        except TimeoutError:
            told = [one for one, _ in self.heard if isinstance(one, PositionEvent | SlipEpisode)]
            msg = f"not heard: {what}; {self.heard[-1:]}, {told[-6:]}"
            raise AssertionError(msg) from None

    def positions(self) -> list[TrainPosition]:
        """Positions heard so far."""
        return [one for one, _ in self.heard if isinstance(one, TrainPosition)]

    def beyond_bounds(self) -> list[TrainPosition]:
        """Positions whose bounds do not hold the true front end."""
        truths = [one for one, _ in self.heard if isinstance(one, MotionTruth)]
        t_ns = np.array([one.t_ns for one in truths])
        axis_m = np.array([one.axis_m for one in truths])
        wrong = []
        for one in self.positions():
            if one.axis_m is None or not t_ns[0] <= one.t_ns <= t_ns[-1]:
                continue
            ahead_m = float(np.interp(one.t_ns, t_ns, axis_m)) - one.axis_m
            assert one.direction == "up"
            assert one.bound_ahead_m is not None
            assert one.bound_behind_m is not None
            if not -one.bound_behind_m <= ahead_m <= one.bound_ahead_m:
                wrong.append(one)
        return wrong


@asynccontextmanager
async def beside(port: int) -> AsyncIterator[Node]:
    """A node of the train that reads the position and may speak as landmark matching."""
    topics = (TRAIN_POSITION, MOTION_TRUTH, SLIP_EPISODE, POSITION_EVENT, HEALTH)
    reader = guest("reader", "listens", reads=topics, writes=(LANDMARK_MATCH,))
    bus = BusConfig(connect=(f"tcp/127.0.0.1:{port}",))
    node = await ZenohNode.open(reader, Place("demo", "train", "T1"), "reader", LiveClock(), bus, announced=False)
    try:
        yield node
    finally:
        await node.close()


def pid_of(up: Running, child: str) -> int:
    pid: int = up.event("started", child=child)["pid"]
    return pid


def is_position(message: Message, status: str, words: str = "") -> bool:
    return isinstance(message, TrainPosition) and message.status == status and words in message.reason


def satellites_taken(message: Message) -> bool | None:
    """Whether the newest word of the satellites was taken into a position; None for other messages."""
    sources = message.sources if isinstance(message, TrainPosition) else ()
    return next((one.taken for one in sources if one.source == "gnss"), None)


async def fault(port: int, *words: str) -> None:
    """`kirotei fault` as a person types it."""
    with running(*CLI, "fault", *words, "--connect", f"tcp/127.0.0.1:{port}") as process:
        assert await asyncio.to_thread(process.ended) == 0, process.errors


def foreign_match(t_ns: int) -> LandmarkMatch:
    """A landmark of another version of the line, told as if it were met 200 m from where the train is."""
    return LandmarkMatch(
        t_ns=t_ns,
        landmark="C02-up",
        direction="up",
        accepted=True,
        reason="accepted",
        origin="",
        distance_m=0.0,
        axis_m=200.0,
        correction_m=0.0,
        bound_m=5.0,
        database_version="old",
        line_version="2019-4",
    )


async def test_the_position_holds_its_bounds_while_things_go_wrong(tmp_path: Path) -> None:
    port = free_port()
    profile = write_profile(tmp_path, port, services=CHAIN, more=TABLES)
    with running(*CLI, "up", "--profile", str(profile)) as up:
        pid = pid_of(up, "train_position")
        await asyncio.to_thread(up.event, "all_ready", patience_s=240.0)
        async with beside(port) as node:
            ear = Ear()
            listening = asyncio.create_task(ear.listen(node))
            at = await ear.until("a valid position", lambda one, _: is_position(one, "valid"))
            before = ear.heard[at][1]

            await fault(port, "slide", "--seconds", "4", "--magnitude", "4")
            await fault(port, "gnss_lost", "--seconds", str(LOST_S))
            at = await ear.until("a slip", lambda one, _: isinstance(one, SlipEpisode) and one.slip == -1, at)
            at = await ear.until("no satellites", lambda one, _: satellites_taken(one) is False, at)
            lost, at = at, await ear.until("satellites again", lambda one, _: satellites_taken(one) is True, at)
            blind = [one for one, _ in ear.heard[lost:at] if isinstance(one, TrainPosition)]
            # Ten a second; the receiver takes a moment to be without, and another to be back.
            assert len(blind) > 10 * (LOST_S - 2.0)
            reasons = [one.reason for one in blind]
            assert all(not one or any(said in one for said in STALLED) for one in reasons), set(reasons)
            # Held up just before the slip, odometry stays doubtful while the slip lasts; otherwise all is well.
            stalled = any(said in one for one in reasons for said in STALLED)
            assert stalled or set(reasons) == {""}

            os.kill(pid, signal.SIGKILL)
            at = await ear.until("a new start", lambda one, boot: isinstance(one, TrainPosition) and boot != before, at)
            restarted = ear.heard[at][0]
            assert is_position(restarted, "degraded", "restarted"), restarted
            at = await ear.until("confirmation", lambda one, _: is_position(one, "valid"), at)

            await node.publish(LANDMARK_MATCH, foreign_match(ear.heard[at][0].t_ns))
            refused = await ear.until(
                "a refusal", lambda one, _: isinstance(one, PositionEvent) and one.kind == "line_version", at
            )
            await ear.until("enough to compare", lambda _one, _boot: len(ear.positions()) > LEAST_POSITIONS)
            listening.cancel()
        up.send(signal.SIGINT)
        assert up.ended(6.0) == 0
    told = ear.heard[refused][0]
    assert isinstance(told, PositionEvent)
    assert "2019-4" in told.text
    assert ear.beyond_bounds() == []


async def test_landmarks_of_another_line_version_are_refused_with_a_reason(tmp_path: Path) -> None:
    line, port = built_in_line("demo"), free_port()
    landmarks = LandmarkDatabase(
        line=line.id,
        line_version="2019-4",
        version="old",
        origin="a survey before the works",
        landmarks=tuple(landmarks_of(alignment_of(line, ""))),
    )
    (tmp_path / "old.json").write_bytes(msgspec.json.encode(landmarks))
    more = f'[landmark_matching]\nlandmarks_file = "{tmp_path}/old.json"\n'
    profile = write_profile(tmp_path, port, services=("landmark_matching",), more=more)
    with running(*CLI, "up", "--profile", str(profile)) as up:
        await asyncio.to_thread(up.event, "all_ready", patience_s=120.0)
        async with beside(port) as node, asyncio.timeout(PATIENCE_S):
            async for health in node.messages(HEALTH):
                refusals = [one for one in health.reasons if "landmarks refused" in one]
                if health.service == "landmark_matching" and refusals:
                    break
        up.send(signal.SIGINT)
        assert up.ended(6.0) == 0
    assert "version '2019-4' of the line, it has '2026-1'" in refusals[0]
    assert health.level != "ok"
