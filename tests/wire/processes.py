"""Processes under test: started with a profile of their own, read line by line, never left behind."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PATIENCE_S = 30.0
"""Starting Python with numpy and Zenoh takes a second; on a busy machine several."""


class Running:
    """A process whose log lines (JSON) are read as they come."""

    def __init__(self, command: list[str], environment: dict[str, str]) -> None:
        """Start it."""
        surroundings = {name: value for name, value in os.environ.items() if not name.startswith(("KIROTEI", "NOTIFY"))}
        self.process = subprocess.Popen(
            command, cwd=ROOT, env=surroundings | environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.lines: list[str] = []
        self.errors: list[str] = []
        self._fresh: queue.Queue[str | None] = queue.Queue()
        self._readers = [threading.Thread(target=self._read), threading.Thread(target=self._read_errors)]
        for reader in self._readers:
            reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as pipe:
            for line in pipe:
                self.lines.append(line.rstrip("\n"))
                self._fresh.put(self.lines[-1])
        self._fresh.put(None)

    def _read_errors(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as pipe:
            self.errors.extend(line.rstrip("\n") for line in pipe)

    def event(self, name: str, *, patience_s: float = PATIENCE_S, **fields: object) -> dict[str, Any]:
        """Next log event of that name with those fields. AssertionError when it does not come."""
        while True:
            event: dict[str, Any] = json.loads(self._next(f"event {name} {fields}", patience_s))
            if event["event"] == name and fields.items() <= event.items():
                return event

    def line_with(self, words: str) -> str:
        """Next line that contains the words. AssertionError when it does not come."""
        while words not in (line := self._next(f"line with {words!r}", PATIENCE_S)):
            pass
        return line

    def _next(self, wanted: str, patience_s: float) -> str:
        try:
            line = self._fresh.get(timeout=patience_s)
        except queue.Empty:
            line = None
        assert line is not None, f"no {wanted}; printed:\n" + "\n".join(self.lines + self.errors)
        return line

    def send(self, number: int) -> None:
        """Send a signal to the process alone."""
        self.process.send_signal(number)

    def ended(self, within_s: float = PATIENCE_S) -> int:
        """Exit code. AssertionError when the process does not end in time."""
        try:
            code = self.process.wait(within_s)
        except subprocess.TimeoutExpired:
            msg = f"still running after {within_s} s; printed:\n" + "\n".join(self.lines + self.errors)
            raise AssertionError(msg) from None
        for reader in self._readers:
            reader.join(5)
        return code

    def events(self) -> list[dict[str, Any]]:
        """Everything printed to standard output; each line must be JSON."""
        return [json.loads(line) for line in self.lines]


@contextmanager
def running(*command: str, **environment: str) -> Iterator[Running]:
    """A Python process (`-m …`), killed at the end if it still lives."""
    process = Running([sys.executable, *command], environment)
    try:
        yield process
    finally:
        if process.process.poll() is None:
            process.send(signal.SIGKILL)
        process.ended()


def write_profile(folder: Path, port: int, *, services: tuple[str, ...] = (), more: str = "") -> Path:
    """Profile of the train demo/T1 whose router listens on a port of the loopback address."""
    path = folder / "host.toml"
    endpoint = f'["tcp/127.0.0.1:{port}"]'
    path.write_text(
        f"services = {json.dumps(services)}\n"
        f'state_dir = "{folder}/state"\n'
        '[place]\nline = "demo"\nkind = "train"\nname = "T1"\n'
        f"[bus]\nconnect = {endpoint}\n[router]\nlisten = {endpoint}\n{more}",
        "utf-8",
    )
    return path


def alive(pid: int) -> bool:
    """True while a process exists and is no zombie."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
