"""Reports wait for the positions around their time, and go out with their place."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

import msgspec

from schemas.position import TrainPosition
from schemas.radio import RadioMeasurement
from services.radio_probe.positions import NoPlace, Spot, Timeline

MOST_WAITING: Final = 5_000
MOST_TRAINS: Final = 200


@dataclass(frozen=True, slots=True)
class Joined:
    """A report that is ready, and what is said of its place."""

    device: str
    message: RadioMeasurement
    reason: str
    """Why it has no place; empty when it has one or needs none."""


@dataclass(frozen=True, slots=True)
class _Waiting:
    device: str
    message: RadioMeasurement
    train: str
    until_s: float


class Joiner:
    """Joins reports to the places of the trains that made them, or whose sending they measure."""

    def __init__(self, wait_s: float, largest_gap_s: float, largest_bound_m: float) -> None:
        """Begin with no train known."""
        self._wait_s = wait_s
        self._limits = largest_gap_s, largest_bound_m
        self._trains: dict[str, Timeline] = {}
        self._waiting: deque[_Waiting] = deque()

    def position(self, train: str, position: TrainPosition) -> None:
        """Remember where a train was; of too many trains, the first one heard is forgotten."""
        if train not in self._trains:
            if len(self._trains) >= MOST_TRAINS:
                del self._trains[next(iter(self._trains))]
            self._trains[train] = Timeline(train, *self._limits)
        self._trains[train].take(position)

    def take(self, device: str, message: RadioMeasurement, train: str, now_s: float) -> bool:
        """A report; `train` is the one whose place is its place, empty where there is none to be had.

        One that has brought its place along keeps it. True when it need not wait.
        """
        placed = message.chainage_m is not None or message.axis_m is not None
        until_s = now_s if placed or not train else now_s + self._wait_s
        self._waiting.append(_Waiting(device, message, "" if placed else train, until_s))
        return placed or not train

    def ready(self, now_s: float) -> list[Joined]:
        """Reports whose place is known, or has been waited for long enough, in order of arrival."""
        out: list[Joined] = []
        still: deque[_Waiting] = deque()
        too_many = len(self._waiting) - MOST_WAITING
        for number, one in enumerate(self._waiting):
            if not one.train:
                out.append(Joined(one.device, one.message, ""))
                continue
            timeline = self._trains.get(one.train)
            place = timeline.at(one.message.t_ns) if timeline else None
            if place is None and one.until_s > now_s and number >= too_many:
                still.append(one)
            elif isinstance(place, Spot):
                out.append(Joined(one.device, _placed(one.message, place), ""))
            else:
                reason = place.reason if isinstance(place, NoPlace) else f"no position of {one.train} is heard"
                out.append(Joined(one.device, one.message, reason))
        self._waiting = still
        return out


def _placed(message: RadioMeasurement, spot: Spot) -> RadioMeasurement:
    return msgspec.structs.replace(
        message,
        axis_m=round(spot.axis_m, 2),
        chainage_m=None if spot.chainage_m is None else round(spot.chainage_m, 2),
        place_bound_m=round(spot.bound_m, 2),
        branch=spot.branch,
        direction=spot.direction,
        speed_mps=None if spot.speed_mps is None else round(spot.speed_mps, 2),
        pass_id=spot.pass_id,
    )
