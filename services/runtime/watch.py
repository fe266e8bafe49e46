"""`kirotei watch`: reads fixes, truth and health off the bus and shows them in the terminal."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass
from typing import NoReturn

from rich.console import Console
from rich.live import Live

from schemas.gnss import Fix
from schemas.health import Health
from schemas.message import Message
from schemas.position import TrainTruth
from schemas.topic import Place, TopicError
from schemas.topics import (
    GNSS_COMPARISON,
    GNSS_FIX,
    HEALTH,
    LANDMARK_MATCH,
    MOTION_TRUTH,
    MOTION_WARNING,
    ODOMETRY,
    POSITION_EVENT,
    REFERENCE_PASS,
    SLIP_EPISODE,
    TRAIN_POSITION,
    TRAIN_TRUTH,
)
from services.runtime.alive import AliveChange
from services.runtime.clock import LiveClock
from services.runtime.host_config import BusConfig, Settings
from services.runtime.node import Arrival, Node, Service
from services.runtime.process_end import StopSignals, end_process
from services.runtime.watch_state import WatchState
from services.runtime.watch_summary import summary
from services.runtime.watch_view import plain_lines, render
from services.runtime.watch_words import Language
from services.runtime.zenoh_config import BusConfigError
from services.runtime.zenoh_node import ZenohNode

DRAW_S = 0.25
LINE_S = 1.0
ONCE_LISTEN_S = 2.5
"""After the first arrival, `--once` listens this long: truth and the second health report come too."""
ONCE_LIMIT_S = 10.0


class WatchConfig(Settings, frozen=True, kw_only=True):
    """How the view looks."""

    language: Language = "en"


async def _run(node: Node, config: WatchConfig, changes: AsyncIterator[AliveChange] | None = None) -> None:
    """Draw until stopped: a full screen on a terminal, else a line per method and second."""
    state = WatchState(node.place.line)
    console = Console()
    async with asyncio.TaskGroup() as group:
        reading = group.create_task(read_into(state, node), name="read")
        following = None if changes is None else group.create_task(follow_alive(state, changes), name="alive")
        node.ready()
        if console.is_terminal:
            with Live(console=console, screen=True, auto_refresh=False) as live:
                while await node.sleep(DRAW_S):
                    live.update(render(state, node.clock.monotonic_s(), config.language), refresh=True)
        else:
            while await node.sleep(LINE_S):
                for line in plain_lines(state, node.clock.monotonic_s(), config.language):
                    console.print(line, markup=False, highlight=False, soft_wrap=True)
        reading.cancel()
        if following is not None:
            following.cancel()


WATCH = Service(
    "watch",
    WatchConfig,
    reads=(
        GNSS_FIX,
        GNSS_COMPARISON,
        TRAIN_TRUTH,
        HEALTH,
        TRAIN_POSITION,
        MOTION_TRUTH,
        ODOMETRY,
        POSITION_EVENT,
        SLIP_EPISODE,
        LANDMARK_MATCH,
        REFERENCE_PASS,
        MOTION_WARNING,
    ),
    writes=(),
    run=_run,
    about="shows trains and services in a terminal",
)


async def read_into(state: WatchState, node: Node) -> None:
    """Take everything heard on the line into the state, until stopped."""
    receivers = node.arrivals(GNSS_FIX, GNSS_COMPARISON, TRAIN_TRUTH, HEALTH, anywhere=True)
    places = node.arrivals(TRAIN_POSITION, MOTION_TRUTH, ODOMETRY, anywhere=True)
    events = node.arrivals(POSITION_EVENT, SLIP_EPISODE, LANDMARK_MATCH, REFERENCE_PASS, anywhere=True)
    warnings = node.arrivals(MOTION_WARNING, anywhere=True)

    async def follow(arrivals: AsyncIterator[Arrival[Message]]) -> None:
        async for arrival in arrivals:
            take(state, arrival, node.clock.monotonic_s())

    async with asyncio.TaskGroup() as group:
        for arrivals in (receivers, places, events, warnings):
            group.create_task(follow(arrivals))


async def follow_alive(state: WatchState, changes: AsyncIterator[AliveChange]) -> None:
    """Take who lives and who was lost into the state, until stopped."""
    async for change in changes:
        state.take_alive(change.token.service, change.token.boot_id, alive=change.alive)


def take(state: WatchState, arrival: Arrival[Message], now_s: float) -> None:
    """Take one arrival into the state."""
    delay_s = (arrival.received_ns - arrival.sent_ns) / 1e9 if arrival.source else 0.0
    match arrival.message:
        case Fix() as fix:
            primary = "method" not in arrival.fields
            state.take_fix(
                arrival.place.name, arrival.fields["device"], fix, primary=primary, heard_s=now_s, delay_s=delay_s
            )
        case TrainTruth() as truth:
            state.take_truth(arrival.place.name, arrival.fields["device"], truth, now_s)
        case Health() as health:
            state.take_health(arrival.source or f"{arrival.place}/{health.service}", health, now_s, delay_s)
        case message:
            state.take_of_train(arrival.place.name, message, now_s, delay_s)


def run_watch(bus: BusConfig, line: str, *, once: bool, language: Language, as_json: bool) -> NoReturn:
    """View a line through a router until Ctrl-C, or once; ends the process.

    Exit code 0, 1 when `once` heard nothing in ten seconds, 2 for a line that cannot be.
    """
    try:
        place = Place(line, "cloud", "viewers")
    except TopicError as error:
        sys.stderr.write(f"kirotei watch: {error}\n")
        end_process(2)
    view = View(place, bus, once=once, language=language, as_json=as_json)
    code = 1
    try:
        code = asyncio.Runner().run(view.run())
    except BrokenPipeError:  # whoever read this has gone, as with `| head`
        code = 0
    except BusConfigError as error:
        sys.stderr.write(f"kirotei watch: {error}\n")
    end_process(code)


@dataclass(slots=True)
class View:
    """One viewer, from the router's answer to the last line."""

    place: Place
    bus: BusConfig
    once: bool
    language: Language
    as_json: bool
    _has_waited: bool = False

    async def run(self) -> int:
        """Exit code, once the view has ended."""
        loop = asyncio.get_running_loop()
        stop = asyncio.Event()
        StopSignals(lambda: loop.call_soon_threadsafe(stop.set))
        asked = asyncio.ensure_future(stop.wait())
        working = asyncio.ensure_future(self._work())
        try:
            await asyncio.wait({asked, working}, return_when=asyncio.FIRST_COMPLETED)
            return working.result() if working.done() else 0
        finally:
            asked.cancel()
            working.cancel()
            await asyncio.wait({working})

    async def _work(self) -> int:
        try:
            async with asyncio.timeout(ONCE_LIMIT_S if self.once else None):
                node = await ZenohNode.open(
                    WATCH, self.place, "watch", LiveClock(), self.bus, on_waiting=self._waiting, announced=False
                )
        except TimeoutError:
            return self._told(f"no router at {', '.join(self.bus.connect)} within {ONCE_LIMIT_S:g} s")
        try:
            if not self.once:
                await _run(node, WatchConfig(language=self.language), node.watch_alive(self.place.line))
                return 0
            state = await heard_at_once(node)
            now_s = node.clock.monotonic_s()
        finally:
            await node.close()
        if not (state.devices or state.services):
            return self._told(f"nothing heard on line {self.place.line} within {ONCE_LIMIT_S:g} s")
        if self.as_json:
            sys.stdout.write(json.dumps(summary(state, now_s), indent=2, ensure_ascii=False) + "\n")
        else:
            Console().print(render(state, now_s, self.language))
        return 0

    def _waiting(self, reason: str) -> None:
        if not self.once and not self._has_waited:
            self._has_waited = True
            self._told(f"{reason}; waiting (Ctrl-C ends)")

    def _told(self, text: str) -> int:
        sys.stderr.write(f"kirotei watch: {text}\n")
        return 1


async def heard_at_once(node: Node) -> WatchState:
    """What is on the line: listens for a moment after the first arrival, at most ten seconds in all."""
    state = WatchState(node.place.line)
    async with asyncio.TaskGroup() as group:
        reading = group.create_task(read_into(state, node), name="read")
        with suppress(TimeoutError):
            async with asyncio.timeout(ONCE_LIMIT_S):
                while not (state.devices or state.services) and await node.sleep(DRAW_S):
                    pass
                await node.sleep(ONCE_LISTEN_S)
        reading.cancel()
    return state
