"""The demonstration: a whole host as child processes, and the live view in front of it."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import subprocess
import sys
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import NoReturn

from rich.console import Console
from rich.live import Live

from schemas.topic import Place
from services.runtime.clock import LiveClock
from services.runtime.host_config import BusConfig
from services.runtime.process_end import StopSignals, end_process
from services.runtime.state_dir import prepare, state_dir
from services.runtime.terminal_picture import save_picture
from services.runtime.watch import DRAW_S, WATCH, follow_alive, read_into
from services.runtime.watch_state import WatchState
from services.runtime.watch_view import plain_lines, render
from services.runtime.watch_words import Language
from services.runtime.zenoh_node import ZenohNode

USUAL_PORT = 7447
PIPE_SECONDS = 60.0
"""How long the demonstration runs when nobody sits at a terminal."""
PLAIN_S = 5.0
START_LIMIT_S = 240.0
"""Without a position by then something is wrong (kernels compile at the very first start)."""
STOP_S = 6.0


def run_demo(seconds: float | None, language: Language, picture: Path | None = None) -> NoReturn:
    """Run the embedded demo profile behind the live view; ends the process.

    Until Ctrl-C, or for `seconds`; exit code 1 when no position was seen. The last view is saved as
    `picture` (SVG).
    """
    console = Console()
    if seconds is None and not console.is_terminal:
        seconds = PIPE_SECONDS
    state = state_dir(os.environ)
    prepare(state, os.environ)
    log = (state if os.access(state, os.W_OK) else Path(os.environ["NUMBA_CACHE_DIR"])) / "demo.log"
    endpoint = f"tcp/127.0.0.1:{_port()}"
    environment = os.environ | {
        "KIROTEI__ROUTER__LISTEN": json.dumps([endpoint]),
        "KIROTEI__BUS__CONNECT": json.dumps([endpoint]),
        "KIROTEI__LOG__FORMAT": "text",
    }
    console.print(f"Starting router, simulated train and its services at {endpoint}; their log: {log}", soft_wrap=True)
    if not any(Path(os.environ["NUMBA_CACHE_DIR"]).iterdir()):
        console.print("The first start compiles the numerical kernels: about a minute, once.")
    with log.open("wb") as output:
        up = subprocess.Popen(
            [sys.executable, "-m", "services.cli", "up"],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    code = 1
    try:
        code = asyncio.Runner().run(_show(console, up, endpoint, seconds, language, picture))
    finally:
        up.terminate()
        with suppress(subprocess.TimeoutExpired):
            up.wait(STOP_S)
        if up.returncode is None:
            up.kill()
        if code:
            tail = log.read_text("utf-8", "replace").splitlines()[-12:]
            console.print("\n".join(["No position was heard. The end of the log:", *tail]), markup=False)
    end_process(code, sys.stdout)


def _port() -> int:
    """The usual port when it is free, else any other."""
    for port in (USUAL_PORT, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with suppress(OSError):
                probe.bind(("127.0.0.1", port))
                found: int = probe.getsockname()[1]
                return found
    msg = "no free TCP port on 127.0.0.1"
    raise OSError(msg)


async def _show(
    console: Console,
    up: subprocess.Popen[bytes],
    endpoint: str,
    seconds: float | None,
    language: Language,
    picture: Path | None,
) -> int:
    """Exit code, once the time is over, Ctrl-C was pressed, or nothing came."""
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    StopSignals(lambda: loop.call_soon_threadsafe(stop.set), STOP_S + 2.0)
    place = Place("demo", "cloud", "viewers")
    view = WatchState(place.line)
    async with asyncio.TaskGroup() as group:
        opening = group.create_task(
            ZenohNode.open(WATCH, place, "watch", LiveClock(), BusConfig(connect=(endpoint,)), announced=False)
        )
        stopped = group.create_task(stop.wait())
        await asyncio.wait({opening, stopped}, timeout=START_LIMIT_S, return_when=asyncio.FIRST_COMPLETED)
        stopped.cancel()
        if not opening.done():
            opening.cancel()
            return 1
        node = opening.result()
        reading = group.create_task(read_into(view, node))
        following = group.create_task(follow_alive(view, node.watch_alive(place.line)))
        try:
            await _draw(console, node, view, up, stop, seconds, language)
        finally:
            reading.cancel()
            following.cancel()
            now_s = node.clock.monotonic_s()
            await node.close()
    console.print(render(view, now_s, language))
    if picture is not None:
        save_picture(render(view, now_s, language), "kirotei demo", picture)
    heard = _heard(view)
    if heard:
        console.print("Do it by hand: `kirotei up` in one terminal, `kirotei watch` in another.", markup=False)
    return 0 if heard else 1


async def _draw(
    console: Console,
    node: ZenohNode,
    view: WatchState,
    up: subprocess.Popen[bytes],
    stop: asyncio.Event,
    seconds: float | None,
    language: Language,
) -> None:
    """Draw until stopped, until `seconds` after the first position, or until it is plain that none will come."""
    started_s = node.clock.monotonic_s()
    first_s: float | None = None
    live = Live(console=console, screen=True, auto_refresh=False) if console.is_terminal else None
    drawn_s = started_s
    with live or nullcontext():
        while not stop.is_set() and up.poll() is None:
            await node.sleep(DRAW_S)
            now_s = node.clock.monotonic_s()
            if first_s is None and _heard(view):
                first_s = now_s
            if first_s is None and now_s - started_s > START_LIMIT_S:
                return
            if first_s is not None and seconds is not None and now_s - first_s >= seconds:
                return
            if live is not None:
                live.update(render(view, now_s, language), refresh=True)
            elif now_s - drawn_s >= PLAIN_S:
                drawn_s = now_s
                for line in plain_lines(view, now_s, language):
                    console.print(line, markup=False, highlight=False, soft_wrap=True)


def _heard(view: WatchState) -> bool:
    """Whether some train has told a place."""
    return any(train.position is not None and train.position.axis_m is not None for train in view.trains.values())
