"""ClickHouse's HTTP interface: one statement, one answer, every failure one error with the server's own words."""

from __future__ import annotations

import base64
import http.client
import re
import threading
import urllib.parse
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec

from services.cloud_analyzer.history import StoreError

_CODE: Final = re.compile(r"^Code: (\d+)[.,]")
UNREACHABLE_CODES: Final = frozenset({210, 209, 279, 198, 519})
"""Network error, socket time-out, all connection tries failed, DNS error, all replicas lost: another node is away."""


class ClickHouseError(StoreError):
    """The server refused a statement."""

    def __init__(self, text: str, code: int) -> None:
        """Keep the server's code beside its words."""
        super().__init__(text)
        self.code = code


class UnreachableError(StoreError):
    """No node of the cluster answers."""


@dataclass(slots=True)
class Node:
    """One node."""

    url: str
    user: str = "default"
    password: str = ""
    timeout_s: float = 30.0
    _kept: threading.local = field(default_factory=threading.local)
    """One connection a thread: questions are answered while batches are taken."""
    _all: list[http.client.HTTPConnection] = field(default_factory=list)

    def execute(
        self,
        sql: str,
        body: bytes = b"",
        settings: Mapping[str, str | int] | None = None,
        patience_s: float = 0.0,
    ) -> bytes:
        """Answer to a statement; rows to insert go into `body`. Raises ClickHouseError, UnreachableError.

        `patience_s`: for statements that may take longer than a node is else waited for. Repeated once when a kept
        connection has been closed meanwhile: statements of the store may be repeated.
        """
        path = "/?" + urllib.parse.urlencode({"query": sql, **(settings or {})})
        for last in (False, True):
            kept = self._connection() is not None
            try:
                return self._attempt(path, body, max(self.timeout_s, patience_s))
            except (OSError, http.client.HTTPException) as error:
                self._let_go()
                if last or not kept:
                    msg = f"{self.url} does not answer: {error or type(error).__name__}"
                    raise UnreachableError(msg) from error
        raise AssertionError  # the loop always ends by itself

    def _attempt(self, path: str, body: bytes, patience_s: float) -> bytes:
        connection = self._connection() or self._connect()
        if connection.sock is None:
            connection.connect()
        connection.sock.settimeout(patience_s)
        token = base64.b64encode(f"{self.user}:{self.password}".encode()).decode()
        connection.request("POST", path, body=body, headers={"Authorization": f"Basic {token}"})
        response = connection.getresponse()
        answer = response.read()
        if response.status != http.client.OK:
            text = answer.decode("utf-8", "replace").strip()
            found = _CODE.match(text)
            msg = f"{self.url}: {text[:500]}"
            raise ClickHouseError(msg, int(found.group(1)) if found else 0)
        return answer

    def _connection(self) -> http.client.HTTPConnection | None:
        found: http.client.HTTPConnection | None = getattr(self._kept, "connection", None)
        return found

    def _connect(self) -> http.client.HTTPConnection:
        parts = urllib.parse.urlsplit(self.url)
        kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
        if parts.scheme not in ("http", "https") or not parts.hostname:
            msg = f"{self.url!r} is no address of a node: write http://host:8123"
            raise StoreError(msg)
        port = parts.port or (8443 if parts.scheme == "https" else 8123)
        connection = self._kept.connection = kind(parts.hostname, port, timeout=self.timeout_s)
        self._all.append(connection)
        return connection

    def rows(
        self, sql: str, settings: Mapping[str, str | int] | None = None, patience_s: float = 0.0
    ) -> list[list[Any]]:
        """Rows of a question. Raises as `execute`."""
        quoted = {"output_format_json_quote_64bit_integers": 0, **(settings or {})}
        answer = self.execute(f"{sql} FORMAT JSONCompact", settings=quoted, patience_s=patience_s)
        try:
            return msgspec.json.decode(answer, type=_Rows).data
        except msgspec.MsgspecError as error:
            msg = f"{self.url}: an answer that is none: {error}"
            raise ClickHouseError(msg, 0) from error

    def _let_go(self) -> None:
        """Of this thread's connection."""
        connection = self._connection()
        if connection is not None:
            self._kept.connection = None
            self._all.remove(connection)
            connection.close()

    def close(self) -> None:
        """Let go of every connection."""
        for connection in self._all:
            connection.close()


class _Rows(msgspec.Struct):
    data: list[list[Any]]
