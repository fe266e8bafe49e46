"""A folder of recordings: one file after the other, rotated, capped, and going on after a full disk."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from services.recorder.file_names import DAMAGED_SUFFIX, SUFFIX, beyond_cap, is_own, is_own_part, recording_stem
from services.recorder.mcap_file import ChannelsExhaustedError, Compression, RecordingWriter, is_recordable
from services.recorder.part_file import PartFile
from services.recorder.repaired_file import repair
from services.runtime.node import Sample

NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT})
COMMIT_BYTES = 4 * 1024 * 1024
"""More than this is not held back until the next flush."""


class FolderInUseError(RuntimeError):
    """Another recorder writes into this folder."""


@dataclass(frozen=True, slots=True)
class StoreSettings:
    """How a folder is kept."""

    folder: Path
    rotate_bytes: int
    rotate_ns: int | None
    """A file ends when a message comes this long after its first."""
    keep_bytes: int | None
    """The oldest own recordings go so that all of them, and the next at its full size, stay within this."""
    resume_free_bytes: int
    """After a full disk recording goes on when this much is free."""
    compression: Compression
    fsync: bool


@dataclass(slots=True)
class _Open:
    """The file being written."""

    part: PartFile
    writer: RecordingWriter
    first_ns: int
    uncommitted: int = 0
    ended: bool = False
    """Index and footer are written, though perhaps not committed."""

    def commit(self) -> None:
        self.part.commit()
        self.uncommitted = 0

    def complete(self) -> None:
        if not self.ended:
            self.writer.finish()
            self.ended = True
        self.part.complete()
        self.uncommitted = 0


class RecordingStore:
    """Writes samples into a folder. No trouble with the disk raises after `open`; it is told by `fault`.

    While there is a fault samples are counted as lost, and every `flush` tries to go on: what
    was held back is written, its file is completed, and the next sample begins a new one.
    """

    def __init__(self, settings: StoreSettings) -> None:
        """Touch nothing yet."""
        self._settings = settings
        self._open: _Open | None = None
        self._counter = 0
        self._lock: int | None = None
        self._notes: list[str] = []
        self.recorded = 0
        self.lost = 0
        """Samples that came while the disk took nothing, or were held back when a file was given up."""
        self.unrecordable = 0
        self.files = 0
        """Completed."""
        self.deleted = 0
        """Files deleted to keep within the cap."""
        self.fault: str | None = None
        """In words, while nothing can be written."""

    def open(self) -> list[Path]:
        """Make and lock the folder; returns unfinished recordings found in it, for `repair_leftover`.

        Raises FolderInUseError, and OSError when the folder cannot be made.
        """
        folder = self._settings.folder
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(self._lock)
            self._lock = None
            msg = f"another recorder writes into {folder}: give each a folder of its own"
            raise FolderInUseError(msg) from error
        return sorted(path for path in folder.iterdir() if is_own_part(path.name))

    def repair_leftover(self, path: Path) -> str:
        """Save what an earlier run left unfinished; what came of it, in words.

        May run in another thread than the rest: it touches that file alone.
        """
        try:
            done = repair(path)
            if done.outcome == "hopeless":
                path.replace(path.with_name(path.name + DAMAGED_SUFFIX))
        except OSError as error:
            return f"cannot repair {path}: {error.strerror or error}; it stays as it is"
        words = f"{path.name} of an earlier run: {done.outcome}, {done.messages} messages saved"
        return f"{words}; {'; '.join(done.faults)}" if done.faults else words

    def take_notes(self) -> list[str]:
        """What happened since the last call and is over, in words."""
        notes, self._notes = self._notes, []
        return notes

    def write(self, samples: Iterable[Sample]) -> None:
        """Append samples."""
        for sample in samples:
            if self.fault is None:
                self._write(sample)
            else:
                self.lost += 1
        current = self._open
        if current is not None and self.fault is None and current.part.pending_bytes >= COMMIT_BYTES:
            try:
                current.commit()
            except OSError as error:
                self._fail(error)

    def flush(self) -> None:
        """Put what was written onto the disk; with a fault, try whether the disk takes something again."""
        if self.fault is not None:
            self._try_again()
            return
        if self._open is None:
            return
        try:
            self._open.writer.flush()
            self._open.commit()
        except OSError as error:
            self._fail(error)
        else:
            if self._open.part.tell() >= self._settings.rotate_bytes:
                self._rotate()

    def close(self) -> None:
        """Complete the file and let the folder go."""
        if self._open is not None:
            self._rotate()
        if self._open is not None:
            self._give_up(self._open)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _write(self, sample: Sample) -> None:
        if not is_recordable(sample):
            self.unrecordable += 1
            return
        current = self._file_for(sample)
        if current is None:
            self.lost += 1
            return
        try:
            current.writer.write(sample)
        except ChannelsExhaustedError:
            self._rotate()
            self._write(sample)
            return
        self.recorded += 1
        current.uncommitted += 1
        if current.part.tell() >= self._settings.rotate_bytes:
            self._rotate()

    def _file_for(self, sample: Sample) -> _Open | None:
        """File that the sample goes into; None while there is a fault."""
        age_ns = self._settings.rotate_ns
        if self._open is not None and age_ns is not None and sample.received_ns - self._open.first_ns >= age_ns:
            self._rotate()
        if self.fault is None and self._open is None:
            try:
                self._open = self._begin(sample.received_ns)
            except OSError as error:
                self._fail(error)
        return self._open if self.fault is None else None

    def _begin(self, first_ns: int) -> _Open:
        folder = self._settings.folder
        folder.mkdir(parents=True, exist_ok=True)
        while True:
            self._counter += 1
            final = folder / f"{recording_stem(first_ns, self._counter)}{SUFFIX}"
            if not final.exists() and not final.with_name(f"{final.name}.part").exists():
                break
        part = PartFile(final, fsync=self._settings.fsync)
        return _Open(part, RecordingWriter(part, self._settings.compression), first_ns)

    def _rotate(self) -> None:
        """Complete the file in hand; afterwards there is none, or a fault."""
        if self._open is None:
            return
        try:
            self._open.complete()
        except OSError as error:
            self._fail(error)
            return
        self._open = None
        self.files += 1
        self._keep_within_cap()

    def _keep_within_cap(self) -> None:
        cap = self._settings.keep_bytes
        if cap is None:
            return
        folder = self._settings.folder
        try:
            sizes = {path.name: path.stat().st_size for path in folder.iterdir() if is_own(path.name)}
            for name in beyond_cap(sizes, self._settings.rotate_bytes, cap):
                (folder / name).unlink()
                self.deleted += 1
        except OSError as error:
            self._notes.append(f"cannot keep {folder} within its cap: {error.strerror or error}")

    def _fail(self, error: OSError) -> None:
        where = self._open.part.part if self._open is not None else self._settings.folder
        self.fault = f"{where}: {error.strerror or error}"
        if self._open is not None and error.errno not in NO_ROOM:
            self._give_up(self._open)
            self._open = None

    def _give_up(self, current: _Open) -> None:
        """Leave the file as it was last committed; the next start repairs it."""
        self.lost += current.uncommitted
        self.recorded -= current.uncommitted
        current.part.leave()
        self._notes.append(f"{current.part.part.name} was left unfinished, {current.uncommitted} messages lost with it")

    def _try_again(self) -> None:
        held = self._open.part.pending_bytes if self._open is not None else 0
        try:
            if shutil.disk_usage(self._settings.folder).free < self._settings.resume_free_bytes + held:
                return
        except OSError:  # the folder is gone: a new file makes it anew, or fails with the reason
            pass
        self.fault = None
        self._rotate()
