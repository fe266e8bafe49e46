"""`kirotei cloud history` on the bus: one page after the other, to the screen or into a file."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

import msgspec

from schemas.bridge import StoreQuestion
from schemas.queries import STORE
from schemas.topic import Place
from services.cloud_analyzer.passes_rows import passes_of
from services.cloud_analyzer.rows_file import RowsFile
from services.recorder.bus_session_command import BusSession
from services.runtime.question import NoAnswerError, RefusedError
from services.runtime.zenoh_node import ZenohNode

TIMEOUT_S = 30.0


def run_history(
    question: StoreQuestion,
    place: Place,
    shard: str,
    endpoint: str,
    *,
    most: int,
    out: Path | None,
    as_json: bool,
    passes: bool,
) -> NoReturn:
    """Ask page by page until there is no more or `most` rows have come, and end the process."""

    async def work(node: ZenohNode) -> int:
        with ExitStack() as stack:
            file = None if out is None else stack.enter_context(RowsFile(out))
            asked, rows, partial = question, 0, ""
            while not node.stopping:
                answer = await node.ask(STORE, place, asked, timeout_s=TIMEOUT_S, shard=shard)
                taken = answer.rows[: most - rows]
                columns, wanted = passes_of(answer.columns, taken) if passes else (answer.columns, taken)
                if file is not None:
                    file.write(columns, wanted)
                    _progress(rows + len(taken))
                else:
                    _print(columns, wanted, as_json=as_json, first=rows == 0)
                rows += len(taken)
                partial = answer.partial or partial
                if not answer.next_page or rows >= most:
                    break
                asked = msgspec.structs.replace(asked, page=answer.next_page)
            more = bool(answer.next_page)
        return _told(rows, partial, out, more=more)

    async def told(node: ZenohNode) -> int:
        try:
            return await work(node)
        except (NoAnswerError, RefusedError) as error:
            sys.stderr.write(f"kirotei cloud history: {error}\n")
            return 1

    BusSession("cloud-history", place, endpoint, told).run()


def _print(columns: tuple[str, ...], rows: Sequence[Sequence[object]], *, as_json: bool, first: bool) -> None:
    if as_json:
        for row in rows:
            sys.stdout.write(json.dumps(dict(zip(columns, row, strict=True)), ensure_ascii=False) + "\n")
        return
    writer = csv.writer(sys.stdout, lineterminator="\n")
    if first:
        writer.writerow(columns)
    writer.writerows(rows)


def _progress(rows: int) -> None:
    sys.stderr.write(f"\r{rows} rows" if sys.stderr.isatty() else "")


def _told(rows: int, partial: str, out: Path | None, *, more: bool) -> int:
    if out is not None:
        sys.stdout.write(f"{rows} rows into {out}\n")
    if more:
        sys.stderr.write("kirotei cloud history: there are more rows: raise --most, or ask for less time\n")
    if partial:
        sys.stderr.write(f"kirotei cloud history: PARTIAL: {partial}\n")
    return 0
