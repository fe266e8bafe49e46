"""Many runs, one after the other or in several processes; a few runs are in memory at a time."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

from schemas.line import Line
from services.line.alignment import Alignment, alignment_of, routes
from services.run_history.fixes import RunLog
from services.run_history.run_analysis import analyse_run
from services.run_history.run_rows import RunRow, row_of
from services.run_history.vehicle import Vehicle

AHEAD = 8
"""Runs handed to each process beyond the one it works on."""


@dataclass(frozen=True, slots=True)
class Job:
    """What all runs of a log are analysed with."""

    line: Line
    vehicle: Vehicle
    scheduled_s: Mapping[tuple[str, str], float]
    window_s: float | None = None


@dataclass(frozen=True, slots=True)
class Analysed:
    """What came of one run, without its fixes."""

    run_id: str
    rows: tuple[RunRow, ...]
    note: str


def analysed_runs(runs: Iterable[RunLog], job: Job, processes: int = 1) -> Iterator[Analysed]:
    """Rows of each run, in the order of `runs`, whatever the number of processes."""
    if processes <= 1:
        ways = _ways(job.line)
        yield from (_rows(run, ways, job) for run in runs)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context, initializer=_prepare, initargs=(job,)) as pool:
        waiting: deque[Future[Analysed]] = deque()
        for run in runs:
            waiting.append(pool.submit(_in_process, run))
            if len(waiting) > processes * AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _ways(line: Line) -> list[Alignment]:
    return [alignment_of(line, branch) for branch in routes(line)]


def _rows(run: RunLog, ways: list[Alignment], job: Job) -> Analysed:
    result = analyse_run(run, ways, job.line.stations, job.vehicle, job.window_s)
    rows = tuple(row_of(leg, job.vehicle.group, job.scheduled_s, job.window_s) for leg in result.legs)
    return Analysed(result.run_id, rows, result.note)


_PREPARED: dict[str, partial[Analysed]] = {}


def _prepare(job: Job) -> None:
    """Once in each process: alignments are dear to make and to send."""
    _PREPARED["rows"] = partial(_rows, ways=_ways(job.line), job=job)


def _in_process(run: RunLog) -> Analysed:
    return _PREPARED["rows"](run)
