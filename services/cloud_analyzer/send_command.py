"""`kirotei cloud send` on the bus: says a document until bridges have had the time to hear it."""

from __future__ import annotations

import hashlib
import re
import sys
from pathlib import Path
from typing import NoReturn

import msgspec

from schemas.bridge import Document
from schemas.codec import MAX_MESSAGE_BYTES, encode
from schemas.topic import Place
from schemas.topics import DOCUMENT
from services.recorder.bus_session_command import BusSession
from services.runtime.told_command import UsageError
from services.runtime.zenoh_node import ZenohNode

KINDS = ("line", "landmarks", "gnss_thresholds", "radio_model")
LINGER_S = 2.0
"""A subscriber that is told of us only now gets the document from our cache within this."""


def document_of(file: Path, kind: str, name: str, version: str) -> Document:
    """Document of a file. Raises UsageError for a kind that is none and a file too large for a message, OSError."""
    if kind not in KINDS:
        msg = f"--kind {kind}: there are {', '.join(KINDS)}"
        raise UsageError(msg)
    content = file.read_bytes()
    found = Document(
        t_ns=0,
        kind=kind,  # type: ignore[arg-type]  # one of KINDS
        name=name,
        version=version,
        content=content,
        sha256=hashlib.sha256(content).hexdigest(),
    )
    if len(encode(found)) > MAX_MESSAGE_BYTES:
        msg = f"{file}: {len(content)} bytes, more than a message carries ({MAX_MESSAGE_BYTES})"
        raise UsageError(msg)
    return found


def run_send(document: Document, place: Place, endpoint: str) -> NoReturn:
    """Publish the document and end the process."""

    async def work(node: ZenohNode) -> int:
        await say(node, document)
        return 0

    BusSession("cloud-send", place, endpoint, work, speaks=True).run()


async def say(node: ZenohNode, document: Document) -> None:
    """Publish a document, as of now, and wait until bridges have had the time to hear it."""
    stamped = msgspec.structs.replace(document, t_ns=node.clock.now_ns())
    field = re.sub(r"[^A-Za-z0-9_.@+-]", "_", f"{document.kind}-{document.name}")[:64]
    await node.publish(DOCUMENT, stamped, document=field)
    await node.sleep(LINGER_S)
    sys.stdout.write(f"{document.kind} {document.name} {document.version}: {len(document.content)} bytes said\n")
