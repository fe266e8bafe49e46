"""A file that wears `.part` until it is complete, and survives a full disk.

Bytes are gathered in memory and committed in one go. A commit that fails (disk full) takes
back what it had begun, so that the file on disk always ends where an earlier commit ended,
and may be tried again.
"""

from __future__ import annotations

import os
from pathlib import Path


class PartFile:
    """Sink of a RecordingWriter on a local disk. Every method but `write` and `tell` may raise OSError."""

    def __init__(self, final: Path, *, fsync: bool = False, overwrite: bool = False) -> None:
        """Create `final` with `.part` appended.

        Unless `overwrite`, raises FileExistsError when that is there already. With `fsync`
        every commit waits until the disk has the bytes.
        """
        self.final = final
        self.part = final.with_name(final.name + ".part")
        self._fsync = fsync
        self._raw = self.part.open("wb" if overwrite else "xb", buffering=0)
        self._pending = bytearray()
        self._committed = 0

    def write(self, octets: bytes, /) -> int:
        """Take bytes into memory."""
        self._pending += octets
        return len(octets)

    def tell(self) -> int:
        """Bytes taken so far, committed or not."""
        return self._committed + len(self._pending)

    def flush(self) -> None:
        """Nothing: the owner decides when to `commit`, and what to do when that fails."""

    @property
    def pending_bytes(self) -> int:
        """Bytes taken and not yet committed."""
        return len(self._pending)

    def commit(self) -> None:
        """Write what was taken. When that fails the file is as before, and so is what is pending."""
        try:
            with memoryview(self._pending) as pending:
                written = 0
                while written < len(pending):
                    written += self._raw.write(pending[written:])
            if self._fsync:
                os.fsync(self._raw.fileno())
        except OSError:
            self._raw.truncate(self._committed)
            self._raw.seek(self._committed)
            raise
        self._committed += len(self._pending)
        self._pending.clear()

    def complete(self) -> None:
        """Commit, close, and take `.part` off the name."""
        self.commit()
        self._raw.close()
        self.part.replace(self.final)
        if self._fsync:
            folder = os.open(self.final.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def leave(self) -> None:
        """Close and leave what was committed under its `.part` name, to be repaired later."""
        self._raw.close()

    def discard(self) -> None:
        """Close and delete."""
        self._raw.close()
        self.part.unlink(missing_ok=True)
