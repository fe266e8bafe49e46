"""A simulated train through everything that makes its position, by the pure code that the services run.

Sensors and sky come from services/simulator; odometry, corrected fixes, landmarks and the position follow from them
message by message, in the order and at the times at which the bus would bring them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from schemas.gnss import Fix
from schemas.message import Message
from schemas.motion import ImuBlock, Odometry, SlipEpisode, TachoBlock
from schemas.position import (
    BalisePassage,
    BranchEvidence,
    LandmarkMatch,
    MotionTruth,
    PositionEvent,
    ReferencePass,
    TrainChange,
    TrainPosition,
)
from services.gnss_correction.fix_messages import fixes_of
from services.gnss_correction.line_method import Line as TrackLine
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.settings import Config as GnssConfig
from services.landmark_matching.line_landmarks import LineLandmarks, line_landmarks
from services.landmark_matching.live_matching import LiveMatching
from services.landmark_matching.settings import MatchSettings
from services.line.alignment import alignment_of
from services.line.built_in_file import built_in_line
from services.line.line_file import read_line
from services.odometry_fusion.live_odometry import LiveOdometry
from services.odometry_fusion.settings import Config as OdometryConfig
from services.simulator.constellation import reference_time
from services.simulator.simulation import utc_ns
from services.simulator.train_messages import TrainMessages
from services.simulator.train_scenario import TrainScenario
from services.simulator.train_simulation import Tick, TrainSimulation
from services.train_position.keeper import PositionKeeper
from services.train_position.line_places import LinePlaces
from services.train_position.settings import AntennaPlace
from services.train_position.settings import Config as PositionConfig

DEVICE = "front"
LATENCY_S = 0.3
"""By which the simulated inertial sensor stamps late (docs/simulator.md)."""
START_GPS_NS = 1_458_840_000 * 1_000_000_000
"""A Sunday, two hours after a new set of ephemerides."""


@cache
def demo_places() -> LinePlaces:
    """The demo line as the position sees it."""
    return LinePlaces(built_in_line("demo"))


@cache
def demo_landmarks() -> LineLandmarks:
    """The demo line's landmarks."""
    return line_landmarks(built_in_line("demo"))


def only(known: LineLandmarks, curves: Sequence[str]) -> LineLandmarks:
    """The same line with the landmarks of a few curves alone (`C03`)."""
    rows = {
        branch: tuple(one for one in all_ if one.id.split("-")[0] in curves) for branch, all_ in known.landmarks.items()
    }
    return replace(known, landmarks=rows)


@dataclass
class Judge:
    """One way of making the position: which sources it has, and everything that it said."""

    name: str
    keeper: PositionKeeper
    matching: LiveMatching
    balises: bool = True
    fixes: bool = True
    positions: list[TrainPosition] = field(default_factory=list)
    passes: list[ReferencePass] = field(default_factory=list)
    events: list[PositionEvent] = field(default_factory=list)
    matches: list[LandmarkMatch] = field(default_factory=list)

    def take(self, message: Message) -> None:
        """A message that the position's service would hear, and what follows from it."""
        device = DEVICE if isinstance(message, Fix) else ""
        if (isinstance(message, Fix) and not self.fixes) or (isinstance(message, BalisePassage) and not self.balises):
            return
        found: list[LandmarkMatch | BranchEvidence] = []
        if isinstance(message, Odometry):
            found = self.matching.take_odometry(message)
        for said in self.keeper.on_message(message, device):
            self._note(said)
        for one in found:
            if isinstance(one, LandmarkMatch):
                self.matches.append(one)
            for said in self.keeper.on_message(one):
                self._note(said)

    def _note(self, message: Message) -> None:
        match message:
            case TrainPosition():
                self.positions.append(message)
                self.matching.take_position(message)
            case ReferencePass():
                self.passes.append(message)
            case PositionEvent():
                self.events.append(message)
            case _:
                pass


