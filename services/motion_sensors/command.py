"""`kirotei motion import` and `kirotei motion calibrate`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

Folder = Annotated[Path, typer.Option("--out", help="Folder of the motion log that is made.")]


def import_log(
    kind: Annotated[str, typer.Argument(help="comma2k19, wid or csv.")],
    source: Annotated[Path, typer.Argument(help="Segment or trial folder, or CSV of the inertial sensor.")],
    out: Folder,
    tacho: Annotated[Path | None, typer.Option(help="csv: table with pulses or speed.")] = None,
    imu_columns: Annotated[
        str, typer.Option(help="csv: which column is what.")
    ] = "t=t_s,ax=ax_mps2,ay=ay_mps2,az=az_mps2,gx=gx_radps,gy=gy_radps,gz=gz_radps",
    tacho_columns: Annotated[str, typer.Option(help="csv: t and pulses, or t and speed.")] = "t=t_s,pulses=pulses",
    axes: Annotated[str, typer.Option(help="csv: sensor axes that point forward, left, up.")] = "x,y,z",
    time_scale: Annotated[float, typer.Option(help="csv: seconds per unit of time.")] = 1.0,
    force_unit: Annotated[str, typer.Option(help="csv: mps2 or g.")] = "mps2",
    rate_unit: Annotated[str, typer.Option(help="csv: radps or dps.")] = "radps",
    speed_unit: Annotated[str, typer.Option(help="csv: mps or kmh.")] = "mps",
    pulses_per_revolution: Annotated[float, typer.Option(help="csv: of the counter.")] = 90.0,
    wheel_diameter_m: Annotated[float, typer.Option(help="csv: of the wheel.")] = 0.816,
    latency_s: Annotated[float, typer.Option(help="By how much the inertial sensor's times are late.")] = 0.0,
    max_gradient: Annotated[float, typer.Option(help="Steepest gradient of the line in per mille.")] = 100.0,
) -> None:
    """Make a motion log of another recording.

    Example: kirotei motion import comma2k19 SEGMENT --out drive
    """
    from services.motion_sensors.import_file import (
        UNITS,
        ImportFileError,
        read_comma2k19,
        read_tables,
        write_motion_log,
    )
    from services.motion_sensors.mounting import axes_rotation
    from services.motion_sensors.wid_file import read_wid

    if kind not in ("comma2k19", "wid", "csv"):
        msg = f"{kind!r} is none of comma2k19, wid, csv"
        raise typer.BadParameter(msg)
    units = {force_unit: ("mps2", "g"), rate_unit: ("radps", "dps"), speed_unit: ("mps", "kmh")}
    for unit, known in units.items():
        if unit not in known or unit not in UNITS:
            msg = f"unit {unit!r} is none of {', '.join(known)}"
            raise typer.BadParameter(msg)
    try:
        if kind == "comma2k19":
            run = read_comma2k19(source)
        elif kind == "wid":
            run = read_wid(source)
        else:
            if tacho is None:
                msg = "csv needs --tacho FILE with pulses or speed"
                raise typer.BadParameter(msg)
            parts = [one.strip() for one in axes.split(",")]
            if len(parts) != 3:  # noqa: PLR2004 - axes
                msg = f"--axes wants three, as x,-y,-z, not {axes!r}"
                raise typer.BadParameter(msg)
            run = read_tables(
                source,
                _pairs(imu_columns),
                tacho,
                _pairs(tacho_columns),
                axes_rotation((parts[0], parts[1], parts[2])),
                time_scale=time_scale,
                force_unit=force_unit,
                rate_unit=rate_unit,
                speed_unit=speed_unit,
                pulses_per_revolution=pulses_per_revolution,
                wheel_diameter_m=wheel_diameter_m,
            )
        write_motion_log(out, run, latency_s, max_gradient)
    except (ImportFileError, ValueError, OSError) as error:
        typer.echo(f"kirotei: {error}", err=True)
        raise typer.Exit(1) from error
    for note in run.notes:
        typer.echo(f"note: {note}", err=True)
    seconds = run.imu_t_s[-1] - run.imu_t_s[0]
    typer.echo(f"{out}: {seconds:.1f} s, {len(run.imu_t_s)} inertial samples, {len(run.tacho_t_s)} counts")


def calibrate(
    logs: Annotated[list[Path], typer.Argument(help="Motion logs of ordinary runs, with stops.")],
    known_distance: Annotated[
        list[float] | None, typer.Option(help="True length of each log in metres, for the wheel diameter.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Write the log again, calibrated, into this new folder (several: one folder each in it)."),
    ] = None,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Estimate latency, mounting angles, wheel diameter and the threshold Ta from ordinary runs.

    Example: kirotei motion calibrate run1 run2 --known-distance 8012 --known-distance 8012
    """
    from services.motion_sensors.calibrated_log_file import write_calibrated
    from services.motion_sensors.calibration import calibrate as estimate
    from services.motion_sensors.calibration import gradient_threshold_kmhps
    from services.odometry_fusion.motion_log_file import read_motion_log

    if known_distance and len(known_distance) != len(logs):
        msg = f"{len(known_distance)} known distances for {len(logs)} logs"
        raise typer.BadParameter(msg)
    try:
        read = [read_motion_log(path).log for path in logs]
        found = estimate(read, known_distance)
        if out is not None:
            for path, log in zip(logs, read, strict=True):
                write_calibrated(path, log, found, out if len(logs) == 1 else out / path.resolve().name)
    except (ValueError, OSError) as error:
        typer.echo(f"kirotei: {error}", err=True)
        raise typer.Exit(1) from error
    names = ("latency_s", "roll_deg", "pitch_deg", "yaw_deg", "wheel_diameter_m", "threshold_kmhps")
    estimates = {name: getattr(found, name) for name in names}
    if as_json:
        shown = {
            name: {"value": one.value, "error": one.error, "stretches": one.stretches} if one.known else None
            for name, one in estimates.items()
        }
        typer.echo(json.dumps(shown))
        return
    typer.echo("                   value   standard error   stretches")
    for name, one in estimates.items():
        figures = (
            f"{one.value:9.4f}   {one.error:14.4f}   {one.stretches:9d}"
            if one.known
            else "        –   (nothing to go by)"
        )
        typer.echo(f"{name:17}{figures}")
    least = gradient_threshold_kmhps(max(log.max_gradient_permille for log in read))
    typer.echo(f"Ta must not be below {least:.2f} km/h/s, which the steepest gradient of these logs alone gives.")
    typer.echo("Cant and gradient at the stops (without a stop: of the whole way) are in roll and pitch.")
    typer.echo("Angles and latency go into [motion_sensors.imu]; --out FOLDER writes these logs with them.")


def _pairs(text: str) -> dict[str, str]:
    """`a=b,c=d` as a dictionary. Raises BadParameter."""
    parts = [one.partition("=") for one in text.split(",") if one.strip()]
    if not all(middle and right.strip() for _, middle, right in parts):
        msg = f"{text!r} is not of the form t=COLUMN,ax=COLUMN,…"
        raise typer.BadParameter(msg)
    return {left.strip(): right.strip() for left, _, right in parts}
