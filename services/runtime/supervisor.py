"""`kirotei up`: the router and the services of a profile as child processes, kept running."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NoReturn

from services.runtime.catalogue import load_service, service_name
from services.runtime.child_output import OutputStyle
from services.runtime.child_process import Child, ChildPlan, start_child
from services.runtime.config import ConfigError, Profile
from services.runtime.logging import Logger, LogStream, configure, wants_colour, wants_json
from services.runtime.process_end import StopSignals, end_process
from services.runtime.restart_policy import RestartPolicy, exit_words
from services.runtime.state_dir import prepare, state_dir

STOP_S = 2.5
"""Services that have not ended by then are killed."""
ROUTER_STOP_S = 0.5
HARD_EXIT_S = 4.0
ROUTER = "router"


def run_supervisor(profile: Profile, plans: tuple[ChildPlan, ...]) -> NoReturn:
    """Run the profile's router and the processes of `plans` until asked to stop, and end the process.

    Exit code 0 after a clean stop or when every process has done its work, 1 when the router
    cannot open or a service cannot start with its configuration; then every fault of the
    profile is told, one per line. The services' modules are imported for that alone: a
    supervisor stays small.
    """
    stream = sys.stdout
    json = wants_json(profile.host.log, stream)
    colour = not json and wants_colour(os.environ, stream)
    # Without a reader nobody watches any more: `kirotei up | head` ends.
    lost = asyncio.Event()
    log = configure(profile.host.log, stream, colour=colour, on_lost=lost.set, service="supervisor")
    warning = prepare(state_dir(os.environ, profile.host.state_dir), os.environ)
    if warning:
        log.warning("state_not_kept", text=warning)
    style = OutputStyle(json, colour, max((len(plan.name) for plan in plans), default=0))
    environment = {**os.environ, "KIROTEI__LOG__FORMAT": "json" if json else "text"}
    if colour:
        environment["FORCE_COLOR"] = "1"
    supervisor = Supervisor(profile, plans, environment, style, LogStream(stream, lost.set), log, lost)
    code = asyncio.Runner().run(supervisor.run())
    if supervisor.misconfigured:
        sys.stderr.write("".join(f"{problem}\n" for problem in profile_problems(profile)))
    end_process(code, stream)


def profile_problems(profile: Profile) -> list[str]:
    """Everything that is wrong with the settings of the profile's services; imports them."""
    problems: list[str] = []
    for instance in profile.instances():
        try:
            profile.service_config(instance, load_service(service_name(instance)))
        except ConfigError as error:
            problems += error.problems
    return problems


def plans_of(profile: Profile) -> tuple[ChildPlan, ...]:
    """Command of every service of the profile."""
    config = () if profile.path is None else ("--config", str(profile.path))
    # -P: a folder named `services` where the user stands must not come first.
    python = (sys.executable, "-P", "-m", "services.cli", "run")
    return tuple(ChildPlan(instance, (*python, instance, *config)) for instance in profile.host.services)


def router_plan(profile: Profile) -> ChildPlan:
    """Command of the embedded router."""
    config = () if profile.path is None else (str(profile.path),)
    command = (sys.executable, "-P", "-m", "services.runtime.router_process", *config)
    return ChildPlan(ROUTER, command, for_ever=True)


@dataclass(frozen=True, slots=True)
class Ended:
    """How one run of a process ended."""

    code: int
    ready_for_s: float | None
    """How long it had been ready; None when it never was."""
    misconfigured: bool


