"""The life of one service process: open, ready, run, drain, close."""

from __future__ import annotations

import asyncio
import errno
import math
import os
import sys
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NoReturn, TextIO, TypeVar

import msgspec

from services.runtime.clock import LiveClock
from services.runtime.config import ConfigError, Profile
from services.runtime.logging import Logger, configure, guard_stdout, wants_colour
from services.runtime.node import Service
from services.runtime.process_end import (
    DRAIN_S,
    HARD_EXIT_S,
    StopSignals,
    arm_hard_exit,
    end_process,
    end_with_supervisor,
)
from services.runtime.sd_notify import Notifier
from services.runtime.service_report import Kind, ServiceReport
from services.runtime.state_dir import prepare, state_dir
from services.runtime.zenoh_config import BusConfigError
from services.runtime.zenoh_node import IdentityTakenError, ZenohNode

T = TypeVar("T")
LAST_WORDS_S = 0.25
"""At most this long is waited for the bus to take an event while the service is ending."""
CLOSING_MARGIN_S = 0.1
"""What is left after closing to flush the log and leave by the exit code."""


def run_service(load: Callable[[], Service[Any]], profile: Profile, instance: str) -> NoReturn:
    """Run a service until it ends, and end the process.

    `load` is called once it is settled where compiled kernels are kept. Exit code 0 when the
    work is done or it was asked to stop, 1 when it failed (bad configuration, identity taken,
    not ready in time, an exception), 70 when it had to be torn down.
    """
    end_with_supervisor(os.environ)
    terminal = sys.stdout
    colour = wants_colour(os.environ, terminal)
    stream = guard_stdout() if profile.host.log.format == "json" or not terminal.isatty() else terminal
    place = profile.host.place
    log = configure(
        profile.host.log, stream, colour=colour, service=instance, line=place.line, place=f"{place.kind}/{place.name}"
    )
    warning = prepare(state_dir(os.environ, profile.host.state_dir), os.environ)
    if warning:
        log.warning("state_not_kept", text=warning)
    notifier = Notifier(os.environ)
    try:
        service = load()
        config = profile.service_config(instance, service)
    except ConfigError as error:
        for problem in error.problems:
            log.error("config_invalid", text=problem)  # noqa: TRY400 - the fault is the file's, no traceback helps
        notifier.failed(errno.EINVAL)
        end_process(1, stream)
    except Exception:  # whatever an import can raise ends the process, with its traceback in the log
        log.exception("load_failed")
        end_process(1, stream)
    _run_to_the_end(Life(service, config, profile, instance, log, notifier), stream)


def _run_to_the_end(life: Life, stream: TextIO) -> NoReturn:
    code = 1
    try:
        # Not closed: closing waits for threads, which may be blocked.
        code = asyncio.Runner().run(life.run())
    except BaseException:  # the process ends here, by the exit code
        life.log.exception("runtime_failed")
    end_process(code, stream)


