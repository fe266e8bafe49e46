"""The demonstration of radio: a train that watches its line's radios, a bridge, and a cloud that dies meanwhile."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Final, NoReturn

from rich.console import Console

from schemas.bridge import StoreQuestion
from schemas.queries import STORE
from schemas.radio import RadioEvent
from schemas.topic import Place
from schemas.topics import BRIDGE_STATUS, RADIO_EVENT
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig
from services.runtime.node import Arrival
from services.runtime.process_end import StopSignals, end_process
from services.runtime.question import NoAnswerError, RefusedError
from services.runtime.state_dir import prepare, state_dir
from services.runtime.zenoh_node import ZenohNode

USUAL_SECONDS: Final = 150.0
START_LIMIT_S: Final = 240.0
AWAY_AFTER_S: Final = 6.0
"""After the first event the cloud is killed …"""
AWAY_S: Final = 20.0
"""… and so long it stays away."""
BACKLOG_EVERY_S: Final = 5.0
STOP_S: Final = 6.0
TRAIN, CLOUD = Place("demo", "train", "T1"), Place("demo", "cloud", "C1")
LISTENER = guest("demo", "shows a demonstration", reads=(RADIO_EVENT, BRIDGE_STATUS), asks=(STORE,))


@dataclass(slots=True)
class Host:
    """One host of the demonstration: `kirotei up` with a profile that comes with Kirotei."""

    profile: str
    environment: dict[str, str]
    log: Path
    process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it, or start it again."""
        profile = resources.files("services.runtime") / "profiles" / f"{self.profile}.toml"
        with resources.as_file(profile) as path, self.log.open("ab") as output:
            self.process = subprocess.Popen(  # noqa: S603 - our own command
                [sys.executable, "-m", "services.cli", "up", "--profile", str(path)],
                env=os.environ | self.environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def kill(self) -> None:
        """End it as a power cut does."""
        if self.process is not None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait(STOP_S)

    def stop(self) -> None:
        """Ask it to end, and see to it."""
        if self.process is None or self.process.poll() is not None:
            return
        self.process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(STOP_S)
        if self.process.poll() is None:
            self.kill()


def run_demo_radio(seconds: float | None) -> NoReturn:
    """Run both hosts and tell what happens, for `seconds`; ends the process. Exit code 1 when no event was heard."""
    console = Console()
    state = state_dir(os.environ)
    prepare(state, os.environ)
    with tempfile.TemporaryDirectory(prefix="kirotei-demo-") as folder:
        train_at, cloud_at = (f"tcp/127.0.0.1:{_free_port()}" for _ in range(2))
        train = Host("radio_train", _settings(train_at) | _bridge(cloud_at, folder), Path(folder) / "train.log")
        cloud = Host("radio_cloud", _settings(cloud_at) | _store(folder), Path(folder) / "cloud.log")
        console.print(f"Train at {train_at}, cloud at {cloud_at}. A month of passes is learned from first.")
        show = _Show(console, cloud, seconds or USUAL_SECONDS)
        try:
            cloud.start()
            train.start()
            code = asyncio.Runner().run(show.run(train_at, cloud_at))
        finally:
            for host in (train, cloud):
                host.stop()
            if not show.heard:
                for host in (train, cloud):
                    tail = host.log.read_text("utf-8", "replace").splitlines()[-12:]
                    told = [f"No event was heard. The end of {host.profile}'s log:", *tail]
                    console.print("\n".join(told), markup=False)
    end_process(code, sys.stdout)


def _settings(endpoint: str) -> dict[str, str]:
    listed = json.dumps([endpoint])
    return {"KIROTEI__ROUTER__LISTEN": listed, "KIROTEI__BUS__CONNECT": listed, "KIROTEI__LOG__FORMAT": "text"}


def _bridge(cloud_at: str, folder: str) -> dict[str, str]:
    return {
        "KIROTEI__LTE_BRIDGE__UPLINK__CONNECT": json.dumps([cloud_at]),
        "KIROTEI__LTE_BRIDGE__FOLDER": f"{folder}/bridge",
    }


def _store(folder: str) -> dict[str, str]:
    return {"KIROTEI__CLOUD_ANALYZER__FOLDER": f"{folder}/store"}


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        found: int = probe.getsockname()[1]
        return found


@dataclass(slots=True)
class _Show:
    """What is told while it runs."""

    console: Console
    cloud: Host
    seconds: float
    heard: int = 0
    away: bool = False
    _first: asyncio.Event = field(default_factory=asyncio.Event)
    _told: set[tuple[str, str, str]] = field(default_factory=set)

    async def run(self, train_at: str, cloud_at: str) -> int:
        """Exit code, once the time is over, Ctrl-C was pressed, or nothing came."""
        loop = asyncio.get_running_loop()
        stop = asyncio.Event()
        StopSignals(lambda: loop.call_soon_threadsafe(stop.set), 2 * STOP_S + 2.0)
        async with AsyncExitStack() as stack, asyncio.TaskGroup() as group:
            train = await self._open(train_at, stack)
            cloud = await self._open(cloud_at, stack)
            tasks = [
                group.create_task(self._events(train.arrivals(RADIO_EVENT, anywhere=True), "train")),
                group.create_task(self._events(cloud.arrivals(RADIO_EVENT, mirrored=True), "cloud")),
                group.create_task(self._backlog(train)),
                group.create_task(self._outage()),
            ]
            with suppress(TimeoutError):
                async with asyncio.timeout(START_LIMIT_S):
                    await asyncio.wait(
                        {asyncio.ensure_future(self._first.wait()), asyncio.ensure_future(stop.wait())},
                        return_when=asyncio.FIRST_COMPLETED,
                    )
            if self.heard and not stop.is_set():
                with suppress(TimeoutError):
                    async with asyncio.timeout(self.seconds):
                        await stop.wait()
            for task in tasks:
                task.cancel()
            if self.heard:
                await self._remembered(cloud)
        return 0 if self.heard else 1

    async def _open(self, endpoint: str, stack: AsyncExitStack) -> ZenohNode:
        bus = BusConfig(connect=(endpoint,))
        async with asyncio.timeout(START_LIMIT_S):
            node = await ZenohNode.open(
                LISTENER, Place("demo", "cloud", "viewers"), "demo", LiveClock(), bus, announced=False
            )
        stack.push_async_callback(node.close)
        return node

    def _say(self, who: str, text: str) -> None:
        self.console.print(f"{who:<6} {text}", markup=False, highlight=False, soft_wrap=True)

    async def _events(self, arrivals: AsyncIterator[Arrival[RadioEvent]], who: str) -> None:
        async for arrival in arrivals:
            event = arrival.message
            # What begins is told once for all that is one thing; what ends, each for itself.
            one = event.event_id if event.phase == "ended" else event.incident_id or event.event_id
            told = (who, one, event.phase)
            if not event.confirmed or told in self._told:
                continue
            self._told.add(told)
            self.heard += 1
            self._first.set()
            place = f"{event.section_start_m / 1000:.1f}-{event.section_end_m / 1000:.1f} km"
            if who == "train":
                what = f"{event.radio} {event.channel} {place}: {event.kind}, {event.cause}"
                what = what if event.phase == "ended" else event.incident or what
                self._say(who, f"{event.phase.replace('_', ' ')}: {what}; {event.reason}")
            else:
                late_s = (arrival.received_ns - arrival.sent_ns) / 1e9
                what = f"{event.radio} {place} {event.kind}, {event.phase}"
                self._say(who, f"has it: {what}; {late_s:.1f} s after it was said")

    async def _backlog(self, train: ZenohNode) -> None:
        told_s = 0.0
        async for arrival in train.arrivals(BRIDGE_STATUS, anywhere=True):
            status = arrival.message
            now_s = asyncio.get_running_loop().time()
            if self.away and now_s - told_s >= BACKLOG_EVERY_S:
                told_s = now_s
                self._say("bridge", f"{status.backlog_records} records wait on disk, {status.dropped_bulk} dropped")

    async def _outage(self) -> None:
        await self._first.wait()
        await asyncio.sleep(AWAY_AFTER_S)
        self._say("demo", f"kills the cloud with its store (kill -9) for {AWAY_S:.0f} s")
        self.away = True
        await asyncio.to_thread(self.cloud.kill)
        await asyncio.sleep(AWAY_S)
        self._say("demo", "starts the cloud again")
        await asyncio.to_thread(self.cloud.start)
        self.away = False

    async def _remembered(self, cloud: ZenohNode) -> None:
        question = StoreQuestion(t_ns=0, about="radio_events", limit=5000)
        try:
            answer = await cloud.ask(STORE, CLOUD, question, timeout_s=10.0, shard="all")
        except (NoAnswerError, RefusedError) as error:
            self._say("cloud", str(error))
            return
        self._say("cloud", f"remembers {len(answer.rows)} events of the radios, confirmed or not")
