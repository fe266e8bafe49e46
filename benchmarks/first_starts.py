"""First starts of all under way, with a wheel that slips since before: whether odometry and position hold their bounds.

    python -m benchmarks.first_starts [--seeds 1 2]

A train of the demo line comes to 8, 12 and 16 m/s (even seeds: brakes to it); its wheel begins to slide, by 1 m/s to
nearly locked, or to spin; 0.3 to 5 s later odometry and position start with nothing kept, and the slip goes on for 2 to
15 s. Once with satellites once a second (to 5 m), once with a place that is told at the start alone. Prints a line for
every method and slip; `valid after s`: median and longest time from the start, 60 s where it never is.
"""

from __future__ import annotations

import argparse
import copy
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.position import known_start, scenario_of
from benchmarks.whole_train import LATENCY_S, Chain, Judge, judge_of
from schemas.motion import OdometryMethod
from schemas.position import FaultKind
from services.odometry_fusion.live_odometry import LiveOdometry
from services.odometry_fusion.settings import Config
from services.simulator.motion_settings import Adhesion
from services.simulator.train_scenario import Journey

METHODS: Final[tuple[OdometryMethod, ...]] = ("paper", "fused")
SPEEDS_MPS: Final = (8.0, 12.0, 16.0)
TIMES_S: Final = ((0.3, 2.0), (0.8, 12.0), (2.0, 6.0), (5.0, 15.0))
PLACES: Final = ("satellites", "start alone")
ERROR_M: Final = 4.0
RUN_S: Final = 60.0
FASTER_MPS: Final = 3.0
MILLIMETRE_M: Final = 1e-3


class Slip(NamedTuple):
    """A slip that begins before all else does."""

    kind: FaultKind
    slip_mps: float
    before_s: float
    after_s: float


@dataclass
class Sum:
    """What came of the runs of one kind."""

    runs: int = 0
    positions: int = 0
    outside: int = 0
    outside_valid: int = 0
    lost: int = 0
    rows: int = 0
    beyond: int = 0
    beyond_valid: int = 0
    valid_s: list[float] = field(default_factory=list)

    def take(self, chain: Chain, found: Judge) -> None:
        """A run that has ended."""
        true_ns = np.array([one.t_ns for one in chain.truth])
        true_axis_m = np.array([one.axis_m for one in chain.truth])
        self.runs += 1
        self.positions += len(found.positions)
        for one in found.positions:
            self.lost += one.axis_m is None
            if one.axis_m is None or one.bound_ahead_m is None or one.bound_behind_m is None:
                continue
            ahead_m = float(np.interp(one.t_ns, true_ns, true_axis_m)) - one.axis_m
            outside = not -one.bound_behind_m - MILLIMETRE_M <= ahead_m <= one.bound_ahead_m + MILLIMETRE_M
            self.outside += outside
            self.outside_valid += outside and one.status == "valid"
        began_ns = found.positions[0].t_ns
        self.valid_s.append(
            next(((one.t_ns - began_ns) / 1e9 for one in found.positions if one.status == "valid"), RUN_S)
        )
        self._take_rows(chain, true_ns)

    def _take_rows(self, chain: Chain, true_ns: NDArray[np.int64]) -> None:
        true_m = np.array([one.distance_m for one in chain.truth])
        firsts: dict[str, tuple[float, float]] = {}
        for row in chain.rows:
            gone_m = float(np.interp(row.t_ns, true_ns, true_m))
            first_m, first_gone_m = firsts.setdefault(row.origin, (row.distance_m, gone_m))
            beyond = abs(row.distance_m - first_m - (gone_m - first_gone_m)) > row.bound_m + MILLIMETRE_M
            self.rows += 1
            self.beyond += beyond
            self.beyond_valid += beyond and row.status == "valid"


def under_way(seed: int, speed_mps: float, *, braking: bool) -> Chain:
    """A train at a speed."""
    dry = {"adhesion": Adhesion(), "gnss": None}
    chain = Chain(msgspec.structs.replace(scenario_of(Journey(), seed, outages=False), **dry), seed, [])
    chain.run(300.0, until=lambda now: now.speed_mps >= speed_mps + FASTER_MPS * braking)
    if braking:
        chain.run(300.0, until=lambda now: now.speed_mps <= speed_mps)
    return chain


def slips(speed_mps: float) -> Iterator[Slip]:
    """Those of a speed, and none."""
    yield Slip("slide", 0.0, 1.0, 0.0)
    for before_s, after_s in TIMES_S:
        for slide_mps in (1.0, 0.5 * speed_mps, 0.88 * speed_mps):
            yield Slip("slide", slide_mps, before_s, after_s)
        yield Slip("spin", 3.0, before_s, after_s)


def started(train: Chain, slip: Slip, method: OdometryMethod) -> Chain:
    """Odometry and positions of a train from their first start on: with satellites, and without."""
    chain = copy.deepcopy(train)
    if slip.slip_mps:
        seconds = slip.before_s + slip.after_s
        now_s = chain.simulation.now_s
        chain.simulation.faults.switch(slip.kind, now_s=now_s, magnitude=slip.slip_mps, seconds=seconds)
    chain.run(slip.before_s)
    chain.odometry = Config(method=method, imu_latency_s=LATENCY_S)
    chain.judges = [judge_of(place, facing="up", balises=False, fixes=False) for place in PLACES]
    chain.live, chain.rows = LiveOdometry(chain.odometry, "T1", 1, None), []
    generator = np.random.default_rng(chain.seed)
    for second in range(round(RUN_S)):
        chain.run(1.0 if second else 0.1)
        place = known_start(chain, chain.truth[-1].axis_m + float(generator.uniform(-ERROR_M, ERROR_M)))
        for found in chain.judges if not second else chain.judges[:1]:
            found.take(place)
    return chain


def sums_of(seeds: list[int]) -> dict[tuple[str, str, str], Sum]:
    """Runs of the seeds, by method, slip and what tells the place."""
    sums: dict[tuple[str, str, str], Sum] = {}
    for seed, speed_mps in product(seeds, SPEEDS_MPS):
        train = under_way(seed, speed_mps, braking=seed % 2 == 0)
        for slip, method in product(slips(speed_mps), METHODS):
            chain = started(train, slip, method)
            for found in chain.judges:
                key = (method, slip.kind if slip.slip_mps else "none", found.name)
                sums.setdefault(key, Sum()).take(chain, found)
    return sums


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    heads = ("runs", "positions", "outside", "valid", "lost", "rows", "beyond", "valid")
    print(f"{'method':8s}{'slip':7s}{'place':13s}" + "".join(f"{one:>10s}" for one in heads) + "  valid after s")  # noqa: T201 - a table for a person
    for (method, kind, place), one in sorted(sums_of(parser.parse_args().seeds).items()):
        counts = (one.runs, one.positions, one.outside, one.outside_valid, one.lost, one.rows)
        numbers = (*counts, one.beyond, one.beyond_valid)
        times = f"{np.median(one.valid_s):9.1f}{max(one.valid_s):6.1f}"
        print(f"{method:8s}{kind:7s}{place:13s}" + "".join(f"{number:10d}" for number in numbers) + times)  # noqa: T201 - the same


if __name__ == "__main__":
    main()
