"""Faults put on passes, and what watchers make of them: placements as the score draws them, slow changes, sites."""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import Protocol

import msgspec
import numpy as np

from benchmarks.radio_recordings import DAY_NS, Frames, Pass, orbit_stretch, redated
from schemas.radio import RadioEvent
from services.radio_anomaly import paper
from services.radio_anomaly.file_analysis import learn
from services.radio_anomaly.passes import binned, section_of
from services.radio_anomaly.radio_model import evidence_of, monitor_of
from services.radio_anomaly.raising import Raiser
from services.radio_anomaly.settings import Settings

D = 100.0
BEGIN_NS = 1_700_006_400 * 10**9


@dataclass(frozen=True, slots=True)
class Told:
    """A confirmed word about a stretch of one pass."""

    kind: str
    start_m: float
    end_m: float


class Watcher(Protocol):
    """What is judged: learns once, then takes passes in order."""

    def step(self, readings: Pass) -> list[Told]:
        """Confirmed events of the next pass."""


class LineWatcher:
    """The default method."""

    def __init__(self, passes: Sequence[Pass]) -> None:
        """Learn."""
        model = learn([one for each in passes for one in each], Settings(), "line", "", Counter())
        self.evidence = model.evidence
        self.monitor = monitor_of(model)
        self.raiser = Raiser(self.monitor, evidence_of(model))

    def events(self, readings: Pass) -> list[RadioEvent]:
        """Every event of the next pass but those that ended."""
        told, _ = self.raiser.take(binned(readings, self.monitor.settings))
        return [event for event in told if event.phase != "ended"]

    def step(self, readings: Pass) -> list[Told]:
        """Confirmed events of the next pass."""
        return [
            Told(event.kind, event.section_start_m, event.section_end_m)
            for event in self.events(readings)
            if event.confirmed
        ]


class PaperWatcher:
    """The paper's rule: any sample beyond A ± 3σ."""

    def __init__(self, passes: Sequence[Pass]) -> None:
        """Learn."""
        self._limits = paper.thresholds_of(paper.sums_of((one for each in passes for one in each), D), 3.0)

    def step(self, readings: Pass) -> list[Told]:
        """Its words are certain at once."""
        return [
            Told(one.kind, one.start * D, (one.start + one.length) * D)
            for one in paper.analyse(readings, self._limits, D, 3.0)
        ]


