"""Work on many runs, one after the other or in several processes; a few runs are in memory at a time."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from typing import Any, TypeVar

from services.run_history.fixes import RunLog

AHEAD = 8
"""Runs handed to each process beyond the one it works on."""
J = TypeVar("J")
R = TypeVar("R")


def worked(runs: Iterable[RunLog], make: Callable[[J], Callable[[RunLog], R]], job: J, processes: int) -> Iterator[R]:
    """What `make(job)` gives for each run, in the order of `runs`, whatever the number of processes.

    `make` is called once in each process, for alignments are dear to make and to send; it is to be a module's function.
    """
    if processes <= 1:
        work = make(job)
        yield from (work(run) for run in runs)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context, initializer=_prepare, initargs=(make, job)) as pool:
        waiting: deque[Future[R]] = deque()
        for run in runs:
            waiting.append(pool.submit(_in_process, run))
            if len(waiting) > processes * AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


_PREPARED: dict[str, Callable[[RunLog], Any]] = {}


def _prepare(make: Callable[[J], Callable[[RunLog], R]], job: J) -> None:
    _PREPARED["work"] = make(job)


def _in_process(run: RunLog) -> Any:  # noqa: ANN401 - what the prepared work gives
    return _PREPARED["work"](run)
