"""A command that works on the bus until it is done or Ctrl-C comes."""

from __future__ import annotations

import asyncio
import sys
import traceback
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import NoReturn

import msgspec

from schemas import queries, topics
from schemas.topic import Place
from services.recorder.live_replay import OriginalAliveError
from services.recorder.recording_file import RecordingError
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig
from services.runtime.process_end import StopSignals, arm_hard_exit, end_process
from services.runtime.zenoh_config import BusConfigError
from services.runtime.zenoh_node import IdentityTakenError, ZenohNode

Work = Callable[[ZenohNode], Awaitable[int]]
"""Exit code; ends soon after the node is stopped."""


@dataclass(frozen=True, slots=True)
class BusSession:
    """What a command does on the bus, and under which name."""

    command: str
    """As it stands before messages and in the sender's mark, 'record'."""
    place: Place
    endpoint: str
    work: Work
    speaks: bool = False
    """It publishes, under an identity that only one at a time may have; otherwise it listens."""

    def run(self) -> NoReturn:
        """Work until done or asked to stop, and end the process. Exit code 2 for an endpoint that cannot be."""
        try:
            bus = msgspec.convert({"connect": [self.endpoint]}, BusConfig)
        except msgspec.ValidationError as error:
            self._tell(f"--connect {self.endpoint}: {error}")
            end_process(2)
        code = 1
        try:
            code = asyncio.Runner().run(self._live(bus))
        except (IdentityTakenError, BusConfigError, OriginalAliveError, RecordingError) as error:
            self._tell(str(error))
        except OSError as error:
            self._tell(f"{error.filename or ''}: {error.strerror or error}".removeprefix(": "))
        except Exception:  # noqa: BLE001 - a fault of ours: told in full, and an open session must not hold the process
            traceback.print_exc()
        end_process(code)

    async def _live(self, bus: BusConfig) -> int:
        loop = asyncio.get_running_loop()
        stop = asyncio.Event()
        StopSignals(lambda: loop.call_soon_threadsafe(stop.set))
        asked = asyncio.ensure_future(stop.wait())
        opening = asyncio.ensure_future(self._open(bus))
        try:
            await asyncio.wait({asked, opening}, return_when=asyncio.FIRST_COMPLETED)
            if not opening.done():
                opening.cancel()
                await asyncio.wait({opening})
                return 0
            node = opening.result()
            asked.add_done_callback(lambda task: None if task.cancelled() else node.stop())
            try:
                return await self.work(node)
            finally:
                arm_hard_exit()
                await node.close()
        finally:
            asked.cancel()

    async def _open(self, bus: BusConfig) -> ZenohNode:
        has_waited = False

        def waiting(reason: str) -> None:
            nonlocal has_waited
            if not has_waited:
                self._tell(f"{reason}; waiting (Ctrl-C ends)")
            has_waited = True

        reads, writes = ((), topics.ALL) if self.speaks else (topics.ALL, ())
        service = guest(self.command, "a command at work", reads=reads, writes=writes, asks=queries.QUERIES)
        return await ZenohNode.open(
            service, self.place, self.command, LiveClock(), bus, on_waiting=waiting, announced=self.speaks
        )

    def _tell(self, text: str) -> None:
        sys.stderr.write(f"kirotei {self.command}: {text}\n")
