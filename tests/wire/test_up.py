"""`kirotei up` with real processes: starts, restarts, and leaves nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from schemas.position import TrainTruth
from schemas.topic import Place
from schemas.topics import TRAIN_TRUTH
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig, RouterConfig
from services.runtime.node import Arrival, Node
from services.runtime.router import open_router
from services.runtime.zenoh_node import ZenohNode
from tests.wire.ports import free_port
from tests.wire.processes import PATIENCE_S, ROOT, Running, alive, running, write_profile

UP = ("-m", "tests.wire.lives_up")
CLI = ("-m", "services.cli")
END_S = 4.0
"""Three seconds for services and router, and what the operating system takes on a busy machine."""


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def profile(tmp_path: Path, port: int) -> Iterator[Path]:
    """A profile whose services, by their processes, are gone at the end."""
    path = write_profile(tmp_path, port)
    yield path
    deadline_s = time.monotonic() + END_S
    left = _processes_naming(path)
    while left and time.monotonic() < deadline_s:
        left = _processes_naming(path)
    assert not left, "processes were left behind"


def _processes_naming(path: Path) -> list[int]:
    found = []
    for folder in Path("/proc").iterdir():
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if str(path).encode() in words and alive(int(folder.name)):
            found.append(int(folder.name))
    return found


@asynccontextmanager
async def listening(port: int) -> AsyncIterator[tuple[Node, AsyncIterator[Arrival[TrainTruth]]]]:
    """A reader of the line through the router at a port, and the truths that it hears."""
    reader = guest("reader", "listens", reads=(TRAIN_TRUTH,))
    bus = BusConfig(connect=(f"tcp/127.0.0.1:{port}",))
    node = await ZenohNode.open(reader, Place("demo", "cloud", "test"), "reader", LiveClock(), bus, announced=False)
    try:
        yield node, node.arrivals(TRAIN_TRUTH, anywhere=True)
    finally:
        await node.close()


def pid_of(process: Running, child: str) -> int:
    started: int = process.event("started", child=child)["pid"]
    return started


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_everything_starts_and_a_signal_stops_it_cleanly(profile: Path, number: int) -> None:
    with running(*UP, str(profile), "beat") as process:
        pids = [pid_of(process, "router"), pid_of(process, "beat")]
        ready = process.event("all_ready")
        assert ready["running"] == ["beat"]
        assert ready["at"] == "demo/train/T1"
        process.send(number)
        assert process.ended(END_S) == 0
        events = [event["event"] for event in process.events()]
        assert events[-1] == "stopped"
        assert "killed" not in events
        assert not [pid for pid in pids if alive(pid)]


def test_a_failing_service_is_restarted_with_growing_waits_while_others_run(profile: Path) -> None:
    with running(*UP, str(profile), "raises", "beat") as process:
        first = process.event("restarting", child="raises")
        second = process.event("restarting", child="raises")
        process.send(signal.SIGTERM)
        assert process.ended(END_S) == 0
        assert (first["ended"], first["in_s"], second["in_s"]) == ("exit code 1", 0.2, 0.4)
        assert not [event for event in process.events() if event["event"] == "restarting" and event["child"] == "beat"]


async def test_a_killed_service_comes_back_with_a_new_boot_id(profile: Path, port: int) -> None:
    with running(*UP, str(profile), "beat") as process:
        pid = pid_of(process, "beat")
        process.event("all_ready")
        async with listening(port) as (node, truths):
            before = await anext(truths)
            os.kill(pid, signal.SIGKILL)
            restarting = process.event("restarting", child="beat")
            async for after in truths:
                if after.boot_id != before.boot_id:
                    break
            notices = node.health.take_notices()
        assert ("input_restart", True) in [(kind, "demo/train/T1/beat restarted" in text) for kind, text in notices]
        assert restarting["ended"] == "killed by signal 9 (SIGKILL)"
        assert after.source == before.source == "demo/train/T1/beat"
        process.send(signal.SIGTERM)
        assert process.ended(END_S) == 0


async def test_a_killed_router_comes_back_and_messages_go_on(profile: Path, port: int) -> None:
    with running(*UP, str(profile), "beat") as process:
        pid = pid_of(process, "router")
        process.event("all_ready")
        async with listening(port) as (_, truths):
            before = await anext(truths)
            os.kill(pid, signal.SIGKILL)
            assert process.event("restarting", child="router")["in_s"] == 0.2
            new = pid_of(process, "router")
            killed_ns = time.time_ns()
            async for after in truths:
                if after.sent_ns > killed_ns:
                    break
        assert new != pid
        assert after.boot_id == before.boot_id
        process.send(signal.SIGTERM)
        assert process.ended(END_S) == 0


def test_no_process_outlives_a_killed_supervisor(profile: Path) -> None:
    with running(*UP, str(profile), "beat", "stuck") as process:
        process.event("all_ready")
        assert len(_processes_naming(profile)) == 4
        process.send(signal.SIGKILL)
        process.ended(END_S)
    # The profile fixture waits for the others to end, and fails if they do not.


def test_a_service_that_gives_no_sign_of_life_is_killed_and_restarted(tmp_path: Path, port: int) -> None:
    profile = write_profile(tmp_path, port, more="[life]\nwatchdog_s = 1\n")
    with running(*UP, str(profile), "stuck") as process:
        assert process.event("watchdog_killed")["child"] == "stuck"
        assert process.event("restarting")["ended"] == "killed by signal 9 (SIGKILL)"
        process.event("about_to_block")
        process.send(signal.SIGTERM)
        assert process.ended(END_S) == 0


def test_it_ends_when_all_work_is_done(profile: Path) -> None:
    with running(*UP, str(profile), "done") as process:
        process.event("done", child="done")
        process.event("all_done")
        assert process.ended(END_S) == 0


def test_it_ends_when_nobody_reads_its_output_any_more(profile: Path) -> None:
    command = [sys.executable, *UP, str(profile), "raises"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        while '"all_ready"' not in process.stdout.readline():
            pass
        process.stdout.close()
        assert process.wait(PATIENCE_S) == 0


def test_a_program_that_cannot_be_started_is_told_and_tried_again(profile: Path) -> None:
    with running(*UP, str(profile), "/nonexistent/program") as process:
        assert "No such file" in process.event("cannot_spawn")["text"]
        assert process.event("restarting")["in_s"] == 0.2
        process.event("cannot_spawn")
        process.send(signal.SIGTERM)
        assert process.ended(END_S) == 0


def test_a_taken_address_is_told_and_nothing_is_started(profile: Path, port: int) -> None:
    with (
        open_router(RouterConfig(listen=(f"tcp/127.0.0.1:{port}",))),
        running(*UP, str(profile), "beat") as process,
    ):
        assert f"tcp/127.0.0.1:{port}" in process.event("router_failed")["text"]
        assert process.ended() == 1
        assert not [event for event in process.events() if event.get("child") == "beat"]


def test_a_stock_router_is_used_where_the_profile_says_so(tmp_path: Path, port: int) -> None:
    profile = write_profile(tmp_path, port)
    profile.write_text(profile.read_text("utf-8") + "enabled = false\n", "utf-8")
    with open_router(RouterConfig(listen=(f"tcp/127.0.0.1:{port}",))), running(*UP, str(profile), "beat") as process:
        process.event("all_ready")
        process.send(signal.SIGTERM)
        assert process.ended(END_S) == 0
        assert not [event for event in process.events() if event.get("child") == "router"]


def test_every_fault_of_a_profile_is_told_and_nothing_is_left_running(tmp_path: Path, port: int) -> None:
    tables = '[simulator]\nscenaro = "x"\n[recorder]\nflush_s = -1\n'
    profile = write_profile(tmp_path, port, services=("simulator", "recorder"), more=tables)
    with running(*CLI, "up", "--profile", str(profile)) as process:
        assert process.ended() == 1
        events = process.events()
        assert not [event for event in events if event["event"] in ("opened", "restarting")]
        assert process.errors == [
            f"{profile}: simulator.scenaro: unknown field, did you mean scenario?",
            f"{profile}: recorder.flush_s: expected float >= 0.05 and <= 60, got -1",
        ]
    assert not _processes_naming(profile)


def test_a_fault_of_the_shared_part_starts_nothing(tmp_path: Path, port: int) -> None:
    profile = write_profile(tmp_path, port, services=("recorderr",))
    with running(*CLI, "up", "--profile", str(profile)) as process:
        assert process.ended() == 1
        assert process.lines == []
        assert process.errors == [f"{profile}: services[0]: no service 'recorderr', did you mean recorder?"]


def test_text_output_names_its_sender_and_how_to_subscribe(profile: Path, port: int) -> None:
    with running(*UP, str(profile), "beat", KIROTEI__LOG__FORMAT="text") as process:
        process.line_with("Stop:")
        process.send(signal.SIGINT)
        assert process.ended(END_S) == 0
    printed = "\n".join(process.lines)
    assert f"zenoh --mode client --connect tcp/127.0.0.1:{port} subscribe -k 'kirotei/v1/demo/**'" in printed
    assert any(line.startswith("beat | ") and "ready" in line for line in process.lines)
