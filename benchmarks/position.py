"""Whole runs over the demo line: how far the position is wrong, and how far it says that it may be.

    kirotei bench position --rounds 8

Two tables. Whole runs in both directions, onto the branch and with a change of cabs, satellites switched off for 30 %
of the time on top of what tunnels take; and 8 km with five landmarks and odometry alone, as in Iwata et al., figure 5.
`first` is the time until anything has told the first place; before that nothing can be known, which is no loss.
There is no peer to run beside: the tables hold the position against the figures that it must reach. Round k runs with
seed k; round after round the journeys take turns.
"""

from __future__ import annotations

import json as json_text
import math
from dataclasses import asdict, dataclass
from typing import Final, NamedTuple

import msgspec
import numpy as np

from benchmarks.whole_train import Chain, Judge, demo_landmarks, demo_places, judge_of, only
from schemas.gnss import FrontEnd
from schemas.line import Direction
from schemas.position import MotionTruth
from services.simulator.scenario_file import read_any_scenario
from services.simulator.train_scenario import Journey, TimedFault, TrainScenario
from services.train_position.evaluation import Judgement, judge
from services.train_position.positions_file import positions_of, truth_of

LOST_SHARE: Final = 0.3
OUTAGE_S: Final = (20.0, 120.0)
LONGEST_S: Final = 3_000.0
FIVE: Final = ("C03", "C06", "C08", "C10", "C11")
EIGHT_KM_M: Final = 8_000.0
START_BOUND_M: Final = 5.0
STANDING_MPS: Final = 0.01


class Trip(NamedTuple):
    """A journey, and where its run ends."""

    name: str
    journey: Journey
    facing: Direction
    end_m: float
    turned: bool = False
    """It ends only after the cabs have changed."""


TRIPS: Final = (
    Trip("up", Journey(), "up", 25_280.0),
    Trip("down", Journey(direction="down"), "down", 280.0),
    Trip("onto the branch", Journey(branch="akaiwa", start_axis_m=9_600.0), "up", 17_480.0),
    Trip("turning back", Journey(start_axis_m=16_980.0), "up", 13_000.0, turned=True),
)


@dataclass(frozen=True, slots=True)
class Row:
    """Figures of one run with one set of sources."""

    run: str
    sources: str
    seed: int
    positions: int
    first_place_s: float
    """From the first message of the odometry until the first place: nothing can be known before."""
    lost_percent: float
    """Without a place after that."""
    beyond: int
    p50_m: float
    p95_m: float
    largest_m: float
    margin_maxima_m: tuple[float, ...]
    """Largest margin between one reference and the next."""
    slips: int
    references: int
    references_beyond: int
    contradictions: int
    without_fix_percent: float


def scenario_of(journey: Journey, seed: int, *, outages: bool) -> TrainScenario:
    """The demo line's scenario with another journey, and outages of the satellites for LOST_SHARE of the time."""
    scenario = read_any_scenario("demo_line")
    if not isinstance(scenario, TrainScenario):
        msg = "demo_line is no scenario of a train"
        raise TypeError(msg)
    faults: list[TimedFault] = []
    generator = np.random.default_rng([seed, 30])
    at_s = 40.0
    while outages and at_s < LONGEST_S:
        lost_s = float(generator.uniform(*OUTAGE_S))
        # Before and after it satellites are received for as long as makes the share.
        around_s = lost_s * (1.0 / LOST_SHARE - 1.0)
        at_s += float(generator.uniform(0.0, around_s))
        faults.append(TimedFault(kind="gnss_lost", at_s=at_s, seconds=lost_s))
        at_s = faults[-1].at_s + lost_s + around_s / 2.0
    return msgspec.structs.replace(scenario, journey=journey, faults=tuple(faults))


def known_start(chain: Chain, axis_m: float, branch: str = "") -> FrontEnd:
    """The start, known within START_BOUND_M, as all antennas together would tell it."""
    return FrontEnd(
        t_ns=chain.now_ns,
        devices=(),
        agreement="unknown",
        reason="given",
        chainage_m=demo_places().chainage_m(branch, axis_m),
        chainage_bound_m=START_BOUND_M,
    )


def maxima_between_references(found: Judge) -> tuple[float, ...]:
    """Largest margin from the start to the first reference, and from each to the next."""
    teeth: list[float] = [0.0]
    resets = sorted(one.t_ns for one in found.passes)
    for position in found.positions:
        while resets and position.t_ns > resets[0]:
            del resets[0]
            teeth.append(0.0)
        if position.bound_ahead_m is not None and position.bound_behind_m is not None:
            teeth[-1] = max(teeth[-1], position.bound_ahead_m, position.bound_behind_m)
    return tuple(round(one, 1) for one in teeth if one > 0.0)


