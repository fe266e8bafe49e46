"""What a train's radio device said over a run, with the place where the train really was, as passes.csv."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from services.simulator.radio_passes import NS
from services.simulator.radio_passes_file import TOLD
from services.simulator.simulation_file import write_csv
from services.simulator.train_route import TrainRoute
from services.simulator.train_simulation import Tick

HEADER: Final = (
    "time", "pass_id", "radio", "channel", "direction", "chainage_m", "power_dbm", "cell", *TOLD, "speed_mps",
)  # fmt: skip


def write_run(path: Path, ticks: Sequence[Tick], route: TrainRoute) -> None:
    """Write the rows of a run; every trip is a pass. Raises OSError."""
    write_csv(path, HEADER, _rows(ticks, route))


def _rows(ticks: Sequence[Tick], route: TrainRoute) -> Iterator[Sequence[object]]:
    names: dict[int, str] = {}
    for tick in ticks:
        truth = tick.truth
        if truth is None:
            continue
        trip = int(tick.samples.trip[-1])
        direction = "up" if route.rises(trip) else "down"
        names.setdefault(trip, f"T1-{_time(truth.t_ns, '%Y%m%dT%H%M%SZ')}-{direction}")
        for one in tick.readings:
            told = [getattr(one, name) for name in TOLD]
            yield (
                f"{_time(one.t_ns, '%Y-%m-%dT%H:%M:%S')}.{one.t_ns % NS // 1_000_000:03d}Z",
                names[trip], one.radio, one.channel, direction, f"{truth.chainage_m:.2f}", one.channel_power_dbm,
                one.cell, *("" if value is None else value for value in told), f"{truth.speed_mps:.2f}",
            )  # fmt: skip


def _time(t_ns: int, pattern: str) -> str:
    return datetime.fromtimestamp(t_ns // NS, UTC).strftime(pattern)
