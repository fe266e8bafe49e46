"""The circuits of a line live in a terminal, or as a log of events: what `kirotei track-circuit watch` runs."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Final, NoReturn

import msgspec
import typer
from rich.console import Console
from rich.live import Live

from schemas.message import Message
from schemas.topic import Place
from schemas.topics import TRACK_CODE, TRACK_EQUALISER, TRACK_EVENT, TRACK_OCCUPANCY, TRACK_TELEGRAM
from services.runtime.clock import LiveClock
from services.runtime.host_config import BusConfig
from services.runtime.node import Arrival, Node, Service
from services.runtime.process_end import StopSignals, end_process
from services.runtime.zenoh_config import BusConfigError
from services.runtime.zenoh_node import ZenohNode
from services.track_circuit.site_view import SiteView, render, status_line

DRAW_S: Final = 0.25
LINE_S: Final = 5.0
"""Where there is no terminal every circuit is told this often."""


class NoSettings(msgspec.Struct, frozen=True):
    """Nothing to set."""


async def log_circuits(node: Node, config: NoSettings, say: Callable[[str], object] = typer.echo) -> None:
    """Every event as a line when it comes, every circuit now and then, until stopped."""
    del config
    site = SiteView()
    async with asyncio.TaskGroup() as group:
        reading = group.create_task(_read(node, site, say))
        node.ready()
        while await node.sleep(LINE_S):
            for name in sorted(site.circuits):
                say(status_line(site.circuits[name], node.clock.monotonic_s()))
        reading.cancel()


ONLOOKER: Final = Service(
    "circuit_watch",
    NoSettings,
    reads=(TRACK_OCCUPANCY, TRACK_TELEGRAM, TRACK_CODE, TRACK_EQUALISER, TRACK_EVENT),
    writes=(),
    run=log_circuits,
    about="shows track circuits in a terminal",
)


async def _draw(node: Node, console: Console) -> None:
    """A table that is drawn anew, until stopped."""
    site = SiteView()
    async with asyncio.TaskGroup() as group:
        reading = group.create_task(_read(node, site, lambda _: None))
        node.ready()
        with Live(console=console, screen=True, auto_refresh=False) as live:
            while await node.sleep(DRAW_S):
                live.update(render(site, node.place.line, node.clock.monotonic_s()), refresh=True)
        reading.cancel()


async def _read(node: Node, site: SiteView, say: Callable[[str], object]) -> None:
    topics = (TRACK_OCCUPANCY, TRACK_TELEGRAM, TRACK_CODE, TRACK_EQUALISER)
    async with asyncio.TaskGroup() as group:
        for arrivals in (node.arrivals(*topics, anywhere=True), node.arrivals(TRACK_EVENT, anywhere=True)):
            group.create_task(_follow(node, arrivals, site, say))


async def _follow(
    node: Node, arrivals: AsyncIterator[Arrival[Message]], site: SiteView, say: Callable[[str], object]
) -> None:
    async for arrival in arrivals:
        line = site.take(arrival.fields["circuit"], arrival.message, node.clock.monotonic_s())
        if line:
            say(line)


def run_watch(place: Place, bus: BusConfig, seconds: float | None) -> NoReturn:
    """View circuits through a router until Ctrl-C or for so long; ends the process, with 1 where no bus can be."""
    code = 0
    try:
        asyncio.Runner().run(_until_stopped(place, bus, seconds))
    except BusConfigError as error:
        typer.echo(f"kirotei track-circuit watch: {error}", err=True)
        code = 1
    except BrokenPipeError:  # whoever read this has gone, as with `| head`
        pass
    end_process(code)


async def _until_stopped(place: Place, bus: BusConfig, seconds: float | None) -> None:
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    StopSignals(lambda: loop.call_soon_threadsafe(stop.set))
    working = asyncio.ensure_future(_work(place, bus))
    asked = asyncio.ensure_future(stop.wait())
    try:
        await asyncio.wait({working, asked}, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        if working.done():
            working.result()
    finally:
        working.cancel()
        asked.cancel()
        await asyncio.wait({working, asked})


async def _work(place: Place, bus: BusConfig) -> None:
    told: list[str] = []

    def waiting(reason: str) -> None:
        if not told:
            told.append(reason)
            typer.echo(f"kirotei track-circuit watch: {reason}; waiting (Ctrl-C ends)", err=True)

    node = await ZenohNode.open(ONLOOKER, place, "watch", LiveClock(), bus, on_waiting=waiting, announced=False)
    console = Console()
    try:
        if console.is_terminal:
            await _draw(node, console)
        else:
            await log_circuits(node, NoSettings())
    finally:
        await node.close()
