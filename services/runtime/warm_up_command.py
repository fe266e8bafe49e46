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

    Installation does this; after an update it takes about a minute. Example: kirotei warm-up
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
    _warm_up_motion()
    _warm_up_runs()
    typer.echo("Done: services start without compiling.")


def _warm_up_motion() -> None:
    """Compile what a whole train's simulation, odometry and landmarks need."""
    from tempfile import TemporaryDirectory
    from typing import get_args

    from schemas.motion import OdometryMethod
    from services.landmark_matching.line_landmarks import line_landmarks
    from services.landmark_matching.profile_walk import warm_up as warm_up_landmarks
    from services.line.line_file import load_line
    from services.odometry_fusion.methods import run_log
    from services.odometry_fusion.motion_log_file import read_motion_log
    from services.odometry_fusion.settings import Config
    from services.simulator.scenario_file import read_any_scenario
    from services.simulator.train_scenario import TrainScenario
    from services.simulator.train_simulation_file import write_train_simulation

    scenario = read_any_scenario("demo_line")
    if not isinstance(scenario, TrainScenario):
        raise TypeError(scenario)
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_train_simulation(scenario, folder, duration_s=SECONDS)
        log = read_motion_log(folder).log
    for method in get_args(OdometryMethod):
        run_log(log, Config(method=method))
    warm_up_landmarks(line_landmarks(load_line(Path("demo")).line, None).routes)


def _warm_up_runs() -> None:
    """Compile what the analysis of runs needs: projection and smoother, by a short run on the demo line."""
    import numpy as np

    from services.line.alignment import alignment_of, routes
    from services.line.line_file import load_line
    from services.run_history.demo_vehicle import demo_vehicle
    from services.run_history.fixes import run_log
    from services.run_history.run_analysis import analyse_run

    line = load_line(Path("demo")).line
    ways = [alignment_of(line, branch) for branch in routes(line)]
    seconds = np.arange(30.0)
    lat, lon, _ = ways[0].position(200.0 + 10.0 * seconds)
    analyse_run(run_log("warm-up", seconds, lat, lon, np.full(30, 10.0)), ways, line.stations, demo_vehicle())