@dataclass(slots=True)
class Supervisor:
    """Starts, watches, restarts and stops a router and services."""

    profile: Profile
    plans: tuple[ChildPlan, ...]
    environment: Mapping[str, str]
    style: OutputStyle
    stream: LogStream
    log: Logger
    stop: asyncio.Event
    """Set by whoever wants an end."""
    clock_s: Callable[[], float] = time.monotonic
    misconfigured: bool = False
    """A service could not start with its configuration, and everything was stopped."""
    _children: dict[str, Child] = field(default_factory=dict)
    _waiting: set[str] = field(default_factory=set)
    """Names that have not yet been ready or done."""
    _router_up: asyncio.Event = field(default_factory=asyncio.Event)
    _code: int = 0

    async def run(self) -> int:
        """Exit code, once everything has ended."""
        loop = asyncio.get_running_loop()
        StopSignals(lambda: loop.call_soon_threadsafe(self.stop.set), HARD_EXIT_S)
        loop.add_signal_handler(signal.SIGHUP, self.stop.set)
        self._waiting = {plan.name for plan in self.plans}
        try:
            async with asyncio.TaskGroup() as group:
                router = await self._start_router(group)
                services = [group.create_task(self._keep(plan), name=plan.name) for plan in self.plans]
                if not self.stop.is_set():
                    await self._until_stopped_or_done(services)
                self.stop.set()
                await self._stop_children(services, STOP_S)
                if router is not None:
                    await self._stop_children([router], ROUTER_STOP_S)
        finally:
            for child in self._children.values():  # only after a fault of the supervisor itself
                child.kill()
        self.log.info("stopped")
        return self._code

    async def _start_router(self, group: asyncio.TaskGroup) -> asyncio.Task[None] | None:
        """Task that keeps the router, once it listens or could not; None where none is wanted."""
        if not self.profile.host.router.enabled:
            return None
        self._waiting.add(ROUTER)
        router = group.create_task(self._keep(router_plan(self.profile)), name=ROUTER)
        async with asyncio.TaskGroup() as waits:
            either = {waits.create_task(event.wait()) for event in (self._router_up, self.stop)}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            for wait in either:
                wait.cancel()
        return router

    async def _until_stopped_or_done(self, services: list[asyncio.Task[None]]) -> None:
        async with asyncio.TaskGroup() as group:
            stop = group.create_task(self.stop.wait(), name="stop")
            left = set(services)
            while left and not stop.done():
                done, _ = await asyncio.wait({stop, *left}, return_when=asyncio.FIRST_COMPLETED)
                left -= done
            if not left and services and not stop.done():
                self.log.info("all_done")
            elif not services:
                await stop
            stop.cancel()

    async def _keep(self, plan: ChildPlan) -> None:
        """Keep one process running until it is done or everything stops."""
        policy = RestartPolicy(restart_when_done=plan.for_ever)
        while not self.stop.is_set():
            ended = await self._run_once(plan)
            if self.stop.is_set():
                return
            if plan.name in self._waiting and (plan.name == ROUTER or ended.misconfigured):
                self.misconfigured = ended.misconfigured
                self.log.error("cannot_start", child=plan.name, text=exit_words(ended.code))
                self._code = 1
                self.stop.set()
                return
            wait_s = policy.after_exit(ended.code, ended.ready_for_s)
            if wait_s is None:
                self.log.info("done", child=plan.name)
                self._arrived(plan.name)
                return
            self.log.warning(
                "restarting", child=plan.name, ended=exit_words(ended.code), in_s=wait_s, restarts=policy.restarts
            )
            with suppress(TimeoutError):
                async with asyncio.timeout(wait_s):
                    await self.stop.wait()

    async def _run_once(self, plan: ChildPlan) -> Ended:
        """Start a process and wait for its end."""
        try:
            child = await start_child(plan, self.environment, self.profile.host.life.watchdog_s, self.clock_s)
        except OSError as error:  # no memory, no process or file left, no such program
            self.log.error("cannot_spawn", child=plan.name, text=str(error))  # noqa: TRY400 - the words say all
            return Ended(1, None, misconfigured=False)
        self._children[plan.name] = child
        self.log.info("started", child=plan.name, pid=child.pid)
        if self.stop.is_set():
            child.terminate()
        async with asyncio.TaskGroup() as group:
            watching = group.create_task(self._watch(child), name=f"watch {plan.name}")
            code = await child.ended(self._emit)
            watching.cancel()
        del self._children[plan.name]
        since_s = child.listener.ready_at_s
        ready_for_s = None if since_s is None else self.clock_s() - since_s
        return Ended(code, ready_for_s, child.listener.misconfigured)

    async def _watch(self, child: Child) -> None:
        """Tell when a child is ready, and kill it when it gives no sign of life any more."""
        await child.listener.ready.wait()
        self._arrived(child.plan.name)
        limit_s = self.profile.host.life.watchdog_s
        while True:
            left_s = child.listener.sign_of_life_s + limit_s - self.clock_s()
            if left_s <= 0.0:
                break
            await asyncio.sleep(left_s)
        self.log.error("watchdog_killed", child=child.plan.name, text=f"no sign of life for {limit_s:g} s")
        child.kill()

    def _arrived(self, name: str) -> None:
        if name == ROUTER:
            self._router_up.set()
        if name not in self._waiting:
            return
        self._waiting.discard(name)
        if not self._waiting and not self.stop.is_set():
            self._announce()

    def _announce(self) -> None:
        host = self.profile.host
        endpoint = (host.router.listen if host.router.enabled else host.bus.connect)[0]
        command = (
            f"zenoh --mode client --connect {endpoint} subscribe -k 'kirotei/v1/{host.place.line}/**' "
            "--decoder kirotei --line '{key} {value}'"
        )
        self.log.info("all_ready", running=[plan.name for plan in self.plans], at=str(host.place.place()))
        if not self.style.json:
            self._write(f"\n  Running at {host.place.place()}: {', '.join(plan.name for plan in self.plans)}")
            self._write(f"  Watch:      kirotei watch --connect {endpoint} --line {host.place.line}")
            self._write(f"  Subscribe:  {command}")
            self._write("  Stop:       Ctrl-C\n")

    async def _stop_children(self, keepers: list[asyncio.Task[None]], within_s: float) -> None:
        names = {task.get_name() for task in keepers}
        for name in names & self._children.keys():
            self._children[name].terminate()
        if keepers:
            await asyncio.wait(keepers, timeout=within_s)
        for name in names & self._children.keys():
            self.log.warning("killed", child=name, text=f"did not end within {within_s:g} s")
            self._children[name].kill()

    def _emit(self, name: str, line: bytes, *, error: bool) -> None:
        self._write(self.style.dressed(name, line, error=error))

    def _write(self, text: str) -> None:
        self.stream.write(text + "\n")
        self.stream.flush()
