"""`kirotei runs report` and `kirotei runs demo`: from runs, or logs of them, to pages and tables."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

if TYPE_CHECKING:
    from services.run_history.run_report import Evidence, RunReport
    from services.run_history.run_rows import RunRow
    from services.run_history.trace_store import TraceStore
    from services.run_history.vehicle import Vehicle

LEFT_OUT = "this file was left out"
Out = Annotated[Path, typer.Option("--out", help="report.html or report.pdf; tables are written beside it.")]
Lang = Annotated[Literal["en", "ja"], typer.Option("--lang", help="Language of the report.")]
FromHour = Annotated[float, typer.Option("--from-hour", min=0, max=24, help="Departures from this local hour on.")]
UntilHour = Annotated[float, typer.Option("--until-hour", min=0, max=24, help="Departures before this local hour.")]
Zone = Annotated[str, typer.Option("--zone", help="Time zone of the hours.")]
Within = Annotated[float, typer.Option("--within", min=1, max=600, help="Margin among runs within ± this [s].")]
Sheets = Annotated[int, typer.Option("--sheets", min=0, max=500, help="Most crew sheets.")]


def report(
    *,
    out: Out,
    runs: Annotated[Path | None, typer.Option("--runs", help="runs.csv of `kirotei runs analyse`.")] = None,
    log: Annotated[Path | None, typer.Option("--log", help="Logs of the runs (file or folder): speeds drawn.")] = None,
    line: Annotated[Path | None, typer.Option("--line", help="Line file, or 'demo'; with --log.")] = None,
    vehicle: Annotated[Path | None, typer.Option("--vehicle", help="vehicle.toml, or 'demo'; with --log.")] = None,
    reference: Annotated[
        Path | None, typer.Option("--reference", help="Monitor records of the same runs, as a runs log; with --log.")
    ] = None,
    timetable: Annotated[
        Path | None, typer.Option("--timetable", help="CSV with from, to, running_time_s; without --runs.")
    ] = None,
    lang: Lang = "en",
    names: Annotated[bool, typer.Option("--names", help="Run ids as they are, no pseudonyms.")] = False,
    from_hour: FromHour = 10.0,
    until_hour: UntilHour = 16.0,
    zone: Zone = "Asia/Tokyo",
    within: Within = 10.0,
    sheets: Sheets = 10,
    processes: Annotated[int, typer.Option("--processes", min=1, max=64, help="Analyse in so many processes.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
) -> None:
    """Statistics, energy-saving margin, diagrams and crew sheets of runs, as a page and as tables.

    Example: kirotei runs report --log gpx/ --line line.json --vehicle vehicle.toml --out report.html
    """
    from services.run_history.report_file import salt_beside, write_report, write_tables
    from services.run_history.run_report import Wishes, report_of
    from services.run_history.run_statistics import Selection
    from services.run_history.runs_table_file import read_rows
    from services.run_history.timetable_file import read_timetable
    from services.run_history.trace_store import TraceStore
    from services.runtime.told_command import UsageError, told

    with told("runs report"), TraceStore() as store, TraceStore() as monitor:
        _refuse(out, runs, log, line, vehicle, reference, timetable)
        wishes = Wishes(Selection(from_hour, until_hour, _known_zone(zone)), within, sheets)
        salt = None if names else salt_beside(out)
        evidence: Evidence | None = None
        rows: Sequence[RunRow] = ()
        notes: list[str] = []
        if log is not None and line is not None and vehicle is not None:
            scheduled = read_timetable(timetable) if timetable is not None else {}
            sources = _Sources(log, line, vehicle, reference, processes)
            evidence, rows, notes = _evidence(sources, scheduled, store, monitor, salt)
        if runs is not None:
            rows = read_rows(runs)
        if not rows:
            msg = "no leg from station to station in it: nothing to report"
            raise UsageError("; ".join((msg, *notes)))
        if not any(wishes.selection.holds(row.departure_s) for row in rows if not row.excluded_because):
            notes.append("no run counts: widen the hours (--from-hour, --until-hour, --zone)")
        found = report_of(rows, wishes, evidence, salt, notes)
        note = write_report(out, found, lang)
        tables = write_tables(out, found)
    _tell(found, out, tables, [*found.notes, *([note] if note else [])], as_json=as_json)


def _tell(found: RunReport, out: Path, tables: Sequence[Path], notes: list[str], *, as_json: bool) -> None:
    """Say what was written, and what was noticed."""
    if as_json:
        counts = {"runs": found.runs, "legs": found.legs, "counted": found.counted}
        written = {"out": str(out), "tables": [str(path) for path in tables], "notes": notes}
        typer.echo(json.dumps(counts | written, ensure_ascii=False))
        return
    for text in notes:
        typer.echo(f"note: {text}", err=True)
    typer.echo(f"{found.runs} runs, {found.legs} legs, {found.counted} counted, into {out} and {len(tables)} tables")


def _refuse(
    out: Path,
    runs: Path | None,
    log: Path | None,
    line: Path | None,
    vehicle: Path | None,
    reference: Path | None,
    timetable: Path | None,
) -> None:
    """Say what does not go together before anything is read."""
    from services.runtime.told_command import UsageError

    if out.suffix.lower() not in (".html", ".htm", ".pdf"):
        msg = f"--out {out}: wanted is .html or .pdf"
        raise UsageError(msg)
    if runs is None and log is None:
        msg = "give --runs (runs.csv), --log (with --line and --vehicle), or both"
        raise UsageError(msg)
    if (log is not None) != (line is not None and vehicle is not None):
        msg = "--log, --line and --vehicle go together"
        raise UsageError(msg)
    if reference is not None and log is None:
        msg = "--reference is compared with --log"
        raise UsageError(msg)
    if timetable is not None and runs is not None:
        msg = "--timetable belongs to the analysis: runs.csv holds its times already"
        raise UsageError(msg)


def _known_zone(zone: str) -> str:
    from zoneinfo import ZoneInfo

    from services.runtime.told_command import UsageError

    try:
        ZoneInfo(zone)
    except (KeyError, ValueError, OSError) as error:
        msg = f"--zone {zone}: no such time zone; they are called as Asia/Tokyo or Europe/Budapest"
        raise UsageError(msg) from error
    return zone


def _vehicle(path: Path) -> Vehicle:
    from services.run_history.demo_vehicle import DEMO, demo_vehicle
    from services.run_history.vehicle_file import read_vehicle

    return demo_vehicle() if str(path) == DEMO else read_vehicle(path)


class _Sources(NamedTuple):
    """Where a report's evidence comes from."""

    log: Path
    line: Path
    vehicle: Path
    reference: Path | None
    processes: int


