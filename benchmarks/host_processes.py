"""Processes on hosts of their own, and how they speak with whoever started them.

Each is a Python program that prints one JSON value per line and ends when its standard input does: whoever
starts it uses `running`, `line` and `end`; the program itself `say` and `end_of_input`.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PATIENCE_S = 60.0
"""A process may be slow to start, or the last backlog slow to come, on a machine that stalls."""


@asynccontextmanager
async def running(host: str, *command: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """A Python process on a host; killed at the end when it has not ended by itself."""
    process = await asyncio.create_subprocess_exec(
        *("ip", "netns", "exec", host, sys.executable, *command),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        cwd=ROOT,
        env=dict(os.environ) | {"PYTHONPATH": str(ROOT)},
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


async def line(process: asyncio.subprocess.Process) -> Any:  # noqa: ANN401 - any JSON
    """Next value that a process prints. Raises RuntimeError when it has ended, TimeoutError."""
    assert process.stdout is not None  # noqa: S101 - `running` has piped it
    async with asyncio.timeout(PATIENCE_S):
        text = await process.stdout.readline()
    if not text:
        msg = "a process ended early"
        raise RuntimeError(msg)
    return json.loads(text)


def end(process: asyncio.subprocess.Process) -> None:
    """Tell a process to end."""
    assert process.stdin is not None  # noqa: S101 - `running` has piped it
    process.stdin.close()


def say(value: object) -> None:
    """Print one value, for whoever started this."""
    sys.stdout.write(json.dumps(value) + "\n")
    sys.stdout.flush()


async def end_of_input() -> None:
    """Return when whoever started this wants no more."""
    reader = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    await reader.read()
