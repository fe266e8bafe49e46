"""The radio probe under virtual time, with devices that report and a train whose position is heard."""

from __future__ import annotations

from collections.abc import Callable

from schemas.line import Direction
from schemas.position import TrainPosition
from schemas.radio import RadioMeasurement
from schemas.topic import Place
from schemas.topics import RADIO_MEASUREMENT, RADIO_READING, TRAIN_POSITION, WEATHER
from services.radio_probe.service import SERVICE
from services.radio_probe.settings import Config
from services.runtime.guest import guest
from services.runtime.manual_loop import ManualLoop
from services.runtime.memory_node import MemoryNode
from tests.replay.service_stage import ServiceStage

NS = 10**9
START_NS = 1_793_000_000 * NS
TRAIN = Place("demo", "train", "T1")
SITE = Place("demo", "wayside", "R02")
OUTSIDE = guest(
    "outside", "speaks and listens", reads=(RADIO_MEASUREMENT, WEATHER), writes=(RADIO_READING, TRAIN_POSITION)
)


class ProbeStage(ServiceStage[Config]):
    """The probe, and everything it has published."""

    def __init__(self, loop: ManualLoop, config: Config | None = None, place: Place = TRAIN) -> None:
        super().__init__(loop, SERVICE, config or Config(), outside=OUTSIDE, place=place, start_ns=START_NS)
        self.train = MemoryNode(self.bus, OUTSIDE, TRAIN, self.clock)

    def report(self, t_s: float, **fields: object) -> None:
        """A device's report of a time since the start."""
        known: dict[str, object] = {"radio": "R02", "channel": "ch2", "channel_power_dbm": -70.0}
        message = RadioMeasurement(t_ns=START_NS + round(t_s * NS), **(known | fields))  # type: ignore[arg-type]  # any field
        self.say(self.outside, RADIO_READING, message, device="radio")

    def stand(self, t_s: float, axis_m: float | None, speed_mps: float = 20.0, facing: Direction = "up") -> None:
        """A position of a time since the start; lost without a place."""
        position = TrainPosition(
            t_ns=START_NS + round(t_s * NS),
            status="valid" if axis_m is not None else "lost",
            reason="" if axis_m is not None else "no odometry",
            branch="",
            axis_m=axis_m,
            chainage_m=None if axis_m is None else 4200.0 + axis_m,
            direction=facing,
            speed_mps=speed_mps,
            bound_ahead_m=4.0,
            bound_behind_m=3.0,
        )
        self.say(self.train, TRAIN_POSITION, position)

    def measurements(self) -> list[RadioMeasurement]:
        return [one for one in self.heard if isinstance(one, RadioMeasurement)]

    def run(self, until_s: float, place: Callable[[float], float | None], **fields: object) -> None:
        """A report every half second and positions every tenth, both 0.3 s late, until a time."""
        while (now_s := (self.clock.now_ns() - START_NS) / NS) < until_s:
            tick = round(now_s * 10)
            self.stand((tick - 3) / 10, place((tick - 3) / 10))
            if tick % 5 == 0:
                self.report((tick - 2.5) / 10, **fields)
            self.loop.advance(0.1)
