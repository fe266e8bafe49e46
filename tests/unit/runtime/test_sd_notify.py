"""What is told to the starter of a service, and that telling never hurts."""

from __future__ import annotations

import os
import secrets
import socket
from pathlib import Path

import pytest

from services.runtime.sd_notify import Notifier


def listening(address: str) -> socket.socket:
    ear = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    ear.bind(address)
    ear.setblocking(False)  # noqa: FBT003 - the standard library's signature
    return ear


@pytest.fixture(params=["path", "abstract"])
def address(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    return str(tmp_path / "notify") if request.param == "path" else f"@kirotei-test-{secrets.token_hex(8)}"


def test_every_word_arrives(address: str) -> None:
    with listening(address.replace("@", "\0")) as ear:
        notifier = Notifier({"NOTIFY_SOCKET": address})
        notifier.ready()
        notifier.status("two\nlines")
        notifier.watchdog()
        notifier.stopping()
        notifier.failed(22)
        heard = [ear.recv(100) for _ in range(5)]
        notifier.close()
        notifier.ready()
        with pytest.raises(BlockingIOError):
            ear.recv(100)
    assert heard == [b"READY=1", b"STATUS=two lines", b"WATCHDOG=1", b"STOPPING=1", b"ERRNO=22"]


@pytest.mark.parametrize("where", ["", "@", "@nobody-listens-here", "/nonexistent/notify", "relative", "/" + "x" * 300])
def test_a_dead_or_absurd_socket_is_harmless(where: str) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": where})
    notifier.ready()
    notifier.close()


def test_a_listener_that_went_away_or_does_not_read_is_harmless(address: str) -> None:
    with listening(address.replace("@", "\0")):
        notifier = Notifier({"NOTIFY_SOCKET": address})
        for _ in range(2000):  # far more than the kernel queues
            notifier.watchdog()
    notifier.watchdog()
    notifier.close()


@pytest.mark.parametrize(
    ("environment", "watchdog_s"),
    [
        ({}, None),
        ({"WATCHDOG_USEC": "20000000"}, 20.0),
        ({"WATCHDOG_USEC": "20000000", "WATCHDOG_PID": str(os.getpid())}, 20.0),
        ({"WATCHDOG_USEC": "20000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
    ],
)
def test_the_watchdog_time_is_taken_if_it_is_meant_for_this_process(
    environment: dict[str, str], watchdog_s: float | None
) -> None:
    assert Notifier(environment).watchdog_s == watchdog_s
