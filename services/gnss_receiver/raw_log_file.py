"""Bytes as they came, kept in files that take turns."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from services.byte_source.source import ByteSource


class RawLogFile:
    """Appends to a file; when it has grown to its limit, `log` becomes `log.1`, `log.1` becomes `log.2`."""

    def __init__(self, path: Path, most_bytes: int, files: int) -> None:
        """Know the place; the file is opened when something comes."""
        self._path = path
        self._most_bytes = most_bytes
        self._files = files
        self._open: BinaryIO | None = None
        self.error = ""
        """Why the last bytes could not be kept; empty when they were."""

    def append(self, chunk: bytes) -> None:
        """Append bytes at once. What cannot be kept is lost, and `error` says why."""
        try:
            if self._open is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._open = self._path.open("ab", buffering=0)
            if self._open.tell() + len(chunk) > self._most_bytes and self._open.tell():
                self._turn()
            self._open.write(chunk)
            self.error = ""
        except OSError as error:
            self.error = f"the raw log {self._path} cannot be written: {error.strerror}"
            self.close()

    def _turn(self) -> None:
        self.close()
        for number in range(self._files - 1, 0, -1):
            older = self._path.with_name(f"{self._path.name}.{number}")
            newer = self._path.with_name(f"{self._path.name}.{number - 1}") if number > 1 else self._path
            if newer.exists():
                newer.replace(older)
        if self._files == 1:
            self._path.unlink()
        self._open = self._path.open("ab", buffering=0)

    def close(self) -> None:
        """Close the file."""
        if self._open is not None:
            self._open.close()
            self._open = None


class LoggedSource:
    """A source whose bytes are kept as they come."""

    def __init__(self, source: ByteSource, log: RawLogFile) -> None:
        """Read from `source`, write to `log`."""
        self._source = source
        self.log = log

    @property
    def name(self) -> str:
        """Name of the source."""
        return self._source.name

    def open(self) -> None:
        """Open the source."""
        self._source.open()

    def read(self) -> bytes:
        """Bytes that have come, kept before they are given."""
        chunk = self._source.read()
        if chunk:
            self.log.append(chunk)
        return chunk

    def close(self) -> None:
        """Close source and log."""
        self._source.close()
        self.log.close()
