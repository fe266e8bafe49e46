"""Files that the cloud hands out, as they lie on the disk of a train: the newest version of each, and the one before.

`documents/<kind>/<name>/current` is always a whole file; `newest.json` beside it says which version
that is.
"""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from pathlib import Path

import msgspec

from schemas.bridge import Document

VERSIONS_KEPT = 2


class DocumentError(ValueError):
    """A document that must not be used."""


class Newest(msgspec.Struct, frozen=True, kw_only=True):
    """What `current` is."""

    version: str
    t_ns: int
    sha256: str


def keep(folder: Path, document: Document) -> bool:
    """Store a document unless a newer one (by its time) lies there; whether it is the newest now.

    Raises DocumentError when the content is not what its digest says or the name cannot be a file's,
    OSError when the disk does not take it. After a crash at any point the old version or the new one is whole.
    """
    digest = hashlib.sha256(document.content).hexdigest()
    if digest != document.sha256:
        msg = f"{document.kind} {document.name} {document.version}: content of {digest}, not {document.sha256}"
        raise DocumentError(msg)
    if "/" in document.name or "\0" in document.name or document.name in (".", ".."):
        msg = f"{document.kind} {document.name!r} cannot be the name of a file"
        raise DocumentError(msg)
    place = folder / document.kind / document.name
    known = newest(place)
    if known is not None and known.t_ns >= document.t_ns:
        return known.sha256 == digest
    place.mkdir(parents=True, exist_ok=True)
    _write(place / digest, document.content)
    link = place / "current.part"
    link.unlink(missing_ok=True)
    link.symlink_to(digest)
    link.rename(place / "current")
    about = Newest(version=document.version, t_ns=document.t_ns, sha256=digest)
    _write(place / "newest.json", msgspec.json.encode(about))
    _forget_old(place, digest)
    return True


def newest(place: Path) -> Newest | None:
    """What lies in `documents/<kind>/<name>`; None when nothing readable does."""
    try:
        return msgspec.json.decode((place / "newest.json").read_bytes(), type=Newest)
    except (OSError, msgspec.MsgspecError, ValueError):
        return None


def _write(path: Path, content: bytes) -> None:
    part = path.with_name(f"{path.name}.part")
    with part.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    part.rename(path)


def _forget_old(place: Path, digest: str) -> None:
    versions = [path for path in place.iterdir() if len(path.name) == len(digest) and path.name != digest]
    versions.sort(key=lambda path: path.stat().st_mtime_ns, reverse=True)
    for path in versions[VERSIONS_KEPT - 1 :]:
        with suppress(FileNotFoundError):
            path.unlink()
