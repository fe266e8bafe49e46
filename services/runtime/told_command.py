"""How commands that work on files tell what went wrong: one clear line, and the exit code."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import typer


class UsageError(ValueError):
    """What was asked for cannot be meant."""


@contextmanager
def told(command: str) -> Iterator[None]:
    """One line on standard error for whatever can go wrong with files and options; exit code 2 for usage, else 1.

    `command` as a person types it after `kirotei`: 'gnss solve'.
    """
    try:
        yield
    except UsageError as error:
        typer.echo(f"kirotei {command}: {error}", err=True)
        raise typer.Exit(2) from error
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        typer.echo(f"kirotei {command}: {where}{error.strerror or error}", err=True)
        raise typer.Exit(1) from error
    except ValueError as error:
        typer.echo(f"kirotei {command}: {error}", err=True)
        raise typer.Exit(1) from error
