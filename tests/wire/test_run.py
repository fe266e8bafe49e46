"""One service as a real process: how it starts, how it is watched, and every way it can end."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from schemas.topic import Place
from schemas.topics import SERVICE_EVENT
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig, RouterConfig
from services.runtime.router import open_router
from services.runtime.zenoh_node import ZenohNode
from tests.wire.ports import free_port
from tests.wire.processes import ROOT, running, write_profile

LIVES = ("-m", "tests.wire.lives")
CLI = ("-m", "services.cli")
END_S = 2.2
"""1.8 s for the hard exit, and what the operating system takes on a busy machine."""


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def profile(tmp_path: Path, port: int) -> Iterator[Path]:
    """A profile, with its router up."""
    with open_router(RouterConfig(listen=(f"tcp/127.0.0.1:{port}",))):
        yield write_profile(tmp_path, port)


async def test_a_service_that_raises_ends_with_code_1_and_tells_the_bus(profile: Path, port: int) -> None:
    reader = guest("reader", "listens", reads=(SERVICE_EVENT,))
    bus = BusConfig(connect=(f"tcp/127.0.0.1:{port}",))
    node = await ZenohNode.open(reader, Place("demo", "cloud", "test"), "reader", LiveClock(), bus, announced=False)
    told = node.arrivals(SERVICE_EVENT, anywhere=True)
    try:
        with running(*LIVES, "raises", str(profile)) as process:
            process.event("ready")
            failed = process.event("failed")
            assert process.ended(END_S) == 1
        events = [(await anext(told)).message for _ in range(2)]
    finally:
        await node.close()
    assert failed["text"] == "ValueError: the balise reader answers nonsense"
    assert "Traceback" in failed["exception"]
    assert [(event.kind, event.service) for event in events] == [("started", "raises"), ("failed", "raises")]
    assert events[1].text == failed["text"]
    assert events[0].boot_id == failed["boot"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_drains_and_ends_with_code_0(profile: Path, number: int) -> None:
    with running(*LIVES, "beat", str(profile)) as process:
        process.event("ready", service="beat", line="demo", place="train/T1")
        with pytest.raises(subprocess.TimeoutExpired):
            process.process.wait(0.5)  # long enough for a false change of level to be logged
        process.send(number)
        assert process.ended(END_S) == 0
        assert [event["event"] for event in process.events()] == ["opened", "ready", "stopping", "ended"]


def test_work_that_is_done_ends_with_code_0(profile: Path) -> None:
    with running(*LIVES, "done", str(profile)) as process:
        assert process.ended() == 0
        assert process.events()[-1]["event"] == "ended"


def test_a_blocked_loop_is_torn_down_after_a_signal(profile: Path) -> None:
    with running(*LIVES, "stuck", str(profile)) as process:
        process.event("about_to_block")
        process.send(signal.SIGTERM)
        assert process.ended(END_S) == 70


def test_a_service_that_does_not_finish_is_cut_short(profile: Path) -> None:
    with running(*LIVES, "stubborn", str(profile)) as process:
        process.event("ready")
        process.send(signal.SIGTERM)
        process.event("drain_cut_short")
        assert process.ended(END_S) in (0, 70)


def test_a_second_signal_ends_at_once(profile: Path) -> None:
    with running(*LIVES, "stubborn", str(profile)) as process:
        process.event("ready")
        process.send(signal.SIGTERM)
        process.event("stopping")
        process.send(signal.SIGTERM)
        assert process.ended(1.0) == 128 + signal.SIGTERM


def test_a_service_that_is_not_ready_in_time_ends_with_code_1(tmp_path: Path, port: int) -> None:
    profile = write_profile(tmp_path, port, more="[life]\nstart_timeout_s = 1\n")
    with open_router(RouterConfig(listen=(f"tcp/127.0.0.1:{port}",))), running(*LIVES, "slow", str(profile)) as process:
        assert process.event("failed")["text"] == "not ready after 1 s"
        assert process.ended(END_S) == 1


def test_a_router_that_comes_late_is_waited_for(tmp_path: Path, port: int) -> None:
    with running(*LIVES, "beat", str(write_profile(tmp_path, port))) as process:
        waiting = process.event("waiting_for_router")
        assert f"tcp/127.0.0.1:{port}" in waiting["text"]
        with open_router(RouterConfig(listen=(f"tcp/127.0.0.1:{port}",))):
            process.event("ready")


def test_a_signal_ends_the_wait_for_a_router(tmp_path: Path, port: int) -> None:
    with running(*LIVES, "beat", str(write_profile(tmp_path, port))) as process:
        process.event("waiting_for_router")
        process.send(signal.SIGTERM)
        assert process.ended(END_S) == 0


def test_a_second_service_of_the_same_identity_is_refused(profile: Path) -> None:
    with running(*LIVES, "beat", str(profile)) as first, running(*LIVES, "beat", str(profile)) as second:
        codes = {process: process.process.poll() for process in (first, second)}
        deadline_s = time.monotonic() + 30.0
        while None in codes.values() and set(codes.values()) == {None} and time.monotonic() < deadline_s:
            codes = {process: process.process.poll() for process in (first, second)}
        loser = next(process for process, code in codes.items() if code is not None)
        assert loser.ended() == 1
        assert any(event["event"] == "identity_taken" for event in loser.events())
        winner = second if loser is first else first
        winner.send(signal.SIGTERM)
        assert winner.ended(END_S) == 0


def test_a_log_whose_reader_has_gone_does_not_disturb_the_end(profile: Path) -> None:
    command = [sys.executable, *LIVES, "beat", str(profile)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        while '"ready"' not in process.stdout.readline():
            pass
        process.stdout.close()
        process.send_signal(signal.SIGTERM)
        assert process.wait(END_S) == 0


def test_a_dead_notify_socket_is_harmless(profile: Path, tmp_path: Path) -> None:
    with running(*LIVES, "beat", str(profile), NOTIFY_SOCKET=f"{tmp_path}/nobody", WATCHDOG_USEC="100000") as process:
        process.event("ready")
        process.send(signal.SIGTERM)
        assert process.ended(END_S) == 0


def test_the_starter_hears_ready_alive_and_stopping(profile: Path, tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind(f"{tmp_path}/notify")
        ear.settimeout(30.0)
        with running(
            *LIVES, "beat", str(profile), NOTIFY_SOCKET=f"{tmp_path}/notify", WATCHDOG_USEC="200000"
        ) as process:
            process.event("ready")
            heard = [ear.recv(1000)]
            while heard[-1] != b"READY=1":
                heard.append(ear.recv(1000))
            while heard[-1] != b"WATCHDOG=1":
                heard.append(ear.recv(1000))
            process.send(signal.SIGTERM)
            while heard[-1] != b"STOPPING=1":
                heard.append(ear.recv(1000))
            assert process.ended(END_S) == 0


def test_a_stuck_loop_does_not_feed_the_watchdog(profile: Path, tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind(f"{tmp_path}/notify")
        with running(
            *LIVES, "stuck", str(profile), NOTIFY_SOCKET=f"{tmp_path}/notify", WATCHDOG_USEC="200000"
        ) as process:
            process.event("about_to_block")
            ear.setblocking(False)  # noqa: FBT003 - the standard library's signature
            heard = 0
            while _pending(ear):
                heard += 1
            assert heard > 0
            ear.settimeout(1.0)  # ten signs of life would come in this time
            with pytest.raises(TimeoutError):
                ear.recv(1000)


def _pending(ear: socket.socket) -> bool:
    try:
        ear.recv(1000)
    except BlockingIOError:
        return False
    return True


def test_a_misspelt_setting_ends_with_code_1_and_its_path(tmp_path: Path, port: int) -> None:
    profile = write_profile(tmp_path, port, more='[simulator]\nscenaro = "street_canyon"\n')
    with running(*CLI, "run", "simulator", "--config", str(profile)) as process:
        assert process.ended() == 1
        assert [event["text"] for event in process.events()] == [
            f"{profile}: simulator.scenaro: unknown field, did you mean scenario?"
        ]


def test_a_shared_fault_or_an_unknown_service_is_told_on_one_line(tmp_path: Path, port: int) -> None:
    profile = write_profile(tmp_path, port, more="[bos]\n")
    with running(*CLI, "run", "simulator", "--config", str(profile)) as process:
        assert process.ended() == 1
        assert process.errors == [f"{profile}: bos: unknown field or service, did you mean bus?"]
    with running(*CLI, "run", "simulater", "--config", str(profile)) as process:
        assert process.ended() == 2
        assert process.errors[0].startswith("kirotei run: no service 'simulater', did you mean simulator?")


def test_a_state_folder_that_cannot_be_written_is_a_warning(profile: Path) -> None:
    with running(*LIVES, "beat", str(profile), KIROTEI__STATE_DIR=os.devnull, NUMBA_CACHE_DIR="") as process:
        assert os.devnull in process.event("state_not_kept")["text"]
        process.event("ready")
