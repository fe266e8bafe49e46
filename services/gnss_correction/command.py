"""`kirotei gnss`: recordings solved and evaluated."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from services.gnss_correction.tune_command import tune
from services.runtime.progress import progress_of
from services.runtime.settings_table import settings_table
from services.runtime.told_command import UsageError, told

if TYPE_CHECKING:
    from services.gnss_correction.along_track import AlongError
    from services.gnss_correction.evaluation import Evaluation, FixTrack
    from services.gnss_correction.settings import Config
    from services.gnss_correction.solve_file import Solved
    from services.gnss_reference.base_file import Base

USUAL_SMOOTHING_S = 100.0
"""Time constant of Hatch filters in receivers and in aviation (RTCA DO-229)."""

app = typer.Typer(
    name="gnss",
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Satellite positioning on recordings: positions from RINEX files, and how good they are.",
)


def configured(path: Path | None, overrides: dict[str, object]) -> Config:
    """Settings from the [gnss_correction] table of a TOML file, then from options. Raises UsageError."""
    from services.gnss_correction.settings import Config
    from services.runtime.config_check import Faults, converted

    table = {} if path is None else settings_table(path, "gnss_correction")
    faults = Faults()
    config = converted(table | {name: value for name, value in overrides.items() if value is not None}, Config, faults)
    if config is None:
        spots = (
            f"--{one[0]}" if one and overrides.get(one[0]) is not None else f"{path}: gnss_correction.{'.'.join(one)}"
            for one, _ in faults.found
        )
        raise UsageError("; ".join(f"{spot}: {words}" for spot, (_, words) in zip(spots, faults.found, strict=True)))
    return config


def _summary(rover: Path, out: Path, method: str, solved: Solved) -> str:
    share = 100.0 * solved.fixes / solved.epochs
    lines = [
        f"{out}: {solved.fixes} fixes for {solved.epochs} epochs of {rover} ({share:.2f} %), method {method}",
        f"{solved.flagged_per_epoch:.2f} satellites per epoch held for multipath, {solved.clock_jumps} clock jumps",
    ]
    lines += [f"no fix: {count} epochs, {reason}" for reason, count in solved.reasons.items()]
    if solved.corrected:
        lines.append(f"{solved.corrected} epochs corrected by the base")
    lines += [f"not corrected by the base: {count} epochs, {reason}" for reason, count in solved.uncorrected.items()]
    if solved.issues:
        lines.append(f"{len(solved.issues)} things in the files were refused, the first: {solved.issues[0]}")
    return "\n".join(lines)


def _require_line(settings: Config, wheel: Path | None) -> None:
    """Raise UsageError where the method line is asked for without a line, or wheels without that method."""
    if settings.method == "line" and not settings.line_file:
        msg = "--method line: needs the line, as --line FILE"
        raise UsageError(msg)
    if wheel is not None and settings.method != "line":
        msg = "--wheel: only the method line uses the wheels"
        raise UsageError(msg)


def _base(observations: Path | None, position: str | None) -> Base | None:
    """The base that corrects the rover, where one is given. Raises UsageError."""
    if observations is None and position is None:
        return None
    if observations is None or position is None:
        msg = "--base and --base-position: give both or neither"
        raise UsageError(msg)
    from services.gnss_reference.base_file import Base
    from services.gnss_reference.base_position import parse_position

    try:
        return Base(observations, parse_position(position))
    except ValueError as error:
        msg = f"--base-position: {error}"
        raise UsageError(msg) from error


@app.command()
def solve(
    *,
    rover: Annotated[Path, typer.Option("--rover", help="Observations: RINEX, or RTCM 3 or UBX as received.")],
    nav: Annotated[list[Path], typer.Option("--nav", help="Ephemerides: RINEX, RTCM 3 or UBX; as often as needed.")],
    out: Annotated[Path, typer.Option("--out", help="fixes.csv to write: one row per epoch.")],
    method: Annotated[
        str | None,
        typer.Option(
            "--method", help="original, remove, adjust, robust or line; default: that of the settings, robust."
        ),
    ] = None,
    systems: Annotated[
        str | None, typer.Option("--systems", help="Constellations, as G,R,E,C,J; default: all of these.")
    ] = None,
    weights: Annotated[str | None, typer.Option("--weights", help="cn0 (default) or elevation.")] = None,
    line: Annotated[
        Path | None, typer.Option("--line", help="Line file or CSV polyline: chainage of every fix; for method line.")
    ] = None,
    wheel: Annotated[
        Path | None, typer.Option("--wheel", help="Speed by the wheels for method line: CSV gps_week,tow_s,speed_mps.")
    ] = None,
    base: Annotated[
        Path | None,
        typer.Option("--base", help="Recording of a base receiver that corrects the rover's: RINEX, RTCM 3 or UBX."),
    ] = None,
    base_position: Annotated[
        str | None, typer.Option("--base-position", help="Where the base stands: LAT,LON,H in degrees and metres.")
    ] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Smooth pseudoranges by the carrier phase over 100 s, or what is set.")
    ] = False,
    thresholds: Annotated[
        Path | None, typer.Option("--thresholds", help="The receiver's own thresholds, as `kirotei gnss tune` writes.")
    ] = None,
    verdicts: Annotated[Path | None, typer.Option("--verdicts", help="verdicts.csv to write.")] = None,
    config: Annotated[
        Path | None, typer.Option("--config", help="TOML file whose [gnss_correction] table holds further settings.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Positions from a recording, with a multipath verdict on every satellite.

    Example: kirotei gnss solve --rover rover.obs --nav brdc.nav --method remove --out fixes.csv
    """
    with told("gnss solve"):
        chosen = {"method": method, "systems": systems and systems.replace(",", "").upper(), "weights": weights}
        chosen["line_file"] = str(line) if line else None
        chosen["thresholds_file"] = str(thresholds) if thresholds else None
        settings = configured(config, {**chosen, "compare": []})
        if smooth and settings.smooth_s == 0.0:
            settings = configured(config, {**chosen, "compare": [], "smooth_s": USUAL_SMOOTHING_S})
        _require_line(settings, wheel)
        station = _base(base, base_position)
        from services.gnss_correction.solve_file import solve_file

        if verdicts is not None and verdicts.absolute() == out.absolute():
            msg = f"{out}: fixes and verdicts cannot be one file"
            raise UsageError(msg)
        with progress_of(f"solving {rover.name}") as progress:
            solved = solve_file(rover, nav, settings, out, verdicts, progress, wheel, station)
        if as_json:
            table = asdict(solved) | {"issues": [str(issue) for issue in solved.issues], "method": settings.method}
            typer.echo(json.dumps(table, indent=2))
        else:
            typer.echo(_summary(rover, out, settings.method, solved))


