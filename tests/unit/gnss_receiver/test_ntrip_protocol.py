"""NTRIP: requests, answers of casters of both versions, chunks."""

from __future__ import annotations

import base64

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.gnss_receiver.ntrip_protocol import ChunkDecoder, NtripError, Opened, answer, request

TABLE = b"STR;BASE1;Somewhere;RTCM 3.2;...\r\nSTR;BASE2;Elsewhere;RTCM 3.2\r\nNET;x;y\r\nENDSOURCETABLE\r\n"


def test_requests_of_both_versions() -> None:
    first = request("caster", "BASE1", 1, "me", "sécret:x")
    assert first.startswith(b"GET /BASE1 HTTP/1.0\r\nUser-Agent: NTRIP kirotei\r\nAuthorization: Basic ")
    assert first.endswith(b"\r\n\r\n")
    secret = first.split(b"Basic ")[1].split(b"\r\n")[0]
    assert base64.b64decode(secret).decode() == "me:sécret:x"
    second = request("caster", "BASE1", 2, "", "unused")
    assert second.split(b"\r\n")[:3] == [b"GET /BASE1 HTTP/1.1", b"Host: caster", b"Ntrip-Version: Ntrip/2.0"]
    assert b"Authorization" not in second


@pytest.mark.parametrize(
    ("received", "opened"),
    [
        (b"ICY 200 OK\r\n\r\n\xd3\x00", Opened(chunked=False, rest=b"\r\n\xd3\x00")),
        (b"ICY 200 OK\r\n\xd3\x00", Opened(chunked=False, rest=b"\xd3\x00")),
        (b"HTTP/1.1 200 OK\r\nContent-Type: gnss/data\r\n\r\n\xd3", Opened(chunked=False, rest=b"\xd3")),
        (b"HTTP/1.1 200 OK\r\ntransfer-encoding: Chunked\r\n\r\n5\r\n", Opened(chunked=True, rest=b"5\r\n")),
    ],
)
def test_answers_that_a_stream_follows(received: bytes, opened: Opened) -> None:
    assert answer(received, "BASE1") == opened
    line = received.index(b"\n")
    assert answer(received[:line], "BASE1") is None


@pytest.mark.parametrize(
    ("received", "words"),
    [
        (b"HTTP/1.1 401 Unauthorized\r\n\r\n", "refuses user or password for 'BASE9'"),
        (b"HTTP/1.0 403 Forbidden\r\nA: b\r\n\r\n", "refuses user or password for 'BASE9'"),
        (b"HTTP/1.1 404 Not Found\r\n\r\n", "has no mountpoint 'BASE9' "),
        (b"HTTP/1.1 503 Busy\r\n\r\n", "the caster refuses: HTTP/1.1 503 Busy"),
        (b"ERROR - Bad Password\r\n", "the caster refuses: ERROR - Bad Password; check user"),
        (b"SSH-2.0-OpenSSH_9.2\r\n", "no NTRIP caster: 'SSH-2.0-OpenSSH_9.2'"),
        (b"x" * 20_000, "its answer has no end"),
        (b"SOURCETABLE 200 OK\r\nContent-Length: 9\r\n\r\n" + TABLE, "no mountpoint 'BASE9'; it has: BASE1, BASE2"),
        (b"HTTP/1.1 200 OK\r\nContent-Type: gnss/sourcetable\r\n\r\n" + TABLE, "it has: BASE1, BASE2"),
        (b"SOURCETABLE 200 OK\r\n\r\nENDSOURCETABLE\r\n", "it has: none"),
    ],
)
def test_refusals_say_why(received: bytes, words: str) -> None:
    with pytest.raises(NtripError) as caught:
        answer(received, "BASE9")
    assert words in str(caught.value)


def test_long_tables_are_shortened() -> None:
    table = b"".join(b"STR;M%02d;x\r\n" % number for number in range(30)) + b"ENDSOURCETABLE\r\n"
    with pytest.raises(NtripError, match="M19 and 10 more"):
        answer(b"SOURCETABLE 200 OK\r\n\r\n" + table, "BASE9")


@pytest.mark.parametrize("stop", range(1, 30))
def test_answers_come_in_pieces(stop: int) -> None:
    received = b"HTTP/1.1 200 OK\r\nServer: x\r\n\r\n"
    assert (answer(received[:stop], "B") is None) == (stop < len(received))


@given(st.lists(st.binary(min_size=1, max_size=40), max_size=8), st.integers(1, 50))
def test_chunks_are_put_together_however_they_are_cut(chunks: list[bytes], size: int) -> None:
    wire = b"".join(b"%x;ext=1\r\n%s\r\n" % (len(chunk), chunk) for chunk in chunks) + b"0\r\n\r\n"
    decoder = ChunkDecoder()
    content = b"".join(decoder.feed(wire[at : at + size]) for at in range(0, len(wire), size))
    assert content == b"".join(chunks)
    assert decoder.ended


@pytest.mark.parametrize("wire", [b"xyz\r\n", b"-1\r\n", b"ffffffffff\r\n", b"no line end in these bytes", b"\r\n"])
def test_what_is_no_chunk_is_said(wire: bytes) -> None:
    with pytest.raises(NtripError, match="is no length of a chunk"):
        ChunkDecoder().feed(wire)
