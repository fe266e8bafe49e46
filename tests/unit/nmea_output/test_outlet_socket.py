"""The outlet over real sockets of the loopback: newcomers, leavers, the slow and the many."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from services.nmea_output.outlet_socket import MOST_WAITING, Outlet

LIMIT_S = 5.0
"""Longest wait for anything; reached only when a test fails."""


@pytest.fixture
def outlet() -> Iterator[Outlet]:
    outlet = Outlet("127.0.0.1", 0, most_clients=3)
    yield outlet
    outlet.close()


def client_of(outlet: Outlet) -> socket.socket:
    return socket.create_connection(("127.0.0.1", outlet.port), LIMIT_S)


def test_every_client_gets_everything_from_its_coming_on(outlet: Outlet) -> None:
    with client_of(outlet) as first:
        outlet.greet(b"hello ")
        outlet.send(b"one ")
        with client_of(outlet) as second:
            outlet.greet(b"hello ")
            outlet.send(b"two")
            assert read(first, 13) == b"hello one two"
            assert read(second, 9) == b"hello two"
    assert outlet.accepted == 2


def read(client: socket.socket, count: int) -> bytes:
    received = b""
    while len(received) < count:
        part = client.recv(count - len(received))
        assert part, f"the outlet closed after {received!r}"
        received += part
    return received


def test_leavers_are_noticed(outlet: Outlet) -> None:
    client = client_of(outlet)
    outlet.greet()
    assert outlet.clients == 1
    client.close()
    outlet.send(b"x")
    outlet.send(b"x")
    assert (outlet.clients, outlet.lost) == (0, 1)


def test_what_clients_say_is_not_listened_to(outlet: Outlet) -> None:
    with client_of(outlet) as client:
        outlet.greet()
        client.sendall(b"$GPGGA,attack\r\n" * 100)
        outlet.send(b"x")
        assert read(client, 1) == b"x"


def test_a_client_that_does_not_read_is_dropped_and_others_go_on(outlet: Outlet) -> None:
    with client_of(outlet) as slow, client_of(outlet) as quick:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        outlet.greet()
        block = b"z" * MOST_WAITING
        for _ in range(200):
            outlet.send(block)
            assert read(quick, len(block)) == block
            if outlet.dropped:
                break
        assert outlet.dropped == 1
        assert outlet.clients == 1


def test_too_many_are_turned_away(outlet: Outlet) -> None:
    clients = [client_of(outlet) for _ in range(4)]
    outlet.greet()
    assert (outlet.clients, outlet.refused) == (3, 1)
    for client in clients:
        client.close()


def test_a_taken_address_is_said(outlet: Outlet) -> None:
    with pytest.raises(OSError, match=r"[Aa]ddress already in use"):
        Outlet("127.0.0.1", outlet.port)
