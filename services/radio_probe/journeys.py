"""Passes of a train: one journey over the line in one direction, named when it begins."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

from schemas.line import Direction
from schemas.position import TrainPosition

NS: Final = 10**9
REVERSAL_M: Final = 100.0
"""A train that sets back less than this is still on the same pass."""
COLD_MOVE_M: Final = 500.0
"""A place that is further off than the train can have gone, by more than this: it was moved while nobody looked."""
PAUSE_S: Final = 1800.0
"""After so long without a place a new pass begins."""
FASTEST_MPS: Final = 100.0


class Journeys:
    """Follows one train's positions and says to which pass each belongs."""

    def __init__(self, train: str) -> None:
        """Begin before the first pass."""
        self._train = train
        self._last: TrainPosition | None = None
        self._facing: Direction | None = None
        self._back_m = 0.0
        self.pass_id = ""
        self.direction: Direction | None = None

    def take(self, position: TrainPosition) -> None:
        """Follow the next position with a place; `pass_id` and `direction` of travel are those of it afterwards.

        A new pass begins when the other cab leads, when the train has set back by REVERSAL_M, was moved, or was not
        seen for PAUSE_S. Before it is known where the front end looks there is no pass.
        """
        facing = position.direction or self._facing
        begins = self._begins(position, facing)
        self._last, self._facing = position, facing
        if begins and facing is not None:
            self.direction = facing
            self._name(position.t_ns)
            self._back_m = 0.0
        elif self._back_m > REVERSAL_M and self.direction is not None:
            self.direction = "down" if self.direction == "up" else "up"
            self._name(position.t_ns)
            self._back_m = 0.0

    def _begins(self, position: TrainPosition, facing: Direction | None) -> bool:
        last = self._last
        if last is None or not self.pass_id or facing != self._facing:
            return True
        gone_s = (position.t_ns - last.t_ns) / NS
        if last.axis_m is None or position.axis_m is None or gone_s > PAUSE_S:
            return True
        if abs(position.axis_m - last.axis_m) > COLD_MOVE_M + FASTEST_MPS * max(gone_s, 0.0):
            return True
        speed_mps = position.speed_mps or 0.0
        onwards_mps = speed_mps if facing == self.direction else -speed_mps
        self._back_m = max(self._back_m - onwards_mps * gone_s, 0.0)
        return False

    def _name(self, t_ns: int) -> None:
        stamp = datetime.fromtimestamp(t_ns // NS, UTC).strftime("%Y%m%dT%H%M%SZ")
        self.pass_id = f"{self._train}-{stamp}-{self.direction}"