@dataclass(slots=True)
class Life:
    """One service from open to close."""

    service: Service[Any]
    config: msgspec.Struct
    profile: Profile
    instance: str
    log: Logger
    notifier: Notifier
    _waiting: str = ""
    """Why there is no router yet, as last told."""
    _end_by_s: float = math.inf
    """Loop time before which closing must be over, or the process is torn down."""

    async def run(self) -> int:
        """Exit code, once the service has ended."""
        loop = asyncio.get_running_loop()
        stop = asyncio.Event()
        StopSignals(lambda: loop.call_soon_threadsafe(stop.set))
        async with asyncio.TaskGroup() as group:
            asked = group.create_task(stop.wait(), name="stop signal")
            alive = group.create_task(self._feed_watchdog(), name="watchdog")
            try:
                node = await self._open(group, asked)
                return 0 if node is None else await self._live(node, group, asked)
            except IdentityTakenError as error:
                self.log.error("identity_taken", text=str(error))  # noqa: TRY400 - the words say all
                return 1
            except BusConfigError as error:
                self.log.error("config_invalid", text=str(error))  # noqa: TRY400 - the words say all
                self.notifier.failed(errno.EINVAL)
                return 1
            finally:
                asked.cancel()
                alive.cancel()

    async def _open(self, group: asyncio.TaskGroup, asked: asyncio.Task[Any]) -> ZenohNode | None:
        """Node on the bus, however long that takes; None when asked to stop meanwhile."""
        bus = self.profile.host.bus
        self.notifier.status(f"connecting to {', '.join(bus.connect)}")
        place = self.profile.host.place.place()
        node_of = ZenohNode.open(self.service, place, self.instance, LiveClock(), bus, on_waiting=self._note_waiting)
        opening = group.create_task(_outcome(node_of), name="open")
        await asyncio.wait({opening, asked}, return_when=asyncio.FIRST_COMPLETED)
        if not opening.done():
            opening.cancel()
            return None
        node, error = opening.result()
        if error is not None:
            raise error
        return node

    def _note_waiting(self, reason: str) -> None:
        if reason != self._waiting:
            self._waiting = reason
            self.log.warning("waiting_for_router", text=reason)
            self.notifier.status(reason)

    def _must_end(self) -> None:
        """Start the countdown to the end, if it does not run already."""
        if math.isinf(self._end_by_s):
            arm_hard_exit()
            self._end_by_s = asyncio.get_running_loop().time() + HARD_EXIT_S - CLOSING_MARGIN_S

    async def _live(self, node: ZenohNode, group: asyncio.TaskGroup, asked: asyncio.Task[Any]) -> int:
        self.log = self.log.bind(boot=node.health.boot_id)
        self.log.info("opened", router=", ".join(self.profile.host.bus.connect))
        node.health.set("starting", "starting: not ready yet")
        report = ServiceReport(node, note=lambda kind, text: self.log.warning(kind, text=text))
        reporting = group.create_task(report.run(), name="health")
        work = group.create_task(_outcome(self.service.run(node, self.config)), name=self.instance)
        try:
            if not await self._start(node, report, group, {work, asked}):
                return await self._fail(report, f"not ready after {self.profile.host.life.start_timeout_s:g} s")
            await asyncio.wait({work, asked}, return_when=asyncio.FIRST_COMPLETED)
            if not work.done():
                await self._drain(node, report, work)
            _, error = work.result() if work.done() else (None, None)
            if error is not None:
                return await self._fail(report, f"{type(error).__name__}: {error}", error)
            if not report.started and not asked.done():
                self.notifier.ready()  # it has done its work before it could say that it was ready
            self.log.info("ended", asked=asked.done())
            return 0
        finally:
            self._must_end()
            work.cancel()
            reporting.cancel()
            with suppress(TimeoutError):
                async with asyncio.timeout_at(self._end_by_s):
                    await node.close()

    async def _start(
        self, node: ZenohNode, report: ServiceReport, group: asyncio.TaskGroup, ends: set[asyncio.Task[Any]]
    ) -> bool:
        """Wait until the service is ready or one of `ends` has come; False when neither came in time."""
        self.notifier.status("starting")
        ready = group.create_task(node.wait_ready(), name="ready")
        timeout_s = self.profile.host.life.start_timeout_s
        done, _ = await asyncio.wait({ready, *ends}, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        ready.cancel()
        if not done:
            return False
        if ready in done:
            node.health.clear("starting")
            self.log.info("ready")
            self.notifier.ready()
            self.notifier.status("running")
            await report.look()  # being ready is no change of level
            await self._tell(report, "started", self.service.about)
            report.started = True
        return True

    async def _drain(self, node: ZenohNode, report: ServiceReport, work: asyncio.Task[Any]) -> None:
        self._must_end()
        self.log.info("stopping")
        self.notifier.stopping()
        report.started = False
        await self._tell(report, "stopping", "asked to stop")
        node.stop()
        await asyncio.wait({work}, timeout=DRAIN_S - LAST_WORDS_S)
        if not work.done():
            self.log.warning("drain_cut_short", text=f"{self.instance} did not finish within {DRAIN_S:g} s")
            work.cancel()

    async def _fail(self, report: ServiceReport, text: str, error: BaseException | None = None) -> int:
        self._must_end()
        self.log.error("failed", text=text, exc_info=error)
        self.notifier.status(f"failed: {text}")
        report.node.health.set("failed", text, "failed")
        await self._tell(report, "failed", text)
        with suppress(TimeoutError):
            async with asyncio.timeout(LAST_WORDS_S):
                await report.look()
        return 1

    async def _tell(self, report: ServiceReport, kind: Kind, text: str) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout(LAST_WORDS_S):
                await report.event(kind, text)

    async def _feed_watchdog(self) -> None:
        """Signs of life from the event loop itself, so that a stuck loop is noticed."""
        if self.notifier.watchdog_s is None:
            return
        while True:
            self.notifier.watchdog()
            await asyncio.sleep(self.notifier.watchdog_s / 2)


async def _outcome(work: Awaitable[T]) -> tuple[T | None, Exception | None]:
    """Result of `work`, or the exception that ended it."""
    try:
        return await work, None
    except Exception as error:  # noqa: BLE001 - what a service raises is judged by its life cycle
        return None, error
