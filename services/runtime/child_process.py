"""One run of a child process: its output, its readiness and signs of life, its end."""

from __future__ import annotations

import asyncio
import errno
import os
import secrets
import signal
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from services.runtime.child_output import LineSplitter
from services.runtime.process_end import SUPERVISOR_VARIABLE

CHUNK_BYTES = 65_536
OUTPUT_END_S = 0.5
"""After a process has ended its pipes are read for this long; a grandchild may hold them open."""


@dataclass(frozen=True, slots=True)
class ChildPlan:
    """What is to be run."""

    name: str
    command: tuple[str, ...]
    for_ever: bool = False
    """True when exit code 0 is no reason to stay down."""


class NotifyListener(asyncio.DatagramProtocol):
    """The listening end of sd_notify for one child, on an unguessable abstract address."""

    def __init__(self, clock_s: Callable[[], float]) -> None:
        """Hear nothing yet."""
        self._clock_s = clock_s
        self.address = f"@kirotei-{secrets.token_hex(16)}"
        self.ready = asyncio.Event()
        self.ready_at_s: float | None = None
        self.sign_of_life_s = 0.0
        self.misconfigured = False
        """The child has said that it cannot start with its configuration."""
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self) -> None:
        """Listen from now on."""
        ear = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
        ear.bind("\0" + self.address[1:])
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, sock=ear)

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Note what a child tells."""
        del addr
        lines = data.split(b"\n")
        if b"READY=1" in lines or b"WATCHDOG=1" in lines:
            self.sign_of_life_s = self._clock_s()
        if b"READY=1" in lines and self.ready_at_s is None:
            self.ready_at_s = self._clock_s()
            self.ready.set()
        if b"ERRNO=%d" % errno.EINVAL in lines:
            self.misconfigured = True

    def close(self) -> None:
        """Listen no more."""
        if self._transport is not None:
            self._transport.close()


class Child:
    """A started process. `emit(name, line, error=…)` gets every line that it prints."""

    def __init__(self, plan: ChildPlan, process: asyncio.subprocess.Process, listener: NotifyListener) -> None:
        """Use `start_child`."""
        self.plan = plan
        self.listener = listener
        self._process = process

    @property
    def pid(self) -> int:
        """Process id, which is also its process group."""
        return self._process.pid

    async def ended(self, emit: Callable[..., None]) -> int:
        """Exit code (negative: the signal that killed it), once it has ended and its output is passed on."""
        async with asyncio.TaskGroup() as group:
            pumps = [
                group.create_task(self._pump(pipe, emit, error=error))
                for pipe, error in ((self._process.stdout, False), (self._process.stderr, True))
            ]
            code = await self._process.wait()
            await asyncio.wait(pumps, timeout=OUTPUT_END_S)
            for pump in pumps:
                pump.cancel()
        self.listener.close()
        return code

    async def _pump(self, pipe: asyncio.StreamReader | None, emit: Callable[..., None], *, error: bool) -> None:
        splitter = LineSplitter()
        while pipe is not None and (chunk := await pipe.read(CHUNK_BYTES)):
            for line in splitter.take(chunk):
                emit(self.plan.name, line, error=error)
        for line in splitter.finish():
            emit(self.plan.name, line, error=error)

    def terminate(self) -> None:
        """Ask it to end."""
        with suppress(ProcessLookupError):
            self._process.terminate()

    def kill(self) -> None:
        """End it, and whatever it has started."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)


async def start_child(
    plan: ChildPlan, environment: Mapping[str, str], watchdog_s: float, clock_s: Callable[[], float]
) -> Child:
    """Start a process in a session of its own, so that a terminal's Ctrl-C does not reach it."""
    listener = NotifyListener(clock_s)
    await listener.open()
    surroundings = {name: value for name, value in environment.items() if name != "WATCHDOG_PID"}
    surroundings |= {
        "NOTIFY_SOCKET": listener.address,
        "WATCHDOG_USEC": str(round(watchdog_s * 1e6)),
        SUPERVISOR_VARIABLE: str(os.getpid()),
    }
    process = await asyncio.create_subprocess_exec(
        *plan.command,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env=surroundings,
        start_new_session=True,
    )
    return Child(plan, process, listener)
