"""Two sides measured in turn, and what came of it."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Result:
    """One comparison. `ratio` is ours over the peer's rate; None where the peer is not installed or too slow."""

    case: str
    log: str
    unit: str
    ours: float
    peer: str
    theirs: float | None
    ratio: float | None
    note: str = ""


def seconds(work: Callable[[], object]) -> float:
    """How long `work` takes [s]."""
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def alternate(rounds: int, ours: Callable[[], float], theirs: Callable[[], float] | None) -> tuple[float, float | None]:
    """Medians of both sides [s], measured in turn. The first of ours is not counted."""
    ours()
    mine: list[float] = []
    peers: list[float] = []
    for _ in range(rounds):
        mine.append(ours())
        if theirs is not None and not any(s != s for s in peers):  # noqa: PLR0124 - NaN: the peer was too slow once
            peers.append(theirs())
    return statistics.median(mine), (statistics.median(peers) if theirs else None)


def table(results: list[Result]) -> str:
    """The comparisons as text."""
    lines = [f"{'':34}{'log':30}{'Kirotei':>12}{'peer':>12}  ratio"]
    for result in results:
        theirs = "-" if result.theirs is None else f"{result.theirs:,.1f}"
        ratio = result.note if result.ratio is None else f"x {result.ratio:.1f} ({result.peer})"
        lines.append(f"{result.case:34}{result.log:30}{result.ours:12,.1f}{theirs:>12}  {ratio}  [{result.unit}]")
    return "\n".join(lines)
