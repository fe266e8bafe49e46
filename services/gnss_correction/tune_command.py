"""`kirotei gnss tune`: thresholds of a receiver from its recordings."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from services.runtime.progress import progress_of
from services.runtime.told_command import UsageError, told

if TYPE_CHECKING:
    from schemas.thresholds import Thresholds


def table(thresholds: Thresholds) -> str:
    """Thresholds for people."""
    lines = ["system  elevation  threshold  basis          clean of judged   p50    p90    p99  code noise"]
    for band in thresholds.bands:
        if band.judged:
            figures = (band.p50_m, band.p90_m, band.p99_m, band.noise_m)
            lines.append(
                f"{band.system:6s}  {band.lowest_deg:3.0f}–{band.highest_deg:2.0f}°  {band.threshold_m:8.3f} m"
                f"  {band.basis:13s}{band.clean:7d} {band.judged:9d}"
                + "".join(f"{value:7.3f}" if value is not None else "      –" for value in figures)
            )
    return "\n".join(lines)


def tune(
    *,
    rover: Annotated[Path, typer.Option("--rover", help="RINEX observation file.")],
    nav: Annotated[list[Path], typer.Option("--nav", help="RINEX navigation file; may be given several times.")],
    out: Annotated[Path, typer.Option("--out", help="thresholds.toml to write.")],
    receiver: Annotated[
        str | None, typer.Option("--receiver", help="Name kept in the file; default: the recording's.")
    ] = None,
    false_alarms: Annotated[
        float, typer.Option(min=0.0001, max=0.4, help="Share of clean changes that may be flagged.")
    ] = 0.01,
    with_sweep: Annotated[
        bool, typer.Option("--sweep", help="Also set thresholds of 0.3 to 0.8 m against accuracy and fixation rate.")
    ] = False,
    truth: Annotated[Path | None, typer.Option("--truth", help="truth.csv for the sweep.")] = None,
    centreline: Annotated[
        Path | None, typer.Option("--centreline", help="Line file or CSV polyline of the line, for it.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", help="TOML file whose [gnss_correction] table holds settings.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Thresholds of the detector per constellation and elevation, from the clean stretches of a recording.

    Example: kirotei gnss tune --rover rover.obs --nav brdc.nav --out thresholds.toml --sweep --centreline line.csv
    """
    from services.gnss_correction import command

    with told("gnss tune"):
        if with_sweep and truth is None and centreline is None:
            msg = "--sweep needs --truth or --centreline"
            raise UsageError(msg)
        settings = command.configured(config, {"method": "original", "compare": [], "thresholds_file": ""})
        from services.gnss_correction import tune_file
        from services.gnss_correction.evaluation import centreline_of
        from services.gnss_correction.fixes_file import read_truth
        from services.gnss_correction.threshold_sweep import sweep_table
        from services.line.line_file import read_line

        truth_line = read_truth(truth) if truth else None
        line = centreline_of(read_line(centreline)) if centreline else None
        recording = tune_file.read_recording(rover, nav)
        found = tune_file.tune(recording, settings, out, receiver=receiver or rover.stem, false_alarms=false_alarms)
        rows = []
        if with_sweep:
            with progress_of(f"sweeping {rover.name}") as progress:
                rows = tune_file.sweep_recording(recording, settings, truth=truth_line, line=line, progress=progress)
        if as_json:
            whole = {"thresholds": msgspec.to_builtins(found), "sweep": [asdict(row) for row in rows]}
            typer.echo(json.dumps(whole, indent=2))
            return
        typer.echo(f"{out}: thresholds of {found.receiver} from {found.epochs} epochs\n{table(found)}")
        if rows:
            typer.echo(f"\n{'distance to the line' if line else 'error against the truth'}\n{sweep_table(rows)}")
