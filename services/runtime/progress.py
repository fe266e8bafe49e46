"""How far a long command is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer


@contextmanager
def progress_of(what: str) -> Iterator[Callable[[float], None]]:
    """To be told the share done: a bar on a terminal, lines where there is none; both on standard error."""
    from rich.console import Console  # noqa: PLC0415 - loads when something takes long
    from rich.progress import Progress  # noqa: PLC0415 - the same

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done: typer.echo(f"{what}: {100.0 * done:.0f} %", err=True)
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda done: bar.update(task, completed=done)
