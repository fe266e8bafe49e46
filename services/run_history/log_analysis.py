"""Many runs of a log to rows, in one process or several."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

from schemas.line import Line
from services.line.alignment import Alignment, alignment_of, routes
from services.run_history.fixes import RunLog
from services.run_history.run_analysis import analyse_run
from services.run_history.run_processes import worked
from services.run_history.run_rows import RunRow, row_of
from services.run_history.vehicle import Vehicle


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
    return worked(runs, _prepared, job, processes)


def _prepared(job: Job) -> Callable[[RunLog], Analysed]:
    ways = [alignment_of(job.line, branch) for branch in routes(job.line)]
    return partial(_rows, ways=ways, job=job)


def _rows(run: RunLog, ways: list[Alignment], job: Job) -> Analysed:
    result = analyse_run(run, ways, job.line.stations, job.vehicle, job.window_s)
    rows = tuple(row_of(leg, job.vehicle.group, job.scheduled_s, job.window_s) for leg in result.legs)
    return Analysed(result.run_id, rows, result.note)