def judge_of(
    name: str,
    *,
    balises: bool = True,
    fixes: bool = True,
    known: LineLandmarks | None = None,
    places: LinePlaces | None = None,
    **settings: Any,  # noqa: ANN401 - fields of the position's settings
) -> Judge:
    """A position with these sources and settings."""
    config = PositionConfig(antennas={DEVICE: AntennaPlace()}, state=False, **settings)
    matching = LiveMatching(known or demo_landmarks(), MatchSettings(), 0.0, 0.0)
    return Judge(name, PositionKeeper(config, places or demo_places()), matching, balises=balises, fixes=fixes)


@dataclass
class Chain:
    """One simulated train, and the positions made of it in several ways."""

    scenario: TrainScenario
    seed: int
    judges: list[Judge]
    change: Callable[[Message], Iterable[Message]] | None = None
    """What goes wrong with the sensors' messages on their way to the odometry."""
    odometry: OdometryConfig = field(default_factory=lambda: OdometryConfig(imu_latency_s=LATENCY_S))
    truth: list[MotionTruth] = field(default_factory=list)
    episodes: list[SlipEpisode] = field(default_factory=list)
    rows: list[Odometry] = field(default_factory=list)
    changes: list[TrainChange] = field(default_factory=list)
    epochs: int = 0
    fixed: int = 0

    def __post_init__(self) -> None:
        """Put the train at its start."""
        alignment = alignment_of(built_in_line("demo"), self.scenario.journey.branch)
        self.simulation = TrainSimulation(self.scenario, alignment, START_GPS_NS, np.random.default_rng(self.seed))
        self._messages = TrainMessages(self.scenario.motion)
        self.live = LiveOdometry(self.odometry, "T1", 1, None)
        self._gnss = Correction(GnssConfig(compare=()), line=TrackLine(read_line(Path("demo"))))
        self._reference_ns: int | None = None

    @property
    def now_ns(self) -> int:
        """UTC at the end of the newest tick."""
        return utc_ns(self.simulation.next_gps_ns) - 100_000_000

    def tell(self, message: Message) -> None:
        """Give every position a message."""
        for judge in self.judges:
            judge.take(message)

    def run(self, seconds: float, *, until: Callable[[MotionTruth], bool] | None = None) -> None:
        """Go on for so long, or until the truth is as wished."""
        for _ in range(round(seconds * 10)):
            tick = self.simulation.step()
            self._take(tick)
            if until is not None and tick.truth is not None and until(tick.truth):
                return

    def _take(self, tick: Tick) -> None:
        t_ns = utc_ns(tick.gps_ns)
        if tick.truth is not None:
            self.truth.append(tick.truth)
        for change in tick.changes:
            self.changes.append(change)
            self.tell(change)
        for balise in tick.balises:
            self.tell(balise)
        self._sky(tick)
        for block, device in (
            (self._messages.imu(tick.sensors, t_ns), "imu"),
            (self._messages.tacho(tick.sensors, t_ns), "axle1"),
        ):
            if block is not None:
                for message in (block,) if self.change is None else self.change(block):
                    self._moved(message, device)

    def _moved(self, message: Message, device: str) -> None:
        if not isinstance(message, ImuBlock | TachoBlock):
            return
        for found in self.live.take(message, device):
            if isinstance(found, SlipEpisode):
                self.episodes.append(found)
            else:
                self.rows.append(found)
            self.tell(found)

    def _sky(self, tick: Tick) -> None:
        receiver, instant = self.simulation.receiver, tick.instant
        if receiver is None or instant is None or not any(judge.fixes for judge in self.judges):
            return
        if reference_time(tick.gps_ns) != self._reference_ns:
            self._reference_ns = reference_time(tick.gps_ns)
            self._gnss.add(receiver.sky.ionosphere(tick.gps_ns))
            for ephemeris in receiver.sky.ephemerides(tick.gps_ns):
                self._gnss.add(ephemeris)
        (fix,) = fixes_of(self._gnss.epoch(instant.epoch), self._gnss.methods[0])
        self.epochs += 1
        self.fixed += fix.status == "fix"
        self.tell(fix)
