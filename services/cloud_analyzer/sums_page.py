"""Learned sums as pages of an answer."""

from __future__ import annotations

import math
from datetime import date, timedelta

from schemas.bridge import StoreAnswer, StoreQuestion
from services.cloud_analyzer.history import Learned

_EPOCH = date(1970, 1, 1)
COLUMNS = ("day", "radio", "channel", "direction", "cell", "section", "n", "mean_dbm", "sigma_db")


def sums_answer(question: StoreQuestion, learned: Learned) -> StoreAnswer:
    """A page of sums with mean and standard deviation. ValueError for a page that is none."""
    first = _first_of(question)
    wanted = [
        one
        for one in learned.sums
        if question.radio in ("", one.radio) and question.channel in ("", one.channel) and one.n > 0
    ]
    rows = tuple(
        (_iso(one.day), *one[1:7], one.total / one.n, _sigma(one.n, one.total, one.squares))
        for one in wanted[first : first + question.limit]
    )
    return StoreAnswer(
        t_ns=0,
        about=question.about,
        columns=COLUMNS,
        rows=rows,
        next_page=later_page(question, question.limit) if first + question.limit < len(wanted) else "",
        partial=learned.partial,
    )


def later_page(question: StoreQuestion, rows: int) -> str:
    """Page that goes on behind so many rows of this one."""
    return str(_first_of(question) + rows)


def _first_of(question: StoreQuestion) -> int:
    if question.page and not question.page.isdecimal():
        msg = "no page of these sums: take it from the answer before"
        raise ValueError(msg)
    return int(question.page or "0")


def _iso(day: int | None) -> str:
    return "" if day is None else (_EPOCH + timedelta(days=day)).isoformat()


def _sigma(n: float, total: float, squares: float) -> float | None:
    """Sample standard deviation; None of a single value."""
    return math.sqrt(max(squares - total * total / n, 0.0) / (n - 1.0)) if n > 1.0 else None