class AlwaysWatcher:
    """Fires on everything: finds every fault, and is worth nothing."""

    def __init__(self, passes: Sequence[Pass]) -> None:
        """Learn nothing."""
        del passes

    def step(self, readings: Pass) -> list[Told]:
        """Both ways, wherever the train was."""
        places = [one.chainage_m for one in readings if one.chainage_m is not None]
        return [Told(kind, min(places) // D * D, max(places) // D * D + D) for kind in ("above", "below")]


@dataclass(frozen=True, slots=True)
class Fault:
    """A change of power over a stretch from one pass on."""

    name: str
    db: float
    km: float
    wanted: float


FAULTS = (
    Fault("-10 dB on 1 km", -10.0, 1.0, 98.0),
    Fault("+15 dB on 1 km", 15.0, 1.0, 98.0),
    Fault("-5 dB on 1 km", -5.0, 1.0, 75.0),
    Fault("-10 dB on 200 m", -10.0, 0.2, 80.0),
    Fault("+15 dB on 200 m", 15.0, 0.2, 90.0),
)


PAPER_FAULTS = (
    Fault("-10 dB on one section", -10.0, 0.1, 100.0),
    Fault("+15 dB on one section", 15.0, 0.1, 100.0),
    Fault("-10 dB on 1 km", -10.0, 1.0, 100.0),
    Fault("+15 dB on 1 km", 15.0, 1.0, 100.0),
)


def sections_of(readings: Pass) -> Counter[int]:
    """Samples by section."""
    return Counter(section_of(one.chainage_m, D) for one in readings if one.chainage_m is not None)


def shifted(readings: Pass, db: float, start_m: float, end_m: float) -> Pass:
    """A pass with a fault on it."""
    return [
        msgspec.structs.replace(one, power_dbm=max(-140.0, min(-20.0, one.power_dbm + db)))
        if one.power_dbm is not None and one.chainage_m is not None and start_m <= one.chainage_m < end_m
        else one
        for one in readings
    ]


class Placements:
    """A watcher on the later half of the passes: what it says of them as they are, and with faults on them."""

    def __init__(self, watcher: Watcher, learned: Sequence[Pass], later: Sequence[Pass]) -> None:
        """Run over the later passes once, keeping the watcher as it was before each."""
        self._later = later
        seen: dict[int, int] = Counter(section for each in learned for section in sections_of(each))
        known = {section for section, passes in seen.items() if passes >= 5}  # noqa: PLR2004 - as the score has it
        self._cover = [sections_of(each) for each in later]
        cells = {(p, s) for p, cover in enumerate(self._cover) for s, n in cover.items() if n > 1 and s in known}
        self._snapshots: list[Watcher] = []
        flagged = set()
        for number, each in enumerate(later):
            self._snapshots.append(copy.deepcopy(watcher))
            for told in watcher.step(each):
                if told.kind in ("above", "below"):
                    ends = range(int(told.start_m // D), int((told.end_m - 1e-6) // D) + 1)
                    flagged |= {(number, section) for section in ends}
        self.false_alarms = 100.0 * len(flagged & cells) / len(cells)

    def found(self, fault: Fault, placements: int, *, low_m: float, high_m: float) -> tuple[float, int]:
        """Per cent of faults found within three passes over them, and how many counted."""
        rng, hit, count = Random(7), 0, 0  # noqa: S311 - placements, no secret
        for _ in range(placements):
            start_m = rng.uniform(low_m, high_m - 1000.0 * fault.km)
            end_m = start_m + 1000.0 * fault.km
            first = rng.randrange(2, len(self._later) - 6)
            stretch = range(int(start_m // D), int(end_m // D) + 1)
            least = max(2.0, 5.0 * fault.km)
            over = [p for p in range(first, len(self._later)) if sum(self._cover[p][s] for s in stretch) >= least][:3]
            if len(over) == 3:  # noqa: PLR2004 - as the score has it
                count += 1
                hit += self._hit(fault, start_m, end_m, first, over)
        return 100.0 * hit / max(count, 1), count

    def _hit(self, fault: Fault, start_m: float, end_m: float, first: int, over: list[int]) -> bool:
        watcher = copy.deepcopy(self._snapshots[first])
        kind = "below" if fault.db < 0.0 else "above"
        for number in range(first, over[-1] + 1):
            told = watcher.step(shifted(self._later[number], fault.db, start_m, end_m))
            if number in over and any(one.kind == kind and one.start_m < end_m and one.end_m > start_m for one in told):
                return True
        return False


@dataclass(frozen=True, slots=True)
class Slow:
    """What a slow change of -1 dB a day comes to."""

    trials: int
    found: float
    """Per cent found before the level has fallen farther than wanted,"""
    median_db: float
    p90_db: float
    false_alarms: float
    """and false alarms in 60 days without a change."""


def slow_change(
    watcher: LineWatcher, later: Sequence[Pass], trials: int, *, whole: bool, by_db: float, km: tuple[float, float]
) -> Slow:
    """Passes drawn from the later ones, two a day; after five days -1 dB a day, on the whole line or on 1 km."""
    long = [each for each in later if len(sections_of(each)) >= LONG]
    rng = Random(11 if whole else 13)  # noqa: S311 - draws, no secret
    levels, alarms = [], []
    for _ in range(trials):
        drawn = [redated([rng.choice(long)], number, BEGIN_NS) for number in range(NORMAL + 24)]
        start_m = rng.uniform(km[0], km[1] - 1000.0)
        place = (-1e9, 1e9) if whole else (start_m, start_m + 1000.0)
        levels.append(_level_found(copy.deepcopy(watcher), drawn, place))
    for _ in range(max(trials // 4, 1)):
        drawn = [redated([rng.choice(long)], number, BEGIN_NS) for number in range(120)]
        quiet = copy.deepcopy(watcher)
        seen = {
            (event.event_id, event.radio)
            for each in drawn
            for event in quiet.events(each)
            if event.kind == "trend" and (not whole or event.section_end_m - event.section_start_m > WHOLE_M)
        }
        alarms.append(len(seen))
    return Slow(
        trials=trials,
        found=100.0 * sum(level <= by_db for level in levels) / len(levels),
        median_db=float(np.median(levels)),
        p90_db=float(np.percentile(levels, 90)),
        false_alarms=float(np.mean(alarms)),
    )


LONG = 40
"""Sections of a pass that is drawn: the short ones of the road's end say little of the line."""
NORMAL = 10
WHOLE_M = 2000.0
"""Longer trends are those of the whole line."""


def _level_found(watcher: LineWatcher, drawn: list[Pass], place: tuple[float, float]) -> float:
    """Fall [dB] at which a trend, or a confirmed fall, over the place is told first; inf for never."""
    for number, each in enumerate(drawn):
        fall_db = max(each[0].t_ns - drawn[NORMAL][0].t_ns + DAY_NS // 2, 0) / DAY_NS
        events = watcher.events(shifted(each, -fall_db, *place) if number >= NORMAL else each)
        if number >= NORMAL and any(
            event.kind in ("trend", "below")
            and event.confirmed
            and event.score < 0.0
            and event.section_start_m < place[1]
            and event.section_end_m > place[0]
            for event in events
        ):
            return fall_db
    return float("inf")


@dataclass(frozen=True, slots=True)
class Site:
    """ORBIT's links: learned under -20 dBm of noise, judged under -20 and 0 dBm."""

    links: int
    interference: float
    """Per cent of links that were called interference under 0 dBm,"""
    heard_interference: float
    """of those of which anything was heard then,"""
    normal: float
    """and per cent of later -20 dBm stretches of links about which nothing was said, not even unconfirmed."""


STRETCH = 30
LEARNED, JUDGED = 5, 5
FRAMES_LEARNED = 100


def site_links(frames: Frames) -> Site:
    """Stretches of 30 frames as periods."""
    links = sorted(
        link
        for link, heard in frames[-20].items()
        if sum(seq < LEARNED * STRETCH for seq, _ in heard) >= FRAMES_LEARNED
    )
    watcher = LineWatcher([orbit_stretch(frames, -20, number, STRETCH, links) for number in range(LEARNED)])
    wrong = 0
    for number in range(LEARNED, LEARNED + JUDGED):
        events = watcher.events(orbit_stretch(frames, -20, number, STRETCH, links))
        wrong += len({event.radio for event in events})
    called: set[str] = set()
    for number in range(3):
        events = watcher.events(orbit_stretch(frames, 0, number, STRETCH, links))
        called |= {event.radio for event in events if event.confirmed and event.cause == "interference"}
    names = {link: f"{link[0]}>{link[1]}" for link in links}
    heard = [link for link in links if frames[0].get(link)]
    return Site(
        links=len(links),
        interference=100.0 * sum(names[link] in called for link in links) / len(links),
        heard_interference=100.0 * sum(names[link] in called for link in heard) / max(len(heard), 1),
        normal=100.0 * (1.0 - wrong / (len(links) * JUDGED)),
    )
