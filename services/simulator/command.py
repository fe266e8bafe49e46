"""`kirotei simulate`: a simulated measurement run into files."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from services.simulator.simulation_file import Written


def simulate(
    scenario: Annotated[str, typer.Argument(help="Scenario in a TOML file, or the name of one that comes with it.")],
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder for the files; made if need be.")],
    seed: Annotated[int | None, typer.Option(min=0, help="Seed in place of the scenario's.")] = None,
    duration: Annotated[
        float | None, typer.Option(min=1.0, max=86_400.0, help="Seconds; one run there and back when left out.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Simulate a train's receiver among buildings: RINEX, truth, line and pseudorange errors into a folder.

    To see a scenario live, set `scenario` in the [simulator] table of a profile and use `kirotei up`.
    Example: kirotei simulate street_canyon --out run1
    """
    from services.simulator.scenario import ScenarioError
    from services.simulator.scenario_file import read_scenario

    try:
        settings = read_scenario(scenario)
    except ScenarioError as error:
        typer.echo(f"kirotei simulate: {error}", err=True)
        raise typer.Exit(2) from error
    if out.exists() and not out.is_dir():
        typer.echo(f"kirotei simulate: {out} is there and is no folder", err=True)
        raise typer.Exit(2)

    from rich.console import Console
    from rich.progress import Progress

    from services.simulator.simulation_file import write_simulation

    console = Console(stderr=True)
    try:
        with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
            task = bar.add_task(f"simulating {settings.name}", total=1.0)
            written = write_simulation(
                settings, out, seed=seed, duration_s=duration, progress=lambda done: bar.update(task, completed=done)
            )
    except OSError as error:
        typer.echo(f"kirotei simulate: {error.filename or out}: {error.strerror}", err=True)
        raise typer.Exit(1) from error
    typer.echo(json.dumps(asdict(written), indent=2) if as_json else _summary(written))


def _summary(written: Written) -> str:
    total = sum(written.reception.values())
    shares = ", ".join(f"{name.replace('_', ' ')} {100 * n / total:.0f} %" for name, n in written.reception.items())
    return (
        f"{written.folder}: {written.epochs} epochs over {written.duration_s:.0f} s, "
        f"{written.satellites:.1f} satellites measured on average\nsignals: {shares or 'none'}"
    )
