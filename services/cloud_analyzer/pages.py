"""Rows as pages of an answer, none larger than a message may be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import msgspec

from schemas.bridge import StoreAnswer, StoreQuestion
from schemas.codec import MAX_MESSAGE_BYTES, encode
from services.cloud_analyzer.history_sql import TABLE_OF, Asked, page_after
from services.cloud_analyzer.runs_page import COLUMNS as RUN_COLUMNS
from services.cloud_analyzer.runs_page import run_rows
from services.cloud_analyzer.sums_page import later_page

MOST_BYTES: Final = MAX_MESSAGE_BYTES - 1024
"""Of a page, with what the envelope adds."""


def page_of(question: StoreQuestion, asked: Asked, found: Sequence[Sequence[Any]], partial: str = "") -> StoreAnswer:
    """The answer in what a store found: one row more than are wanted tells that there is another page."""
    rows = [tuple(row) for row in found[: asked.limit]]
    next_page = page_after(rows[-1], asked.table) if len(found) > asked.limit else ""
    return StoreAnswer(
        t_ns=0, about=question.about, columns=asked.table.names, rows=tuple(rows), next_page=next_page, partial=partial
    )


def told(question: StoreQuestion, answer: StoreAnswer, most_bytes: int = MOST_BYTES) -> StoreAnswer:
    """The answer as it is sent: as many of its rows as a message takes, with the page that goes on behind them.

    Raises ValueError for a row that is too large alone.
    """
    shape = _shaper(question)
    whole = shape(answer)
    if len(encode(whole)) <= most_bytes:
        return whole
    fits, too_many = 0, len(answer.rows)
    while too_many - fits > 1:
        middle = (fits + too_many) // 2
        if len(encode(shape(_first(question, answer, middle)))) <= most_bytes:
            fits = middle
        else:
            too_many = middle
    if fits == 0:
        msg = f"a row of {question.about} is larger than a message ({MAX_MESSAGE_BYTES} bytes): {answer.rows[0][:6]}"
        raise ValueError(msg)
    return shape(_first(question, answer, fits))


def _shaper(question: StoreQuestion) -> Callable[[StoreAnswer], StoreAnswer]:
    """Run records are kept as they were said, and shown by their fields."""
    if question.about != "runs":
        return lambda answer: answer
    return lambda answer: msgspec.structs.replace(
        answer, columns=RUN_COLUMNS, rows=run_rows(answer.columns, answer.rows)
    )


def _first(question: StoreQuestion, answer: StoreAnswer, count: int) -> StoreAnswer:
    rows = answer.rows[:count]
    if question.about == "radio_sums":
        page = later_page(question, count)
    else:
        page = page_after(rows[-1], TABLE_OF[question.about])
    return msgspec.structs.replace(answer, rows=rows, next_page=page)
