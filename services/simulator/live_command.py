"""`kirotei simulate --live`: a host per train, each with a simulator; the first one holds the router."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NoReturn

import typer

APART_S = 240.0
"""Between one train of a fleet and the next."""
POLL_S = 0.5
STOP_S = 6.0


def profile_text(scenario: str, number: int, seed: int | None) -> str:
    """Profile of one train's host.

    >>> "under_way_s = 240.0" in profile_text("demo_line", 1, None)
    True
    """
    path = str(Path(scenario).resolve()) if "/" in scenario or scenario.endswith(".toml") else scenario
    lines = [
        'services = ["simulator"]',
        "",
        "[place]",
        'line = "demo"',
        'kind = "train"',
        f'name = "T{number + 1}"',
        "",
    ]
    if number:
        lines += ["[router]", "enabled = false", ""]
    lines += ["[simulator]", f'scenario = "{path}"', f"under_way_s = {APART_S * number}"]
    if seed is not None or number:
        lines.append(f"seed = {(seed or 0) + number}")
    return "\n".join(lines) + "\n"


def run_live(scenario: str, fleet: int, seed: int | None) -> NoReturn:
    """Run the trains until Ctrl-C, SIGTERM or the end of one of them; ends the command."""
    with TemporaryDirectory(prefix="kirotei-") as folder:
        trains: list[subprocess.Popen[bytes]] = []
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
        try:
            for number in range(fleet):
                profile = Path(folder) / f"T{number + 1}.toml"
                profile.write_text(profile_text(scenario, number, seed), "utf-8")
                command = [sys.executable, "-m", "services.cli", "up", "--profile", str(profile)]
                trains.append(subprocess.Popen(command))  # noqa: S603 - our own command with a file of ours
            typer.echo(
                f"{fleet} train(s) on line demo: `kirotei watch` shows them, `kirotei fault slide` disturbs them"
            )
            while all(train.poll() is None for train in trains):
                time.sleep(POLL_S)
        except KeyboardInterrupt:
            pass
        finally:
            for train in trains:
                train.terminate()
            for train in trains:
                with suppress(subprocess.TimeoutExpired):
                    train.wait(STOP_S)
                if train.returncode is None:
                    train.kill()
    failed = [train.returncode for train in trains if train.returncode not in (0, -signal.SIGTERM)]
    raise typer.Exit(1 if failed else 0)
