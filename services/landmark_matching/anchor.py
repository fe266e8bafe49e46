"""What is held of the train's place, and the search window that follows from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from schemas.line import Direction
from services.landmark_matching.curve_shape import direction_sign


class Held(NamedTuple):
    """Where the sensor is believed to be at one sample, and how far ahead and behind it may be."""

    place_m: float
    behind_m: float
    ahead_m: float


@dataclass(frozen=True, slots=True)
class Anchor:
    """The sensor's place at one distance of the odometry, and how wrong it may be."""

    branch: str
    direction: Direction
    u_m: float
    """Place, rising in the direction of running (services/landmark_matching/curve_shape.py)."""
    distance_m: float
    ahead_m: float
    """How far ahead of `u_m` the sensor may be."""
    behind_m: float
    excess_m: float = 0.0
    """Of the odometry at `distance_m`."""
    share: float = 0.02
    """Error of further distance, as a share of it."""
    gnss: tuple[float, float] | None = None
    """GNSS's place minus `u_m`, and how wrong it may be; None without it."""

    @property
    def axis_m(self) -> float:
        """Place along the axis."""
        return direction_sign(self.direction) * self.u_m

    def place(self, distance_m: float) -> float:
        """Where the sensor is believed to be at another distance."""
        return self.u_m + (distance_m - self.distance_m)

    def growth(self, distance_m: float, excess_m: float) -> float:
        """By how much the window is wider there: a share of the way between, and what slips have added."""
        return self.share * abs(distance_m - self.distance_m) + abs(excess_m - self.excess_m)

    def window(self, distance_m: float, excess_m: float) -> tuple[float, float]:
        """How far behind and how far ahead of `place` the sensor may be: the search window grows with the margin."""
        more_m = self.growth(distance_m, excess_m)
        return self.behind_m + more_m, self.ahead_m + more_m

    def held(self, distance_m: float, excess_m: float) -> Held:
        """Place and window at once."""
        return Held(self.place(distance_m), *self.window(distance_m, excess_m))
