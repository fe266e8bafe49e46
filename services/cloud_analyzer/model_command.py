"""`kirotei cloud model` on the bus: a model out of the store, into a file or down to the trains."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from typing import NoReturn

import msgspec

from schemas.bridge import Document, StoreQuestion
from schemas.codec import MAX_MESSAGE_BYTES
from schemas.queries import STORE
from schemas.topic import Place
from services.cloud_analyzer.model_folding import fitting
from services.cloud_analyzer.model_rows import IncompleteModelError, content_of
from services.cloud_analyzer.send_command import say
from services.cloud_analyzer.tables import Value
from services.radio_anomaly.radio_model_file import decoded_model, write_model
from services.recorder.bus_session_command import BusSession
from services.runtime.question import NoAnswerError, RefusedError
from services.runtime.zenoh_node import ZenohNode

TIMEOUT_S = 30.0
ENVELOPE_BYTES = 4096
"""Of a document's message beside its content."""


def run_model(version: str, place: Place, shard: str, endpoint: str, *, out: Path | None, send_as: str) -> NoReturn:
    """Fetch it, write it, say it, and end the process."""

    async def work(node: ZenohNode) -> int:
        try:
            name, packed = await _fetched(node, place, shard, version)
            if out is not None:
                write_model(out, decoded_model(packed, name))
                sys.stdout.write(f"model {name} into {out}\n")
            if send_as:
                await say(node, _document(packed, send_as, name))
        except (NoAnswerError, RefusedError, IncompleteModelError) as error:
            sys.stderr.write(f"kirotei cloud model: {error}\n")
            return 1
        return 0

    BusSession("cloud-model", place, endpoint, work, speaks=bool(send_as)).run()


async def _fetched(node: ZenohNode, place: Place, shard: str, version: str) -> tuple[str, bytes]:
    """Version and packed content of a model, of the newest for an empty version."""
    known = await _rows(node, place, shard, StoreQuestion(t_ns=0, about="models", model=version))
    if not known:
        msg = f"there is no model {version}; see: kirotei cloud history models" if version else "there is no model yet"
        raise RefusedError(msg)
    name = str(known[-1]["version"])
    parts = await _rows(node, place, shard, StoreQuestion(t_ns=0, about="model_parts", model=name))
    return name, content_of((str(row["content"]) for row in parts), str(known[-1]["sha256"]))


async def _rows(node: ZenohNode, place: Place, shard: str, question: StoreQuestion) -> list[dict[str, Value]]:
    """All rows of an answer, page by page. Raises RefusedError also where a shard is away."""
    found: list[dict[str, Value]] = []
    while True:
        answer = await node.ask(STORE, place, question, timeout_s=TIMEOUT_S, shard=shard)
        if answer.partial:
            raise RefusedError(answer.partial)
        found += [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]
        if not answer.next_page:
            return found
        question = msgspec.structs.replace(question, page=answer.next_page)


def _document(packed: bytes, name: str, version: str) -> Document:
    """Packed, and its sums by as many days as it takes for a message to carry it. RefusedError where none does."""
    try:
        content, days = fitting(decoded_model(packed, version), MAX_MESSAGE_BYTES - ENVELOPE_BYTES)
    except ValueError as error:
        raise RefusedError(str(error)) from error
    return Document(
        t_ns=0,
        kind="radio_model",
        name=name,
        version=version if days == 1 else f"{version}-by-{days}-days",
        content=content,
        sha256=hashlib.sha256(content).hexdigest(),
    )
