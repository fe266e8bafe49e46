"""Live receivers over real sockets and a pseudo-terminal: going, returning, refusing."""

from __future__ import annotations

import asyncio
import base64
import os
import socket
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import msgspec
import pytest

from schemas.gnss import Epoch
from schemas.topics import GNSS_EPOCH
from services.byte_source.serial_stream import SerialLine
from services.byte_source.settings import SerialSource, TcpSource
from services.byte_source.source import SourceError
from services.byte_source.tcp_socket import TcpConnection
from services.gnss_receiver.ntrip_socket import NtripConnection
from services.gnss_receiver.reception import NtripSource
from services.gnss_receiver.service import SERVICE, Config
from services.runtime.router import Router
from services.runtime.zenoh_node import ZenohNode
from tests.unit.gnss_receiver.stream_samples import TOW_S, epoch, rtcm_of
from tests.wire.stage import LIMIT_S, Stage, take, until, within

FRAMES = rtcm_of([epoch(TOW_S + second) for second in range(12)])


class Caster:
    """A TCP server that treats one client after the other as told."""

    def __init__(self, *behaviours: Callable[[socket.socket], None]) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(LIMIT_S)
        self.port: int = self._server.getsockname()[1]
        self.requests: list[bytes] = []
        self._behaviours = behaviours
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        for behaviour in self._behaviours:
            try:
                client, _ = self._server.accept()
            except OSError:
                return
            with closing(client):
                client.settimeout(LIMIT_S)
                behaviour(client)

    def request(self, client: socket.socket) -> None:
        """Read a request up to its blank line."""
        received = b""
        while not received.endswith(b"\r\n\r\n"):
            part = client.recv(1000)
            if not part:
                break
            received += part
        self.requests.append(received)

    def close(self) -> None:
        # Wakes a thread that waits for a client.
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self._thread.join(LIMIT_S)
        assert not self._thread.is_alive()


@contextmanager
def casting(*behaviours: Callable[[Caster, socket.socket], None]) -> Iterator[Caster]:
    caster: Caster
    wrapped = [lambda client, one=one: one(caster, client) for one in behaviours]
    caster = Caster(*wrapped)
    try:
        yield caster
    finally:
        caster.close()


def sends(*parts: bytes) -> Callable[[Caster, socket.socket], None]:
    """Send at once and close."""

    def behave(_: Caster, client: socket.socket) -> None:
        for part in parts:
            client.sendall(part)

    return behave


def answers(*parts: bytes) -> Callable[[Caster, socket.socket], None]:
    """Hear a request, then send and close."""

    def behave(caster: Caster, client: socket.socket) -> None:
        caster.request(client)
        for part in parts:
            client.sendall(part)

    return behave


async def run_receiver(stage: Stage, config: Config) -> tuple[ZenohNode, asyncio.Future[None]]:
    node = await stage.node("gnss_receiver", writes=SERVICE.writes)
    return node, asyncio.ensure_future(SERVICE.run(node, config))


async def test_a_server_that_goes_away_and_returns(router: Router, stage: Stage) -> None:
    del router
    reader = await stage.node("reader", reads=(GNSS_EPOCH,))
    arrivals = reader.arrivals(GNSS_EPOCH)
    first, second = b"".join(FRAMES[:3]) + FRAMES[3][:40], b"".join(FRAMES[4:])
    with casting(sends(first), sends(second), sends(second)) as caster:
        node, running = await run_receiver(stage, Config(tcp=TcpSource(host="127.0.0.1", port=caster.port)))
        epochs = [arrival.message for arrival in await take(arrivals, 10)]
        assert [one.tow_s - TOW_S for one in epochs][:4] == [0.0, 1.0, 2.0, 4.0]
        # The messages do not name their week: the host's clock does.
        assert len({one.gps_week for one in epochs}) == 1
        assert node.health.counts["connections"] == 2
        assert node.health.counts["bytes_skipped"] > 0
        node.stop()
        await within(running)


async def test_a_serial_line(router: Router, stage: Stage) -> None:
    del router
    controller, device = os.openpty()
    tty.setraw(device)
    reader = await stage.node("reader", reads=(GNSS_EPOCH,))
    arrivals = reader.arrivals(GNSS_EPOCH)
    source = SerialSource(port=os.ttyname(device))
    node, running = await run_receiver(stage, Config(serial=source))
    await until(lambda: node.health.counts.get("connections", 0) == 1)
    for frame in FRAMES[:4]:
        os.write(controller, frame[:50])
        os.write(controller, frame[50:])
    epochs = [arrival.message for arrival in await take(arrivals, 4)]
    assert [one.tow_s - TOW_S for one in epochs] == [0.0, 1.0, 2.0, 3.0]
    assert all(isinstance(one, Epoch) for one in epochs)
    os.close(controller)
    await until(lambda: any("it broke" in reason for reason in node.health.level(node.clock.monotonic_s())[1]))
    os.close(device)
    await until(lambda: node.health.counts.get("failed_openings", 0) > 0)
    node.stop()
    await within(running)


def test_a_serial_line_that_is_not_there() -> None:
    line = SerialLine("/dev/nowhere", 9600)
    with pytest.raises(SourceError, match=r"it cannot be opened: .*/dev/nowhere"):
        line.open()
    with pytest.raises(SourceError, match="the line is not open"):
        line.read()
    assert line.name == "serial /dev/nowhere at 9600 baud"


def test_a_tcp_server_that_is_not_there() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    connection = TcpConnection("127.0.0.1", port)
    with pytest.raises(SourceError, match=r"no connection: .*refused"):
        connection.open()
    with pytest.raises(SourceError, match="the connection is not open"):
        connection.read()


