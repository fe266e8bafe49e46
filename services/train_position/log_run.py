"""A whole run through the keeper, offline: what the service would have said of the same messages."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from schemas.message import Message
from schemas.position import PositionEvent, ReferencePass, TrainPosition
from services.train_position.keeper import PositionKeeper


@dataclass(slots=True)
class Said:
    """Everything that was said, by kind."""

    positions: list[TrainPosition] = field(default_factory=list)
    passes: list[ReferencePass] = field(default_factory=list)
    events: list[PositionEvent] = field(default_factory=list)

    def take(self, told: Iterable[Message]) -> None:
        """Sort messages by their kind."""
        for message in told:
            match message:
                case TrainPosition():
                    self.positions.append(message)
                case ReferencePass():
                    self.passes.append(message)
                case PositionEvent():
                    self.events.append(message)
                case _:
                    pass


def run_through(keeper: PositionKeeper, arrivals: Iterable[Message], device: str) -> Said:
    """Give the keeper messages in the order in which they arrive."""
    said = Said()
    for message in arrivals:
        said.take(keeper.on_message(message, device))
    return said
