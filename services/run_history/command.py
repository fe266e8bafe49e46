"""`kirotei runs`: what runs cost, from logs of positions."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from services.run_history import report_command

app = typer.Typer(
    no_args_is_help=True, help="Running time and traction energy of runs, from logs.", rich_markup_mode=None
)


@app.callback()
def runs() -> None:
    """Keep the commands below `runs`."""


@app.command()
def analyse(
    *,
    log: Annotated[Path, typer.Option("--log", help="CSV, Parquet, GPX or NMEA file, or a folder of them.")],
    line: Annotated[Path, typer.Option("--line", help="Line file, or 'demo'.")],
    vehicle: Annotated[Path, typer.Option("--vehicle", help="vehicle.toml, or 'demo'.")],
    out: Annotated[Path, typer.Option("--out", help="runs.csv.")],
    timetable: Annotated[
        Path | None, typer.Option("--timetable", help="CSV with from, to, running_time_s: scheduled times.")
    ] = None,
    window: Annotated[
        float | None,
        typer.Option("--window", min=1.0, max=60.0, help="Moving average of the speed [s] instead of the smoother."),
    ] = None,
    processes: Annotated[int, typer.Option("--processes", min=1, max=64, help="Analyse in so many processes.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
) -> None:
    """Cut logs into legs from station to station: running time, traction energy, quality.

    Example: kirotei runs analyse --log logs/ --line line.json --vehicle vehicle.toml --out runs.csv
    """
    from services.line.line_file import load_line
    from services.run_history.demo_vehicle import DEMO, demo_vehicle
    from services.run_history.log_analysis import Job, analysed_runs
    from services.run_history.run_rows import RunRow, normalised
    from services.run_history.runs_file import write_runs
    from services.run_history.runs_log_file import read_runs
    from services.run_history.timetable_file import read_timetable
    from services.run_history.vehicle_file import read_vehicle
    from services.runtime.told_command import UsageError, told

    with told("runs analyse"):
        whole = load_line(line).line
        if len(whole.stations) < 2:  # noqa: PLR2004 - a leg needs two
            msg = f"{line}: a line with two stations at least is needed to cut runs into legs"
            raise UsageError(msg)
        train = demo_vehicle() if str(vehicle) == DEMO else read_vehicle(vehicle)
        scheduled = read_timetable(timetable) if timetable is not None else {}
        rows: list[RunRow] = []
        notes: list[str] = []
        count = 0
        rejected: list[tuple[Path, str]] = []
        for result in analysed_runs(read_runs(log, rejected), Job(whole, train, scheduled, window), processes):
            count += 1
            rows += result.rows
            if result.note:
                notes.append(f"{result.run_id}: {result.note}")
            if sys.stderr.isatty():
                sys.stderr.write(f"\r{count} runs, {len(rows)} legs")
        notes += [f"{path}: this file was left out: {reason}" for path, reason in rejected]
        write_runs(out, normalised(rows))
    if sys.stderr.isatty():
        sys.stderr.write("\r\033[K")
    counted = [row for row in rows if not row.excluded_because]
    if as_json:
        summary = {"runs": count, "legs": len(rows), "counted": len(counted), "notes": notes, "out": str(out)}
        typer.echo(json.dumps(summary, ensure_ascii=False))
        return
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    typer.echo(f"{count} runs, {len(rows)} legs, {len(counted)} of them counted, into {out}")
    if train.assumed():
        typer.echo(f"{vehicle}: assumed, for no source is stated: {', '.join(train.assumed())}")


@app.command()
def optimum(
    *,
    line: Annotated[Path, typer.Option("--line", help="Line file, or 'demo'.")],
    vehicle: Annotated[Path, typer.Option("--vehicle", help="vehicle.toml.")],
    start: Annotated[str, typer.Option("--from", help="Station: id or name.")],
    end: Annotated[str, typer.Option("--to", help="Station: id or name.")],
    time: Annotated[float, typer.Option("--time", min=1.0, help="Running time [s].")],
    out: Annotated[Path | None, typer.Option("--out", help="CSV of the profile.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """The speed profile of least traction energy for a running time, with advice and the price of a second.

    Example: kirotei runs optimum --line demo --vehicle vehicle.toml --from Asahigaoka --to Midorino --time 200
    """
    from services.line.alignment import alignment_of
    from services.line.line_file import load_line
    from services.run_history.optimum_report import report_lines, report_of
    from services.run_history.profile_file import write_profile
    from services.run_history.stations import station_named
    from services.run_history.vehicle_file import read_vehicle
    from services.runtime.told_command import told

    with told("runs optimum"):
        whole = load_line(line).line
        way = alignment_of(whole)
        first, last = station_named(whole, start), station_named(whole, end)
        report = report_of(way, read_vehicle(vehicle), first, last, time)
        if out is not None:
            write_profile(out, report.profile)
    if as_json:
        typer.echo(json.dumps(report.summary(), ensure_ascii=False))
        return
    for text in report_lines(report):
        typer.echo(text)


app.command()(report_command.report)
app.command()(report_command.demo)
