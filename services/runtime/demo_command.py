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
    scene: Annotated[
        str, typer.Option(help="train: a train on its line; radio: its radios, a bridge and a cloud that fails.")
    ] = "train",
    picture: Annotated[Path | None, typer.Option(help="Save the last view as this SVG file.")] = None,
    lang: Annotated[str, typer.Option(help="en or ja.")] = "en",
) -> None:
    """Watch a simulated train run its line: its place and bounds by every source, against the truth.

    With --scene radio: faults of radios are found, told, bridged over an outage and remembered.
    Example: kirotei demo --seconds 30
    """
    if scene not in ("train", "radio"):
        typer.echo(f"kirotei demo: --scene {scene}: there are train and radio", err=True)
        raise typer.Exit(2)
    if lang not in ("en", "ja"):
        typer.echo(f"kirotei demo: --lang {lang}: there are en and ja", err=True)
        raise typer.Exit(2)
    if picture is not None and not picture.parent.is_dir():
        typer.echo(f"kirotei demo: there is no folder {picture.parent}", err=True)
        raise typer.Exit(2)
    if scene == "radio":
        from services.runtime.demo_radio import run_demo_radio

        run_demo_radio(seconds)
    from services.runtime.demo import run_demo

    run_demo(seconds, "ja" if lang == "ja" else "en", picture)
