"""`kirotei track-circuit watch`: its options."""

from __future__ import annotations

from typing import Annotated

import typer


def watch(
    connect: Annotated[str, typer.Option(help="Router.")] = "tcp/127.0.0.1:7447",
    line: Annotated[str, typer.Option(help="Railway line to listen to.")] = "demo",
    seconds: Annotated[float | None, typer.Option(min=0.1, help="End after so long; else Ctrl-C ends it.")] = None,
) -> None:
    """Show track circuits live: clear or occupied, level, error, telegrams, and events as they happen.

    A table on a terminal; elsewhere every event as a line, and every circuit every five seconds.

    Example: kirotei track-circuit watch --line demo
    """
    import msgspec

    from schemas.topic import Place, TopicError
    from services.runtime.host_config import BusConfig
    from services.track_circuit.live_watch_command import run_watch

    try:
        bus = msgspec.convert({"connect": [connect]}, BusConfig)
        place = Place(line, "cloud", "viewers")
    except (msgspec.ValidationError, TopicError) as error:
        typer.echo(f"kirotei track-circuit watch: {error}", err=True)
        raise typer.Exit(2) from error
    run_watch(place, bus, seconds)