def _evidence(
    sources: _Sources,
    scheduled: dict[tuple[str, str], float],
    store: TraceStore,
    monitor: TraceStore,
    salt: bytes | None,
) -> tuple[Evidence, list[RunRow], list[str]]:
    """Evidence with its speeds in the stores, rows of legs, and notes, which name runs as the report does."""
    from services.line.alignment import alignment_of, routes
    from services.line.line_file import load_line
    from services.run_history.pseudonym import pseudonym
    from services.run_history.report_evidence import LogJob, gather
    from services.run_history.run_report import Evidence
    from services.run_history.run_rows import normalised
    from services.run_history.runs_log_file import read_runs

    whole = load_line(sources.line).line
    train = _vehicle(sources.vehicle)
    job = LogJob(whole, train, scheduled)
    rejected: list[tuple[Path, str]] = []
    found = gather(read_runs(sources.log, rejected), job, store, sources.processes)
    if sources.reference is not None:
        gather(read_runs(sources.reference), job, monitor, sources.processes)
    told = [(path.stem, f"{LEFT_OUT}: {reason}") for path, reason in rejected] + found.notes
    for path, _ in rejected:
        # The page names files by pseudonyms, which are for nobody who is to mend them.
        typer.echo(f"note: {path}: {LEFT_OUT}", err=True)
    notes = [f"{run if salt is None else pseudonym(run, salt)}: {note}" for run, note in told]
    if train.assumed():
        notes.append(f"{train.name}: assumed, for no source is stated: {', '.join(train.assumed())}")
    way = alignment_of(whole, routes(whole)[0])
    return Evidence(way, train, store, monitor, found.reception), normalised(found.rows), notes


def demo(
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder for log, vehicle file and report; made if need be.")],
    runs: Annotated[int, typer.Option("--runs", min=1, max=500, help="Runs, half of them each way.")] = 30,
    scenario: Annotated[str, typer.Option("--scenario", help="Train scenario of the simulator.")] = "demo_line",
    lang: Lang = "en",
    pdf: Annotated[bool, typer.Option("--pdf", help="PDF instead of HTML.")] = False,
) -> None:
    """Simulate runs of a line over days, log them on board (some by a tablet), and make the whole report of them.

    Example: kirotei runs demo --out demo_runs
    """
    from services.run_history.demo_vehicle import vehicle_text
    from services.run_history.runs_log_writer_file import write_runs_log
    from services.run_history.simulated_runs import simulated_runs
    from services.runtime.told_command import UsageError, told
    from services.simulator.scenario_file import alignment_for, read_any_scenario
    from services.simulator.train_scenario import TrainScenario

    with told("runs demo"):
        chosen = read_any_scenario(scenario)
        loaded = alignment_for(chosen) if isinstance(chosen, TrainScenario) else None
        if not isinstance(chosen, TrainScenario) or loaded is None:
            msg = f"{scenario}: wanted is a scenario of a train on a line"
            raise UsageError(msg)
        out.mkdir(parents=True, exist_ok=True)
        log, vehicle = out / "runs_log.csv", out / "vehicle.toml"
        write_runs_log(log, simulated_runs(chosen, loaded.alignment, runs))
        vehicle.write_text(vehicle_text(chosen.motion.vehicle), "utf-8")
    line = Path(chosen.line or "demo")
    report(out=out / ("report.pdf" if pdf else "report.html"), log=log, line=line, vehicle=vehicle, lang=lang)
