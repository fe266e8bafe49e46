"""`kirotei motion`: odometry of motion logs, and how good it is."""

from __future__ import annotations

import json
import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.runtime.told_command import UsageError, told

if TYPE_CHECKING:
    from services.odometry_fusion.evaluation import Evaluation
    from services.odometry_fusion.motion_log import MotionRows
    from services.odometry_fusion.settings import Config

app = typer.Typer(
    name="motion",
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Odometry of motion logs: way gone, speed, slips, and the error vouched for.",
)


def configured(path: Path | None, method: str | None) -> Config:
    """Settings from the [odometry_fusion] table of a TOML file, then from options. Raises UsageError, OSError."""
    from services.odometry_fusion.settings import Config
    from services.runtime.config_check import Faults, converted

    table: dict[str, Any] = {}
    if path is not None:
        try:
            table = tomllib.loads(path.read_text("utf-8")).get("odometry_fusion", {})
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            msg = f"{path}: {error}"
            raise UsageError(msg) from error
        if not isinstance(table, dict):
            msg = f"{path}: odometry_fusion: expected a table [odometry_fusion]"
            raise UsageError(msg)
    faults = Faults()
    config = converted(table | ({} if method is None else {"method": method}), Config, faults)
    if config is None:
        spots = (
            "--method" if one == ("method",) and method is not None else f"{path}: odometry_fusion.{'.'.join(one)}"
            for one, _ in faults.found
        )
        raise UsageError("; ".join(f"{spot}: {words}" for spot, (_, words) in zip(spots, faults.found, strict=True)))
    return config


def _told_rows(out: Path, method: str, rows: MotionRows) -> str:
    minutes = (rows.t_s[-1] - rows.t_s[0]) / 60.0
    ended = sum(one.phase == "ended" for one in rows.episodes)
    lost = sum(one.phase == "not_found" for one in rows.episodes)
    lines = [
        f"{out}: {len(rows)} rows, {minutes:.1f} min, method {method}",
        f"{rows.distance_m[-1] - rows.distance_m[0]:.1f} m, bound {rows.bound_m[-1]:.1f} m",
        f"{ended} slips corrected, {lost} without re-adhesion",
    ]
    for code, reason in enumerate(rows.reasons):
        count = int((rows.reason == code).sum())
        if code and count:
            lines.append(f"{count} rows: {reason}")
    return "\n".join(lines)


