"""`kirotei bench`: measurements beside what a user would pick instead."""

from __future__ import annotations

import os
from typing import Annotated

import typer

AREAS = (
    "bridge",
    "bus",
    "cloud",
    "gnss",
    "landmarks",
    "motion",
    "position",
    "radio",
    "replay",
    "runs",
    "start",
    "track-circuit",
)


def bench(
    area: Annotated[str | None, typer.Argument(help=f"One of {', '.join(AREAS)}; all when left out.")] = None,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    rounds: Annotated[int, typer.Option(min=1, max=100, help="Rounds; medians are compared.")] = 5,
) -> None:
    """Measure this machine: messages, files, replay and start, as ratios to peers in the same run.

    Needs the source tree. Example: kirotei bench gnss
    """
    from importlib import import_module, util

    from services.runtime.state_dir import prepare, state_dir

    if area is not None and area not in AREAS:
        typer.echo(f"kirotei bench: no area {area!r}; there are: {', '.join(AREAS)}", err=True)
        raise typer.Exit(2)
    if util.find_spec("benchmarks") is None:
        typer.echo("kirotei bench: benchmarks/ is not installed; run this in the source tree (make bench)", err=True)
        raise typer.Exit(1)
    prepare(state_dir(os.environ), os.environ)
    for name in AREAS if area is None else (area,):
        import_module(f"benchmarks.{name.replace('-', '_')}").run(json=as_json, rounds=rounds)
