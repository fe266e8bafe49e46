"""How much is gone when sender and bridge die together: `python -m benchmarks.bridge_kill --kills 100`.

While the sender lives it keeps what it has said, and a bridge that comes back fetches what it has missed. When both
are killed -9 at the same moment (the host loses its power), what the spool had not committed is gone. Each
round starts a sender and a bridge, kills both at random, and compares the last publication said with the last one
in the spool: the time between the two [ms], and how many that were. The last line is the result, JSON.
"""

from __future__ import annotations

import argparse
import json
import random
import sqlite3
import statistics
import struct
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.bridge import routers
from benchmarks.bridge_roles import TRAIN, bridge, speak_steadily
from benchmarks.bus import SPAWN, answer
from services.lte_bridge.batch import unpacked
from services.runtime.attachment import Attachment, decode_attachment

SAID = struct.Struct("<qq")
"""Number and time [ns] of the last publication."""
LEAST_S, MOST_S = 0.5, 2.5
PATIENCE_S = 30.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What was gone, over all rounds."""

    kills: int
    rate_hz: float
    said: int
    gone: int
    median_ms: float
    p99_ms: float
    most_ms: float


def round_of(folder: Path, router: str, rate_hz: float, live_s: float) -> tuple[int, int, float]:
    """Publications said and gone, and how long before the end the first of these was said [ms]."""
    said = folder / "said"
    said.write_bytes(SAID.pack(-1, 0))
    settings: dict[str, object] = {"folder": str(folder / "spool"), "far": {"name": "C1"}}
    pipes, workers = [], []
    try:
        for role, arguments in ((bridge, (TRAIN, router, settings)), (speak_steadily, (router, rate_hz, str(said)))):
            ours, theirs = SPAWN.Pipe()
            workers.append(SPAWN.Process(target=role, args=(theirs, *arguments), daemon=True))
            pipes.append(ours)
            workers[-1].start()
            answer(ours)
        limit_s = time.monotonic() + PATIENCE_S
        while last_spooled(folder / "spool" / "spool.sqlite") is None:
            if time.monotonic() > limit_s:
                raise TimeoutError
            time.sleep(0.02)
        time.sleep(live_s)
    finally:
        for worker in workers:
            worker.kill()
        for worker in workers:
            worker.join()
    number, said_ns = SAID.unpack(said.read_bytes())
    spooled = last_spooled(folder / "spool" / "spool.sqlite")
    if spooled is None:
        raise ValueError
    return number + 1, number - spooled.sequence, max(0.0, (said_ns - spooled.sent_ns) / 1e6)


def last_spooled(path: Path) -> Attachment | None:
    """Mark of the newest record of a spool; None while there is none."""
    if not path.exists():
        return None
    try:
        with closing(sqlite3.connect(path, timeout=5.0)) as looking:
            row = looking.execute("SELECT count, body FROM batch WHERE lane = 'bulk' ORDER BY first DESC").fetchone()
    except sqlite3.OperationalError:  # no tables yet
        return None
    return None if row is None else decode_attachment(unpacked(row[1], row[0])[-1].attachment)


def measure(kills: int, rate_hz: float) -> Outcome:
    """Kill so many times."""
    rng = random.Random(1)  # noqa: S311 - picks moments, keeps no secret
    found = []
    with routers(1) as (router,):
        for number in range(kills):
            with tempfile.TemporaryDirectory() as folder:
                found.append(round_of(Path(folder), router, rate_hz, rng.uniform(LEAST_S, MOST_S)))
            sys.stderr.write(f"\r\x1b[K{number + 1} of {kills}: {found[-1][2]:.0f} ms")
    sys.stderr.write("\r\x1b[K")
    times = sorted(one[2] for one in found)
    return Outcome(
        kills=kills,
        rate_hz=rate_hz,
        said=sum(one[0] for one in found),
        gone=sum(one[1] for one in found),
        median_ms=statistics.median(times),
        p99_ms=times[min(len(times) - 1, int(0.99 * len(times)))],
        most_ms=times[-1],
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--rate-hz", type=float, default=1000.0)
    asked = parser.parse_args()
    sys.stdout.write(json.dumps(asdict(measure(asked.kills, asked.rate_hz))) + "\n")


if __name__ == "__main__":
    main()
