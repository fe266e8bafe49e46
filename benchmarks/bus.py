"""The bus: a raw Zenoh callback beside ZenohNode, in messages per second and in latency.

Publisher, router and receiver are three processes on the loopback address, linked as in
service (client, router, client). The raw callback only counts; ZenohNode does all that it does
in service (mark, sequence, typed decoding, hand-over to an `async for`). Rounds alternate, so
that whatever else the machine does falls on both alike, and medians are compared.
"""

from __future__ import annotations

import json as json_text
import multiprocessing
import os
import platform
import socket
import statistics
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from multiprocessing.connection import Connection
from pathlib import Path

from benchmarks.bus_roles import LIMIT_S, By, Flow, Published, Received, publish, receive, route

ROUNDS = 5
SPAWN = multiprocessing.get_context("spawn")


@dataclass(frozen=True, slots=True)
class Case:
    """One comparison: who publishes and who receives in its raw and in its ZenohNode rounds."""

    name: str
    flow: Flow
    raw: tuple[By, By]
    node: tuple[By, By]


CASES = (
    Case(
        "receiving, full speed, batched", Flow("batched", 200_000, None, timed=False), ("raw", "raw"), ("raw", "node")
    ),
    Case("receiving, 20 k/s, batched", Flow("batched", 60_000, 20_000.0, timed=True), ("raw", "raw"), ("raw", "node")),
    Case("end to end, 1 k/s, STREAM", Flow("stream", 3_000, 1_000.0, timed=True), ("raw", "raw"), ("node", "node")),
    Case("end to end, full speed, KEPT", Flow("kept", 100_000, None, timed=False), ("raw", "raw"), ("node", "node")),
)
"""`raw` in KEPT are Zenoh's own advanced publisher and subscriber."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Medians over the rounds of one side."""

    received_per_s: float
    received_fraction: float
    p50_us: float | None
    p99_us: float | None
    receiver_cpu_us: float
    published_per_s: float
    publisher_cpu_us: float


@contextmanager
def process(role: Callable[..., None], *arguments: object) -> Iterator[Connection]:
    """A process in a role, and our end of its pipe. It is ended with the `with`."""
    ours, theirs = SPAWN.Pipe()
    worker = SPAWN.Process(target=role, args=(theirs, *arguments), daemon=True)
    worker.start()
    theirs.close()
    try:
        yield ours
        worker.join(LIMIT_S)
    finally:
        worker.kill()
        worker.join()


def answer(pipe: Connection) -> object:
    """What a process says next. Raises RuntimeError when it says nothing for a minute, or has ended."""
    try:
        if pipe.poll(LIMIT_S):
            return pipe.recv()
    except EOFError:
        pass
    msg = "a process of the benchmark ended, or said nothing for a minute"
    raise RuntimeError(msg)


def run_round(endpoint: str, flow: Flow, roles: tuple[By, By]) -> tuple[Published, Received]:
    """One flow from a publisher to a receiver."""
    publisher, receiver = roles
    with process(receive, endpoint, receiver, flow) as receiving:
        answer(receiving)
        with process(publish, endpoint, publisher, flow) as publishing:
            published = answer(publishing)
        received = answer(receiving)
    if not isinstance(published, Published) or not isinstance(received, Received):
        raise TypeError
    return published, received


def figures(flow: Flow, rounds: list[tuple[Published, Received]]) -> Figures:
    """Medians over rounds."""

    def median(of: Callable[[Published, Received], float]) -> float:
        return statistics.median(of(published, received) for published, received in rounds)

    def percentile(fraction: float) -> float | None:
        if not flow.timed:
            return None
        return median(lambda _, r: r.latencies_us[min(len(r.latencies_us) - 1, int(fraction * len(r.latencies_us)))])

    return Figures(
        received_per_s=median(lambda _, r: r.rate_hz),
        received_fraction=median(lambda _, r: r.count / flow.count),
        p50_us=percentile(0.5),
        p99_us=percentile(0.99),
        receiver_cpu_us=median(lambda _, r: r.cpu_us),
        published_per_s=median(lambda p, _: p.rate_hz),
        publisher_cpu_us=median(lambda p, _: p.cpu_us),
    )


