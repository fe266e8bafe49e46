"""`kirotei line`: make line files from maps, check them, show them."""

from __future__ import annotations

import json
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

if TYPE_CHECKING:
    from services.line.line_import import Imported

app = typer.Typer(no_args_is_help=True, help="Line files: make them from maps, check them, show them.")

LineFile = Annotated[Path, typer.Argument(metavar="LINE", help="Line file, CSV polyline, or `demo`.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


@app.command("import")
def import_(
    *,
    axis: Annotated[Path, typer.Option("--axis", help="GeoJSON of the tracks, in any order and sense.")],
    stations: Annotated[Path | None, typer.Option("--stations", help="GeoJSON of the stations.")] = None,
    profile: Annotated[Path | None, typer.Option("--profile", help="CSV of heights, gradients, limits.")] = None,
    out: Annotated[Path, typer.Option("--out", help="Line file to write.")],
    name: Annotated[str, typer.Option("--name", help="Name of the line; the file's when left out.")] = "",
    line_id: Annotated[str, typer.Option("--id", help="Id of the line; made from the name when left out.")] = "",
    version: Annotated[str, typer.Option("--line-version", help="Version of the line file.")] = "1",
    select: Annotated[str, typer.Option("--select", help="Take features with this property value only.")] = "",
    start: Annotated[str, typer.Option("--start", help="Station at whose end axis_m begins.")] = "",
    gauge: Annotated[float, typer.Option("--gauge", min=0.4, max=2.9, help="Gauge [m].")] = 1.067,
    gap: Annotated[float, typer.Option("--gap", min=0.0, max=5000.0, help="Close gaps up to this [m].")] = 60.0,
    vertex_accuracy: Annotated[
        float, typer.Option("--vertex-accuracy", min=0.0, max=50.0, help="The map errs by this at least [m].")
    ] = 0.3,
    switchbacks: Annotated[bool, typer.Option("--switchbacks", help="Trains turn round at joints.")] = False,
    as_json: AsJson = False,
) -> None:
    """Make a line file from a map: put tracks together, fit curves, place stations.

    Stations may give their kilometrage (chainage_m, or km); the profile has axis_m or chainage_m and
    any of height_m, gradient_permille, limit_kmh.

    Example: kirotei line import --axis line.geojson --stations stations.geojson --out line.json
    """
    from services.line.geojson_file import GeoJsonError
    from services.line.import_file import import_from_files
    from services.line.line_import import ImportRefusedError, Wishes
    from services.line.line_json_file import write_line
    from services.line.profile_file import ProfileFileError
    from services.line.stitching import StitchingError

    wishes = Wishes(
        name=name,
        line_id=line_id,
        version=version,
        start=start,
        gap_m=gap,
        reversals=switchbacks,
        gauge_m=gauge,
        vertex_accuracy_m=vertex_accuracy,
    )
    try:
        with _working("fitting curves"):
            imported = import_from_files(axis, stations, profile, wishes, select)
        write_line(out, imported.line)
    except (GeoJsonError, ProfileFileError, OSError) as error:
        _refuse(str(error))
    except (StitchingError, ImportRefusedError) as error:
        _refuse(f"{axis}: {error}")
    _tell_import(out, imported, as_json=as_json)


@app.command()
def check(line: LineFile, *, as_json: AsJson = False) -> None:
    """Everything that is wrong with a line file, all at once; exit 1 if there is an error.

    Example: kirotei line check line.json
    """
    from services.line.line_check import problems_of
    from services.line.line_file import LineFileError, decode_line

    try:
        given = decode_line(line)
    except (LineFileError, OSError) as error:
        _refuse(str(error))
    with _working("checking"):
        problems = problems_of(given)
    errors = sum(one.severity == "error" for one in problems)
    if as_json:
        typer.echo(json.dumps([asdict(one) for one in problems], indent=2, ensure_ascii=False))
    else:
        for one in problems:
            typer.echo(f"{line}:{one.field}: {one.severity}: {one.text}; {one.advice}")
        typer.echo(f"{errors} errors, {len(problems) - errors} warnings", err=bool(problems))
    if errors:
        raise typer.Exit(1)


@app.command()
def show(
    line: LineFile,
    *,
    branch: Annotated[str, typer.Option("--branch", help="Show the way onto this branch.")] = "",
    plot: Annotated[Path | None, typer.Option("--plot", help="Draw it into this picture (.png, .svg, .pdf).")] = None,
    as_json: AsJson = False,
) -> None:
    """Tables of a line: stations, curves, gradients, limits and all else; --plot draws it.

    Example: kirotei line show demo --plot demo.png
    """
    from services.line.alignment import alignment_of
    from services.line.line_file import LineFileError, load_line
    from services.line.line_table import summary_of, tables_of

    try:
        loaded = load_line(line).line
        alignment = alignment_of(loaded, branch)
    except (LineFileError, OSError) as error:
        _refuse(str(error))
    except KeyError as error:
        _refuse(str(error.args[0]), 2)
    if plot is not None:
        from services.line.line_plot import draw_line

        try:
            with _working("drawing"):
                draw_line(plot, loaded, alignment)
        except (OSError, ValueError) as error:
            _refuse(f"{plot}: {error}")
    summary = summary_of(loaded, alignment)
    typer.echo(json.dumps(summary, indent=2, ensure_ascii=False) if as_json else tables_of(summary))


def _tell_import(out: Path, imported: Imported, *, as_json: bool) -> None:
    """What came of an import."""
    line = imported.line
    report = {
        "line": line.id,
        "file": str(out),
        "length_m": round(imported.length_m, 1),
        "vertices": len(line.axis),
        "vertex_noise_m": round(imported.noise_m, 3),
        "curves": len(line.curves),
        "stations": len(line.stations),
        "gradients": len(line.gradients),
        "branches": len(line.branches),
        "parallel_tracks": len(line.parallel_tracks),
        "landmarks": len(line.landmarks),
        "notes": list(imported.notes),
    }
    if as_json:
        typer.echo(json.dumps(report, indent=2, ensure_ascii=False))
        return
    for note in imported.notes:
        typer.echo(f"note: {note}", err=True)
    counts = ", ".join(
        f"{report[name]} {name.replace('_', ' ')}"
        for name in ("curves", "stations", "gradients", "branches", "parallel_tracks", "landmarks")
    )
    typer.echo(f"{out}: {imported.length_m / 1000.0:.3f} km, vertices err by {imported.noise_m:.2f} m; {counts}")


def _working(what: str) -> AbstractContextManager[object]:
    """A sign of life while something long runs: one that moves on a terminal, a plain line elsewhere."""
    from rich.console import Console

    console = Console(stderr=True)
    if console.is_terminal:
        return console.status(what)
    typer.echo(what, err=True)
    return nullcontext()


def _refuse(text: str, code: int = 1) -> NoReturn:
    """Say why the work failed, and end."""
    typer.echo(f"kirotei line: {text}", err=True)
    raise typer.Exit(code)