def _named(paths: list[Path]) -> list[tuple[str, Path]]:
    """A short name for each file: its stem, or its path where stems repeat."""
    stems = [path.stem for path in paths]
    return [(stem if stems.count(stem) == 1 else str(path), path) for stem, path in zip(stems, paths, strict=True)]


def _print(
    evaluations: list[Evaluation],
    along: list[AlongError | None],
    *,
    with_line: bool,
    with_truth: bool,
    as_json: bool,
) -> None:
    from services.gnss_correction.evaluation_table import along_table, tables

    if as_json:
        pairs = zip(evaluations, along, strict=True)
        rows = [asdict(one) | {"along": asdict(error) if error else None} for one, error in pairs]
        typer.echo(json.dumps(rows, indent=2))
        return
    typer.echo(tables(evaluations, with_line=with_line, with_truth=with_truth))
    if any(along):
        names = [one.name for one in evaluations]
        typer.echo("\n" + along_table(list(zip(names, along, strict=True))))


def _evaluate_integrity(
    fixes: list[Path], truth: Path | None, alert_limit_m: float, plot: Path | None, *, as_json: bool
) -> None:
    """Bounds of several methods against their errors."""
    if truth is None:
        msg = "--integrity: bounds can be held against a --truth only"
        raise UsageError(msg)
    from services.gnss_correction import fixes_file
    from services.gnss_correction.integrity import bounded_errors, integrity_of, integrity_table

    truth_line = fixes_file.read_truth(truth)
    tracks = [bounded_errors(fixes_file.read_fixes(path, name), truth_line) for name, path in _named(fixes)]
    results = [integrity_of(track, alert_limit_m) for track in tracks]
    if plot is not None:
        from services.gnss_correction.stanford_plot import save_stanford

        save_stanford(plot, tracks, alert_limit_m)
    typer.echo(json.dumps([asdict(one) for one in results], indent=2) if as_json else integrity_table(results))


@app.command("evaluate")
def evaluate_fixes(
    *,
    fixes: Annotated[list[Path], typer.Option("--fixes", help="fixes.csv; several are set side by side.")],
    truth: Annotated[Path | None, typer.Option("--truth", help="truth.csv with which to compare.")] = None,
    centreline: Annotated[
        Path | None, typer.Option("--centreline", help="Line file or CSV polyline with which to compare.")
    ] = None,
    stations: Annotated[
        Path | None, typer.Option("--stations", help="CSV of stations for the plot: name, lat_deg, lon_deg.")
    ] = None,
    integrity: Annotated[
        bool, typer.Option("--integrity", help="Hold the bounds against the errors; needs --truth.")
    ] = False,
    alert_limit: Annotated[
        float, typer.Option("--alert-limit", min=0.0, help="Bound [m] beyond which a fix is not available.")
    ] = 50.0,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="Picture to write, .png or .svg: map of the fixes, or the Stanford diagram."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Distance to the line, fixation rate and error against the truth, of several methods side by side.

    Example: kirotei gnss evaluate --fixes original.csv --fixes remove.csv --truth truth.csv --centreline line.csv

    Example: kirotei gnss evaluate --fixes robust.csv --truth truth.csv --integrity --plot stanford.png
    """
    with told("gnss evaluate"):
        if plot is not None and plot.suffix.lower() not in (".png", ".svg"):
            msg = f"--plot: {plot} is neither .png nor .svg"
            raise UsageError(msg)
        if integrity:
            _evaluate_integrity(fixes, truth, alert_limit, plot, as_json=as_json)
            return
        from services.gnss_correction import fixes_file
        from services.gnss_correction.along_track import along_error
        from services.gnss_correction.evaluation import centreline_of, evaluate
        from services.line.line_file import read_line

        tracks: list[FixTrack] = [fixes_file.read_fixes(path, name) for name, path in _named(fixes)]
        truth_line = fixes_file.read_truth(truth) if truth else None
        geometry = read_line(centreline) if centreline else None
        line = centreline_of(geometry) if geometry else None
        stops = fixes_file.read_stations(stations) if stations else []
        evaluations = [evaluate(track, truth_line, line) for track in tracks]
        if plot is not None:
            from services.gnss_correction.track_plot import save_tracks

            save_tracks(plot, tracks, line, truth_line, stops)
        along = [along_error(track, truth_line, geometry) if truth_line and geometry else None for track in tracks]
        _print(evaluations, along, with_line=line is not None, with_truth=truth_line is not None, as_json=as_json)


app.command("tune")(tune)
