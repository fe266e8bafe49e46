"""NTRIP over TLS against a caster on the loopback, with certificates made for the test."""

from __future__ import annotations

import shutil
import socket
import ssl
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from services.byte_source.source import SourceError
from services.gnss_receiver.ntrip_socket import NtripConnection
from services.gnss_receiver.reception import NtripSource
from tests.unit.gnss_receiver.stream_samples import TOW_S, epoch, rtcm_of
from tests.wire.stage import LIMIT_S

OPENSSL = shutil.which("openssl")
pytestmark = pytest.mark.skipif(OPENSSL is None, reason="no openssl to make certificates with")
STREAM = b"".join(rtcm_of(epoch(TOW_S + second) for second in range(30)))
ANSWER = b"HTTP/1.1 200 OK\r\nContent-Type: gnss/data\r\n\r\n" + STREAM


def certificate(folder: Path, name: str, subject: str) -> Path:
    """Self-signed certificate with its key in one PEM file, for one host name or address."""
    made = folder / f"{name}.pem"
    key, public = folder / f"{name}.key", folder / f"{name}.crt"
    command = [str(OPENSSL), "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    command += ["-days", "2", "-subj", f"/CN={name}", "-addext", f"subjectAltName={subject}"]
    subprocess.run([*command, "-keyout", str(key), "-out", str(public)], check=True, capture_output=True, timeout=30)
    made.write_bytes(key.read_bytes() + public.read_bytes())
    return made


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("certificates")
    subjects = {"caster": "IP:127.0.0.1", "elsewhere": "DNS:caster.example", "stranger": "IP:127.0.0.1"}
    return {name: certificate(folder, name, subject) for name, subject in subjects.items()}


@contextmanager
def caster(shown: Path | None) -> Iterator[int]:
    """Port of a caster that shows a certificate (None: speaks no TLS), answers one request and closes."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    if shown is not None:
        context.load_cert_chain(shown)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(LIMIT_S)

        def serve() -> None:
            try:
                plain, _ = server.accept()
                plain.settimeout(LIMIT_S)
                with plain if shown is None else context.wrap_socket(plain, server_side=True) as client:
                    received = client.recv(4096)
                    client.sendall(ANSWER if received.endswith(b"\r\n\r\n") else b"HTTP/1.1 400 Bad Request\r\n\r\n")
                    client.shutdown(socket.SHUT_WR)
            except OSError:
                # The client left: what the test is about.
                return

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield server.getsockname()[1]
        finally:
            thread.join(LIMIT_S)
            assert not thread.is_alive()


def connection(port: int, authority: Path | str) -> NtripConnection:
    source = NtripSource(host="127.0.0.1", port=port, mountpoint="BASE1", tls=True, authority_file=str(authority))
    return NtripConnection(source)


def refusal(port: int, authority: Path | str) -> str:
    """Why a connection cannot be opened."""
    with pytest.raises(SourceError) as caught:
        connection(port, authority).open()
    return str(caught.value)


def test_a_stream_comes_through(certificates: dict[str, Path]) -> None:
    with caster(certificates["caster"]) as port:
        source = connection(port, certificates["caster"])
        source.open()
        received = b""
        while len(received) < len(STREAM):
            received += source.read()
        assert received == STREAM
        with pytest.raises(SourceError, match=r"closed the connection|broke"):
            source.read()
        source.close()


def test_a_certificate_of_no_known_authority_is_refused(certificates: dict[str, Path]) -> None:
    with caster(certificates["caster"]) as port:
        told = refusal(port, certificates["stranger"])
    assert told.startswith("the certificate of 127.0.0.1 is refused: self-signed certificate")
    assert told.endswith("if its authority is your own, name it in authority_file")
    with caster(certificates["caster"]) as port:
        assert "self-signed certificate" in refusal(port, "")


def test_a_certificate_for_another_host_is_refused(certificates: dict[str, Path]) -> None:
    with caster(certificates["elsewhere"]) as port:
        told = refusal(port, certificates["elsewhere"])
    assert "not valid for '127.0.0.1'" in told


def test_a_caster_without_tls_is_told_as_such(certificates: dict[str, Path]) -> None:
    with caster(None) as port:
        told = refusal(port, certificates["caster"])
    assert told.startswith("no TLS with 127.0.0.1: ")
    assert told.endswith("check port and tls")


def test_an_authority_file_that_cannot_be_meant(certificates: dict[str, Path], tmp_path: Path) -> None:
    with caster(certificates["caster"]) as port:
        assert "nowhere.pem cannot be read: No such file" in refusal(port, tmp_path / "nowhere.pem")
    empty = tmp_path / "empty.pem"
    empty.write_text("no certificate\n")
    with caster(certificates["caster"]) as port:
        assert "empty.pem holds no certificate (PEM)" in refusal(port, empty)
