"""A link that is away for long, in real time: `python -m benchmarks.bridge_cut --minutes 60 [--how hole]`.

Two hosts (network namespaces; needs iproute2 and privileges), a bridge on each, events among bulk all
the while. The link is cut, or swallows everything without a word (`hole`), for so long; then it is
back, everything is waited for, and what was said is compared with what the cloud's disk has and
with what a reader in the cloud has heard. A line a minute tells how it goes; the last is the result, JSON.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sqlite3
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import msgspec

from benchmarks.bridge_scene import Scene
from benchmarks.two_hosts import two_hosts

QUIET_S = 10.0
"""Spoken before the link goes."""
TOLD_S = 60.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one outage."""

    how: str
    away_s: float
    said: int
    durable: int
    """Of what was said, durable at the far end."""
    heard: int
    """By the reader in the cloud, each counted once."""
    repeated: int
    out_of_order: int
    backlog: int
    """Records that waited when the link came back."""
    backlog_bytes: int
    drained_s: float
    """From the link's return until the backlog of that moment had been acknowledged."""


async def outage(scene: Scene, how: str, seconds: float, rates_hz: tuple[float, float]) -> Outcome:
    """Take the link away and bring it back. Raises TimeoutError when something never comes."""
    await scene.start(*rates_hz)
    await scene.heard.until("events", 1)
    await asyncio.sleep(QUIET_S)
    fail, heal = {
        "cut": (scene.hosts.cut, scene.hosts.mend),
        "hole": (scene.hosts.swallow, scene.hosts.give_back),
    }[how]
    fail()
    began_s = time.monotonic()
    while (left_s := began_s + seconds - time.monotonic()) > 0.0:
        await asyncio.sleep(min(left_s, TOLD_S))
        waiting, octets, _ = _spool(scene.spool())
        _tell(f"{time.monotonic() - began_s:.0f} s away, {waiting} records wait, {octets} bytes")
    backlog, backlog_bytes, newest = _spool(scene.spool())
    heal()
    back_s = time.monotonic()
    while any(_through(scene.spool())[lane] < last for lane, last in newest.items()):
        if time.monotonic() - back_s > seconds + 60.0:
            msg = "the backlog does not drain"
            raise TimeoutError(msg)
        await asyncio.sleep(0.1)
    drained_s = time.monotonic() - back_s
    _tell(f"backlog acknowledged {drained_s:.1f} s after the link's return")
    counts = await scene.silence()
    for kind, count in counts.items():
        await scene.heard.until(kind, count)
    heard = scene.heard.numbers
    return Outcome(
        how=how,
        away_s=back_s - began_s,
        said=sum(counts.values()),
        durable=_durable(scene.journal()),
        heard=sum(len(set(numbers) & set(range(counts[kind]))) for kind, numbers in heard.items()),
        repeated=sum(len(numbers) - len(set(numbers)) for numbers in heard.values()),
        out_of_order=sum(b <= a for numbers in heard.values() for a, b in pairwise(numbers)),
        backlog=backlog,
        backlog_bytes=backlog_bytes,
        drained_s=drained_s,
    )


def _spool(path: Path) -> tuple[int, int, dict[str, int]]:
    """Records and bytes that wait, and the newest number of each lane."""
    with closing(sqlite3.connect(path, timeout=5.0)) as looking:
        rows = looking.execute("SELECT lane, next, records, bytes FROM lane").fetchall()
    return sum(row[2] for row in rows), sum(row[3] for row in rows), {row[0]: row[1] - 1 for row in rows}


def _through(path: Path) -> dict[str, int]:
    with closing(sqlite3.connect(path, timeout=5.0)) as looking:
        return dict(looking.execute("SELECT lane, through FROM lane").fetchall())


def _durable(path: Path) -> int:
    """Records of the speaker that a journal has ever taken."""
    with closing(sqlite3.connect(path, timeout=5.0)) as looking:
        rows = looking.execute("SELECT state FROM memory WHERE name LIKE '%/speaker%'").fetchall()
    spans = [msgspec.msgpack.decode(state, type=list[int]) for (state,) in rows]
    return sum(last - first + 1 for ends in spans for first, last in zip(ends[::2], ends[1::2], strict=True))


def _tell(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


async def _run(how: str, minutes: float, rates_hz: tuple[float, float]) -> Outcome:
    with two_hosts() as hosts, tempfile.TemporaryDirectory(prefix="kirotei-cut-") as folder:
        async with Scene(hosts, Path(folder)) as scene:
            return await outage(scene, how, 60.0 * minutes, rates_hz)


def main() -> None:
    """Measure and print; ends with 1 when something was lost, repeated or out of order."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--how", choices=("cut", "hole"), default="cut")
    parser.add_argument("--events-hz", type=float, default=4.0)
    parser.add_argument("--bulk-hz", type=float, default=16.0)
    asked = parser.parse_args()
    found = asyncio.run(_run(asked.how, asked.minutes, (asked.events_hz, asked.bulk_hz)))
    sys.stdout.write(json.dumps(asdict(found)) + "\n")
    whole = found.durable == found.heard == found.said and not found.repeated and not found.out_of_order
    raise SystemExit(0 if whole else 1)


if __name__ == "__main__":
    main()