@app.command()
def run(
    log: Annotated[Path, typer.Argument(help="Folder with motion.toml, imu and tacho (parquet or csv).")],
    out: Annotated[Path, typer.Option(help="Table to write, motion.csv.")],
    method: Annotated[str | None, typer.Option(help="wheel, paper or fused.")] = None,
    config: Annotated[Path | None, typer.Option(help="TOML file with a table [odometry_fusion].")] = None,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Way, speed, slip and bound at 10 Hz from the log's samples; its truth is never read.

    Example: kirotei motion run run_017 --method paper --out motion.csv
    """
    with told("motion run"):
        settings = configured(config, method)
        from services.odometry_fusion.methods import run_log
        from services.odometry_fusion.motion_file import write_motion
        from services.odometry_fusion.motion_log_file import read_motion_log

        read = read_motion_log(log)
        rows = run_log(read.log, settings)
        write_motion(out, rows)
    for issue in read.issues:
        typer.echo(f"kirotei motion run: {issue}", err=True)
    if not as_json:
        typer.echo(_told_rows(out, settings.method, rows))
        return
    found = {
        "out": str(out),
        "method": settings.method,
        "rows": len(rows),
        "distance_m": round(float(rows.distance_m[-1] - rows.distance_m[0]), 3),
        "bound_m": round(float(rows.bound_m[-1]), 3),
        "episodes": [asdict(one) for one in rows.episodes],
        "left_out": list(read.issues),
    }
    typer.echo(json.dumps(found, indent=2))


@app.command()
def evaluate(
    motion: Annotated[list[Path], typer.Option(help="motion.csv to judge; give it again to compare.")],
    truth: Annotated[Path, typer.Option(help="truth.parquet or truth.csv of the log.")],
    plot: Annotated[
        Path | None, typer.Option(help="Picture to write (.png or .svg): speed, errors, distances, and what follows.")
    ] = None,
    spacing: Annotated[float, typer.Option(min=10.0, help="Picture: metres between marks.")] = 1000.0,
    slip_at: Annotated[
        float | None, typer.Option(help="Picture: enlarge the slip nearest to this second, not the costliest one.")
    ] = None,
    line: Annotated[
        Path | None, typer.Option(help="Picture: line file, or the name of a line that is built in.")
    ] = None,
    balises: Annotated[
        Path | None, typer.Option(help="Picture: balises.csv, marks instead of even ones; wants --line.")
    ] = None,
    matches: Annotated[
        Path | None, typer.Option(help="Picture: matches.csv, for curvature against the database; wants --line.")
    ] = None,
    landmarks: Annotated[
        Path | None, typer.Option(help="Picture: landmarks.json of the matches; those of the line when left out.")
    ] = None,
    sensor_behind_front: Annotated[
        float, typer.Option(help="Picture: metres by which the inertial sensor is behind the front end.")
    ] = 0.0,
    positions: Annotated[
        Path | None, typer.Option(help="Picture: positions.csv, for the margin along the way.")
    ] = None,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Slips met, errors across them, and whether the bound held, against a known truth.

    Example: kirotei motion evaluate --motion motion.csv --truth run_017/truth.parquet --plot motion.png
    """
    with told("motion evaluate"):
        from services.odometry_fusion.evaluation import evaluate as judged
        from services.odometry_fusion.motion_file import read_motion
        from services.odometry_fusion.motion_truth_file import read_truth, read_wheel_beside

        true, wheel = read_truth(truth), read_wheel_beside(truth)
        tracks = [read_motion(path) for path in motion]
        found = [judged(track, true, wheel) for track in tracks]
        if plot is None and any((line, balises, matches, landmarks, positions)):
            msg = "--line, --balises, --matches, --landmarks and --positions are for the picture: give --plot"
            raise UsageError(msg)
        if plot is not None:
            from services.odometry_fusion.motion_plot import draw_motion
            from services.odometry_fusion.picture_command import (
                curvature_panels,
                known_line,
                margin_panel,
                marks_for,
                reference_passes,
            )
            from services.odometry_fusion.picture_plot import save_picture

            known = known_line(line, landmarks, balises=balises, matches=matches)
            marks = marks_for(true, spacing, known, balises)
            panels = curvature_panels(truth.parent, known, matches, sensor_behind_front)
            if positions is not None:
                panels.append(margin_panel(positions, truth.parent, reference_passes(balises, matches)))
            save_picture(plot, draw_motion(tracks, true, wheel, marks, slip_at, panels))
    typer.echo(json.dumps([asdict(one) for one in found], indent=2) if as_json else _table(found))


def _table(found: list[Evaluation]) -> str:
    def number(value: float | None, words: str) -> str:
        return "-" if value is None else words.format(value)

    rows: list[tuple[str, list[str]]] = [
        ("", [one.name[:14] for one in found]),
        ("hours", [f"{one.hours:.2f}" for one in found]),
        ("slips", [str(one.slips) for one in found]),
        ("of these costing the wheel > 1 m", [str(one.counted) for one in found]),
        ("detected", [str(one.detected) for one in found]),
        ("wheel taken up again rightly [%]", [number(one.readhered_percent, "{:.2f}") for one in found]),
        ("  too early", [str(one.early) for one in found]),
        ("error per slip, median [m]", [number(one.median_m, "{:.2f}") for one in found]),
        ("error per slip, 95 % [m]", [number(one.p95_m, "{:.2f}") for one in found]),
        ("error per slip, largest [m]", [number(one.largest_m, "{:.2f}") for one in found]),
        ("within 2 % of 1 km [%]", [number(one.within_2_percent, "{:.2f}") for one in found]),
        ("false triggers per hour", [f"{one.false_per_hour:.2f}" for one in found]),
        ("constant lag of the output [s]", [f"{one.lag_s:.2f}" for one in found]),
        ("error at the end [m]", [f"{one.end_error_m:.2f}" for one in found]),
        ("rows with a bound [%]", [f"{one.bounded_percent:.2f}" for one in found]),
        ("rows beyond their bound", [str(one.violations) for one in found]),
        ("largest error over its bound", [f"{one.worst_share:.2f}" for one in found]),
        ("bound above 5 m + 5 % [% of rows]", [f"{one.above_etcs_percent:.2f}" for one in found]),
        ("not valid [% of rows]", [f"{one.degraded_percent:.2f}" for one in found]),
    ]
    return "\n".join(f"{words:36}" + "".join(f"{cell:>15}" for cell in cells) for words, cells in rows)
