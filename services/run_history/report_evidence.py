"""What a report takes from logs: rows of legs, their speeds into a store, reception, notes; a few runs at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.line import Line
from services.line.alignment import Alignment, alignment_of, routes
from services.line.route_projection import project_run
from services.run_history.fixes import RunLog
from services.run_history.reception_survey import Reception, survey
from services.run_history.run_analysis import analyse_run
from services.run_history.run_processes import worked
from services.run_history.run_rows import RunRow, row_of
from services.run_history.speed_trace import SpeedTrace, trace_of
from services.run_history.trace_store import TraceStore
from services.run_history.vehicle import Vehicle

Floats = NDArray[np.float64]
PLACE_SIGMA_M: Final = 5.0
"""Of a phone's fixes, for the survey of reception."""


@dataclass(frozen=True, slots=True)
class LogJob:
    """What all runs are analysed with."""

    line: Line
    vehicle: Vehicle
    scheduled_s: Mapping[tuple[str, str], float]


@dataclass(frozen=True, slots=True)
class TracedRun:
    """What came of one run."""

    run_id: str
    rows: tuple[RunRow, ...]
    traces: tuple[SpeedTrace, ...]
    """One for each row."""
    note: str
    heard: tuple[Floats, Floats, Floats]
    """Seconds, places along the axis (NaN off the line) and speeds of its fixes."""


@dataclass(slots=True)
class Gathered:
    """What came of all runs but their speeds."""

    rows: list[RunRow] = field(default_factory=list)
    notes: list[tuple[str, str]] = field(default_factory=list)
    """Run id, and what is to be said of it."""
    reception: tuple[Reception, ...] = ()


def gather(runs: Iterable[RunLog], job: LogJob, store: TraceStore, processes: int = 1) -> Gathered:
    """Analyse runs; speeds of legs go into the store."""
    found = Gathered()

    def heard() -> Iterator[tuple[Floats, Floats, Floats]]:
        for run in worked(runs, tracing, job, processes):
            for row, trace in zip(run.rows, run.traces, strict=True):
                store.put(row.start, row.end, trace)
            found.rows += run.rows
            if run.note:
                found.notes.append((run.run_id, run.note))
            yield run.heard

    found.reception = tuple(survey(heard()))
    return found


def tracing(job: LogJob) -> Callable[[RunLog], TracedRun]:
    """The work on one run, with the line's routes made once."""
    ways = [alignment_of(job.line, branch) for branch in routes(job.line)]
    return partial(_traced, ways=ways, job=job)


def _traced(run: RunLog, ways: list[Alignment], job: LogJob) -> TracedRun:
    result = analyse_run(run, ways, job.line.stations, job.vehicle)
    rows = tuple(row_of(leg, job.vehicle.group, job.scheduled_s, None) for leg in result.legs)
    t = run.t_unix_s - (run.t_unix_s[0] if len(run.t_unix_s) else 0.0)
    place = (
        project_run(ways, t, run.lat_deg, run.lon_deg, PLACE_SIGMA_M).axis_m if len(t) > 1 else np.full(len(t), np.nan)
    )
    return TracedRun(
        run.run_id, rows, tuple(trace_of(leg) for leg in result.legs), result.note, (t, place, run.speed_mps)
    )
