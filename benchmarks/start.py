"""Start: how long a user waits for help, and for the first live fix of the demonstration."""

from __future__ import annotations

import json as json_text
import os
import socket
import statistics
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.bus import machine
from benchmarks.comparison import seconds

ROUNDS = 5
KIROTEI = str(Path(sys.executable).with_name("kirotei"))
ZENOH = str(Path(sys.executable).with_name("zenoh"))
LIMIT_S = 60.0


@dataclass(frozen=True, slots=True)
class Start:
    """Medians [s]."""

    help_s: float
    first_fix_s: float


def help_once() -> None:
    """`kirotei --help`."""
    subprocess.run([KIROTEI, "--help"], check=True, capture_output=True, timeout=LIMIT_S)


def first_fix_once() -> float:
    """From typing `kirotei up` until the stock zenoh command has printed the first live fix [s]."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    environment = os.environ | {
        "KIROTEI__ROUTER__LISTEN": json_text.dumps([endpoint]),
        "KIROTEI__BUS__CONNECT": json_text.dumps([endpoint]),
        "PYTHONUNBUFFERED": "1",
    }
    command = [ZENOH, "--mode", "client", "--connect", endpoint, "--cfg", "connect/timeout_ms:-1"]
    command += ["subscribe", "-k", "kirotei/v1/*/train/*/gnss/*/fix", "--decoder", "kirotei", "--line", "{value}"]
    started = time.perf_counter()
    with (
        subprocess.Popen([KIROTEI, "up"], env=environment, stdout=subprocess.DEVNULL) as host,
        subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as viewer,
    ):
        try:
            if viewer.stdout is None or not any('"status":"fix"' in line for line in viewer.stdout):
                msg = "no fix came"
                raise RuntimeError(msg)
            return time.perf_counter() - started
        finally:
            viewer.kill()
            host.terminate()


def run(*, json: bool = False, rounds: int = ROUNDS) -> Start:
    """Measure, print (or JSON) and give the result. The very first start, which compiles, is not counted."""
    about = machine()
    help_once()
    first_fix_once()
    start = Start(
        statistics.median(seconds(help_once) for _ in range(rounds)),
        statistics.median(first_fix_once() for _ in range(rounds)),
    )
    if json:
        sys.stdout.write(json_text.dumps({"machine": about, **asdict(start)}, indent=2) + "\n")
    else:
        sys.stdout.write(
            f"{about}\nmedians of {rounds}: `kirotei --help` {start.help_s:.2f} s, `kirotei up` to the first live fix "
            f"{start.first_fix_s:.1f} s\n"
        )
    return start
