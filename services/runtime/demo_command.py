"""`kirotei demo`: a simulated train on its line, seen live."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    *,
    seconds: Annotated[
        float | None,
        typer.Option(min=1.0, help="End after this long with positions; else at Ctrl-C (a minute when piped)."),
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="Save the last view as this SVG file.")] = None,
    lang: Annotated[str, typer.Option(help="en or ja.")] = "en",
) -> None:
    """Watch a simulated train run its line: its place and bounds by every source, against the truth.

    Example: kirotei demo --seconds 30
    """
    if lang not in ("en", "ja"):
        typer.echo(f"kirotei demo: --lang {lang}: there are en and ja", err=True)
        raise typer.Exit(2)
    if picture is not None and not picture.parent.is_dir():
        typer.echo(f"kirotei demo: there is no folder {picture.parent}", err=True)
        raise typer.Exit(2)
    from services.runtime.demo import run_demo

    run_demo(seconds, "ja" if lang == "ja" else "en", picture)