@dataclass(frozen=True, slots=True)
class Comparison:
    """Raw Zenoh beside ZenohNode in one case."""

    name: str
    raw: Figures
    node: Figures

    @property
    def throughput_ratio(self) -> float:
        """ZenohNode's messages per second over raw Zenoh's."""
        return self.node.received_per_s / self.raw.received_per_s

    @property
    def p99_ratio(self) -> float | None:
        """ZenohNode's 99 % latency over raw Zenoh's."""
        if self.raw.p99_us is None or self.node.p99_us is None:
            return None
        return self.node.p99_us / self.raw.p99_us


def compare(endpoint: str, case: Case, rounds: int) -> Comparison:
    """Rounds of one case, raw and ZenohNode in turn."""
    raw, node = [], []
    for number in range(rounds):
        sys.stderr.write(f"\r\x1b[K{case.name}: round {number + 1} of {rounds}")
        sys.stderr.flush()
        raw.append(run_round(endpoint, case.flow, case.raw))
        node.append(run_round(endpoint, case.flow, case.node))
    sys.stderr.write("\r\x1b[K")
    return Comparison(case.name, figures(case.flow, raw), figures(case.flow, node))


def machine() -> str:
    """Processor, cores, Python, Zenoh, and what else was running."""
    names = [
        line.partition(":")[2].strip()
        for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        if line.startswith("model name")
    ]
    return (
        f"{names[0] if names else platform.machine()}, {len(os.sched_getaffinity(0))} cores, "
        f"Python {platform.python_version()}, eclipse-zenoh {version('eclipse-zenoh')}, "
        f"load average {os.getloadavg()[0]:.1f} at the start"
    )


def table(comparisons: list[Comparison]) -> str:
    """The comparisons as text."""
    lines = [
        f"{'':34}{'received/s':>12}{'of sent':>9}{'p50 us':>9}{'p99 us':>9}{'cpu us':>8}{'sent/s':>11}{'cpu us':>8}"
    ]
    for comparison in comparisons:
        lines.append(comparison.name)
        for who, side in (("raw callback", comparison.raw), ("ZenohNode", comparison.node)):
            p50, p99 = (f"{us:.0f}" if us is not None else "" for us in (side.p50_us, side.p99_us))
            lines.append(
                f"  {who:32}{side.received_per_s:12,.0f}{side.received_fraction:9.1%}{p50:>9}{p99:>9}"
                f"{side.receiver_cpu_us:8.1f}{side.published_per_s:11,.0f}{side.publisher_cpu_us:8.1f}"
            )
        ratios = f"throughput x {comparison.throughput_ratio:.2f}"
        if comparison.p99_ratio is not None:
            ratios = f"p99 x {comparison.p99_ratio:.2f}"
        lines.append(f"  {'ZenohNode over raw':32}{ratios:>12}")
    return "\n".join(lines)


def run(*, json: bool = False, rounds: int = ROUNDS) -> list[Comparison]:
    """Measure, print the table (or JSON) and give the comparisons. Takes about two minutes."""
    about = machine()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with process(route, endpoint) as routing:
        answer(routing)
        comparisons = [compare(endpoint, case, rounds) for case in CASES]
        routing.send("end")
    if json:
        sides = [{"case": c.name, "raw": _plain(c.raw), "node": _plain(c.node)} for c in comparisons]
        ratios = [{"throughput_ratio": c.throughput_ratio, "p99_ratio": c.p99_ratio} for c in comparisons]
        result = {"machine": about, "cases": [side | ratio for side, ratio in zip(sides, ratios, strict=True)]}
        sys.stdout.write(json_text.dumps(result, indent=2) + "\n")
    else:
        sys.stdout.write(f"{about}\n195-byte messages, medians of {rounds} rounds\n{table(comparisons)}\n")
    return comparisons


def _plain(figures: Figures) -> dict[str, float | None]:
    return {name: getattr(figures, name) for name in Figures.__slots__}


def main() -> None:
    """Run from the command line; `--json` prints JSON."""
    run(json="--json" in sys.argv[1:])


if __name__ == "__main__":
    main()