def drain(connection: NtripConnection) -> None:
    """Read until it fails."""
    while True:
        connection.read()


def read_all(connection: NtripConnection) -> bytes:
    """Everything until the caster ends."""
    received = b""
    connection.open()
    try:
        while True:
            received += connection.read()
    except SourceError:
        return received
    finally:
        connection.close()


STREAM = b"".join(FRAMES)
CHUNKS = b"".join(b"%x\r\n%s\r\n" % (len(frame), frame) for frame in FRAMES) + b"0\r\n\r\n"
HTTP = b"HTTP/1.1 200 OK\r\nContent-Type: gnss/data\r\n"


@pytest.mark.parametrize(
    "answer",
    [
        b"ICY 200 OK\r\n\r\n" + STREAM,
        b"ICY 200 OK\r\n" + STREAM,
        HTTP + b"\r\n" + STREAM,
        HTTP + b"Transfer-Encoding: chunked\r\n\r\n" + CHUNKS,
    ],
    ids=["version 1", "version 1 without blank line", "version 2", "version 2 in chunks"],
)
@pytest.mark.parametrize("size", [7, 100_000])
def test_streams_of_casters(answer: bytes, size: int) -> None:
    pieces = [answer[at : at + size] for at in range(0, min(len(answer), 60 * size), size)]
    pieces.append(answer[60 * size :])
    with casting(answers(*pieces)) as caster:
        source = NtripSource(host="127.0.0.1", port=caster.port, mountpoint="BASE1")
        assert read_all(NtripConnection(source)).removeprefix(b"\r\n") == STREAM
        assert b"GET /BASE1 HTTP/1.1" in caster.requests[0]


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"HTTP/1.1 401 Unauthorized\r\n\r\n", "refuses user or password for 'BASE1'"),
        (b"ERROR - Bad Password\r\n", "ERROR - Bad Password"),
        (b"SOURCETABLE 200 OK\r\n\r\nSTR;OTHER;x\r\nENDSOURCETABLE\r\n", "it has: OTHER"),
        (b"", "the caster closed the connection"),
        (HTTP, "the caster closed the connection"),
    ],
)
def test_casters_that_refuse(answer: bytes, words: str) -> None:
    with casting(answers(answer)) as caster:
        source = NtripSource(host="127.0.0.1", port=caster.port, mountpoint="BASE1")
        with pytest.raises(SourceError) as caught:
            NtripConnection(source).open()
        assert words in str(caught.value)


def test_broken_chunks_end_the_connection() -> None:
    with casting(answers(HTTP + b"Transfer-Encoding: chunked\r\n\r\n5\r\nhello\r\nnonsense\r\n")) as caster:
        connection = NtripConnection(NtripSource(host="127.0.0.1", port=caster.port, mountpoint="BASE1"))
        connection.open()
        with pytest.raises(SourceError, match="the transfer is broken"):
            drain(connection)
        connection.close()


def test_passwords_are_sent_and_never_named(tmp_path: Path) -> None:
    secret = tmp_path / "password"
    secret.write_text("hush-hush\n", "utf-8")
    with casting(answers(b"HTTP/1.1 401 Unauthorized\r\n\r\n")) as caster:
        source = NtripSource(
            host="127.0.0.1", port=caster.port, mountpoint="BASE1", version=1, user="me", password_file=str(secret)
        )
        connection = NtripConnection(source)
        with pytest.raises(SourceError) as caught:
            connection.open()
        sent = base64.b64encode(b"me:hush-hush")
        assert b"Authorization: Basic " + sent + b"\r\n" in caster.requests[0]
        for text in (str(caught.value), connection.name, repr(source)):
            assert "hush" not in text
            assert sent.decode() not in text


@pytest.mark.parametrize("place", ["password_file", "password_variable"])
def test_a_password_that_is_not_there_is_told_as_such(place: str) -> None:
    def leave(caster: Caster, client: socket.socket) -> None:
        del caster, client

    with casting(leave) as caster:
        table = {
            "host": "127.0.0.1",
            "port": caster.port,
            "mountpoint": "B",
            "user": "me",
            place: "NOT_SET",
        }
        connection = NtripConnection(msgspec.convert(table, NtripSource))
        with pytest.raises(SourceError, match="NOT_SET"):
            connection.open()


def test_casters_that_want_a_position_get_one() -> None:
    def behave(caster: Caster, client: socket.socket) -> None:
        caster.request(client)
        client.sendall(b"ICY 200 OK\r\n")
        caster.requests.append(client.recv(1000))
        client.sendall(STREAM)

    with casting(behave) as caster:
        source = NtripSource(host="127.0.0.1", port=caster.port, mountpoint="VRS")
        assert read_all(NtripConnection(source, lambda: b"$GNGGA,place\r\n")) == STREAM
        assert caster.requests[1] == b"$GNGGA,place\r\n"


async def test_a_refusing_caster_shows_in_health(router: Router, stage: Stage) -> None:
    del router
    with casting(answers(b"HTTP/1.1 401 Unauthorized\r\n\r\n")) as caster:
        source = NtripSource(host="127.0.0.1", port=caster.port, mountpoint="BASE1", position=(31.0, 121.0, 20.0))
        node, running = await run_receiver(stage, Config(ntrip=source))
        await until(lambda: node.health.counts.get("failed_openings", 0) == 1)
        await until(lambda: node.health.level(node.clock.monotonic_s())[0] == "failed")
        (reason,) = node.health.level(node.clock.monotonic_s())[1]
        assert reason.startswith(f"ntrip 127.0.0.1:{caster.port}/BASE1: the caster refuses user or password")
        node.stop()
        await within(running)