def row_of(run: str, chain: Chain, found: Judge, seed: int) -> Row:
    """Figures of one position of a chain that has run."""
    figures: Judgement = judge(positions_of(run, found.positions), truth_of(chain.truth))
    known = [one for one in found.positions if one.axis_m is not None]
    after = [one for one in found.positions if known and one.t_ns >= known[0].t_ns]
    return Row(
        run=run,
        sources=found.name,
        seed=seed,
        positions=figures.rows,
        first_place_s=round((known[0].t_ns - found.positions[0].t_ns) / 1e9, 1) if known else math.inf,
        lost_percent=round(100.0 * sum(one.axis_m is None for one in after) / max(len(after), 1), 2),
        beyond=figures.compared - figures.within,
        p50_m=round(figures.median_error_m, 2),
        p95_m=round(figures.p95_error_m, 2),
        largest_m=round(figures.largest_error_m, 2),
        margin_maxima_m=maxima_between_references(found),
        slips=sum(one.phase == "began" for one in chain.episodes),
        references=len(found.passes),
        references_beyond=sum(not one.within for one in found.passes),
        contradictions=sum(one.kind == "contradiction" for one in found.events),
        without_fix_percent=round(100.0 * (1.0 - chain.fixed / chain.epochs), 1) if chain.epochs else 100.0,
    )


def whole_run(trip: Trip, seed: int) -> list[Row]:
    """One run of a journey to its end, with all sources and without balises."""
    judges = [
        judge_of("all", facing=trip.facing),
        judge_of("no balises", facing=trip.facing, balises=False),
    ]
    chain = Chain(scenario_of(trip.journey, seed, outages=True), seed, judges)
    rises = trip.facing == "up"

    def arrived(truth: MotionTruth) -> bool:
        there = truth.axis_m >= trip.end_m if rises != trip.turned else truth.axis_m <= trip.end_m
        return there and bool(chain.changes or (not trip.turned and truth.speed_mps < STANDING_MPS))

    chain.run(LONGEST_S, until=arrived)
    return [row_of(trip.name, chain, one, seed) for one in judges]


def eight_kilometres(seed: int) -> Row:
    """8 km with five landmarks: no satellites, no balises, the start known."""
    found = judge_of(
        "odometry, 5 landmarks", facing="up", balises=False, fixes=False, known=only(demo_landmarks(), FIVE)
    )
    scenario = msgspec.structs.replace(scenario_of(Journey(), seed, outages=False), gnss=None)
    chain = Chain(scenario, seed, [found])
    chain.run(0.1)
    start_m = chain.truth[-1].axis_m
    chain.tell(known_start(chain, start_m))
    chain.run(LONGEST_S, until=lambda truth: truth.axis_m >= start_m + EIGHT_KM_M)
    return row_of("8 km", chain, found, seed)


HEADER: Final = (
    f"{'run':<17}{'sources':<23}{'seed':>5}{'positions':>10}{'first':>7}{'lost':>6}{'no fix':>8}{'slips':>6}{'refs':>5}"
    f"{'beyond':>7}{'50 %':>6}{'95 %':>6}{'max':>6}{'margin':>8}{'largest':>8}"
)


def line_of(row: Row) -> str:
    """A line of the table."""
    return (
        f"{row.run:<17}{row.sources:<23}{row.seed:>5}{row.positions:>10}"
        f"{row.first_place_s:>6.0f}s{row.lost_percent:>5.1f}%"
        f"{row.without_fix_percent:>7.1f}%{row.slips:>6}{row.references:>5}{row.beyond + row.references_beyond:>7}"
        f"{row.p50_m:>6.2f}{row.p95_m:>6.2f}{row.largest_m:>6.2f}"
        f"{float(np.median(row.margin_maxima_m)):>8.1f}{max(row.margin_maxima_m):>8.1f}"
    )


def summary(rows: list[Row], short: list[Row]) -> str:
    """What the tables come to."""
    count, beyond = sum(one.positions for one in rows + short), sum(one.beyond for one in rows + short)
    teeth = [one for row in short for one in row.margin_maxima_m]
    return (
        f"beyond the bound: {beyond} of {count}; largest 95 % error of a whole run "
        f"{max((one.p95_m for one in rows), default=0.0):.2f} m (wanted 3); 8 km: median of maxima "
        f"{float(np.median(teeth)):.1f} m (wanted 60), largest {max(teeth):.1f} m (wanted 80)"
    )


def run(*, json: bool, rounds: int) -> None:
    """Print the tables, a line as soon as a run is done."""
    whole: list[Row] = []
    short: list[Row] = []
    if not json:
        print(HEADER, flush=True)  # noqa: T201 - the command's output
    for k in range(rounds):
        for row in whole_run(TRIPS[k % len(TRIPS)], k + 1):
            whole.append(row)
            if not json:
                print(line_of(row), flush=True)  # noqa: T201 - the command's output
        short.append(eight_kilometres(k + 1))
        if not json:
            print(line_of(short[-1]), flush=True)  # noqa: T201 - the command's output
    if json:
        found = {"whole_runs": [asdict(row) for row in whole], "eight_kilometres": [asdict(row) for row in short]}
        print(json_text.dumps(found, indent=1))  # noqa: T201 - the command's output
        return
    print(summary(whole, short))  # noqa: T201 - the command's output


if __name__ == "__main__":
    run(json=False, rounds=1)
