"""`kirotei warm-up`: compile the numerical kernels once, before anybody waits for them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

SECONDS = 4.0


def warm_up(
    config: Annotated[
        Path | None, typer.Option("--config", help="Profile whose state folder is meant; else the user's own.")
    ] = None,
) -> None:
    """Compile the numerical kernels into the state folder, so that the first start is as quick as the next.

    Installation does this; after an update it takes about half a minute. Example: kirotei warm-up
    """
    from tempfile import TemporaryDirectory
    from typing import get_args

    from services.runtime.config import ConfigError, load_host
    from services.runtime.state_dir import prepare, state_dir

    try:
        profile = load_host(config, os.environ)
    except (ConfigError, OSError) as error:
        typer.echo(f"kirotei warm-up: {error}", err=True)
        raise typer.Exit(1) from error
    warning = prepare(state_dir(os.environ, profile.host.state_dir), os.environ)
    if warning:
        typer.echo(f"kirotei warm-up: {warning}", err=True)
        raise typer.Exit(1)
    typer.echo(f"Compiling kernels into {os.environ['NUMBA_CACHE_DIR']} …")

    from schemas.gnss import Method
    from services.gnss_correction.settings import Config
    from services.gnss_correction.solve_file import solve_file
    from services.simulator.scenario_file import read_scenario
    from services.simulator.simulation_file import write_simulation

    with TemporaryDirectory() as name:
        folder = Path(name)
        write_simulation(read_scenario("street_canyon"), folder, duration_s=SECONDS)
        for method in get_args(Method):
            settings = Config(method=method, compare=(), line_file=str(folder / "track_centreline.csv"))
            solve_file(folder / "rover.obs", [folder / "nav.rnx"], settings, folder / "fixes.csv")
    typer.echo("Done: services start without compiling.")
