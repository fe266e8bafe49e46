"""A TCP server that gives the same bytes to whoever connects, and never waits for anybody."""

from __future__ import annotations

import socket
from typing import Final

MOST_CLIENTS: Final = 32
MOST_WAITING: Final = 65_536
"""Bytes that may wait for a slow client; beyond them it is dropped."""
_QUEUE: Final = 8


class Outlet:
    """Sends without blocking: `greet` lets new clients in, `send` forgets lost ones."""

    def __init__(self, host: str, port: int, most_clients: int = MOST_CLIENTS) -> None:
        """Listen. Raises OSError when the address is taken."""
        self._server = socket.create_server((host, port), backlog=_QUEUE)
        self._server.settimeout(0.0)
        self._most_clients = most_clients
        self._waiting: dict[socket.socket, bytes] = {}
        self.accepted = 0
        self.refused = 0
        """Clients turned away because there were too many."""
        self.lost = 0
        """Clients that went away."""
        self.dropped = 0
        """Clients that were too slow."""

    @property
    def port(self) -> int:
        """Port on which it listens."""
        port: int = self._server.getsockname()[1]
        return port

    @property
    def clients(self) -> int:
        """Clients connected now, as far as is known."""
        return len(self._waiting)

    def greet(self, greeting: bytes = b"") -> None:
        """Let in whoever has connected; each gets `greeting` first."""
        while True:
            try:
                client, _ = self._server.accept()
            except BlockingIOError:
                return
            except OSError:
                # The client went away before it was let in.
                continue
            if len(self._waiting) >= self._most_clients:
                client.close()
                self.refused += 1
                continue
            client.settimeout(0.0)
            self._waiting[client] = b""
            self.accepted += 1
            self._send(client, greeting)

    def send(self, content: bytes) -> None:
        """Send to every client that was let in, what does not fit at once with the next call."""
        for client in list(self._waiting):
            self._send(client, content)

    def _send(self, client: socket.socket, content: bytes) -> None:
        waiting = self._waiting[client] + content
        try:
            if self._gone(client):
                self._forget(client)
                self.lost += 1
                return
            sent = client.send(waiting) if waiting else 0
        except BlockingIOError:
            sent = 0
        except OSError:
            self._forget(client)
            self.lost += 1
            return
        self._waiting[client] = waiting[sent:]
        if len(self._waiting[client]) > MOST_WAITING:
            self._forget(client)
            self.dropped += 1

    @staticmethod
    def _gone(client: socket.socket) -> bool:
        """Whether a client has closed its end; what it says is read and forgotten."""
        try:
            return not client.recv(4096)
        except BlockingIOError:
            return False

    def _forget(self, client: socket.socket) -> None:
        del self._waiting[client]
        client.close()

    def close(self) -> None:
        """Close every connection."""
        for client in list(self._waiting):
            self._forget(client)
        self._server.close()
