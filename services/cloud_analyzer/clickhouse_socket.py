"""ClickHouse's HTTP interface: one statement, one answer, every failure one error with the server's own words."""

from __future__ import annotations

import base64
import http.client
import re
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
    _connection: http.client.HTTPConnection | None = field(default=None)

    def execute(self, sql: str, body: bytes = b"", settings: Mapping[str, str | int] | None = None) -> bytes:
        """Answer to a statement; rows to insert go into `body`. Raises ClickHouseError, UnreachableError.

        Repeated once when a kept connection has been closed meanwhile: statements of the store may be repeated.
        """
        path = "/?" + urllib.parse.urlencode({"query": sql, **(settings or {})})
        for last in (False, True):
            kept = self._connection is not None
            try:
                return self._attempt(path, body)
            except (OSError, http.client.HTTPException) as error:
                self.close()
                if last or not kept:
                    msg = f"{self.url} does not answer: {error or type(error).__name__}"
                    raise UnreachableError(msg) from error
        raise AssertionError  # the loop always ends by itself

    def _attempt(self, path: str, body: bytes) -> bytes:
        if self._connection is None:
            self._connection = self._connect()
        token = base64.b64encode(f"{self.user}:{self.password}".encode()).decode()
        self._connection.request("POST", path, body=body, headers={"Authorization": f"Basic {token}"})
        response = self._connection.getresponse()
        answer = response.read()
        if response.status != http.client.OK:
            text = answer.decode("utf-8", "replace").strip()
            found = _CODE.match(text)
            msg = f"{self.url}: {text[:500]}"
            raise ClickHouseError(msg, int(found.group(1)) if found else 0)
        return answer

    def _connect(self) -> http.client.HTTPConnection:
        parts = urllib.parse.urlsplit(self.url)
        kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
        if parts.scheme not in ("http", "https") or not parts.hostname:
            msg = f"{self.url!r} is no address of a node: write http://host:8123"
            raise StoreError(msg)
        return kind(parts.hostname, parts.port or (8443 if parts.scheme == "https" else 8123), timeout=self.timeout_s)

    def rows(self, sql: str, settings: Mapping[str, str | int] | None = None) -> list[list[Any]]:
        """Rows of a question. Raises as `execute`."""
        quoted = {"output_format_json_quote_64bit_integers": 0, **(settings or {})}
        answer = self.execute(f"{sql} FORMAT JSONCompact", settings=quoted)
        try:
            return msgspec.json.decode(answer, type=_Rows).data
        except msgspec.MsgspecError as error:
            msg = f"{self.url}: an answer that is none: {error}"
            raise ClickHouseError(msg, 0) from error

    def close(self) -> None:
        """Let go of the connection."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None


class _Rows(msgspec.Struct):
    data: list[list[Any]]
