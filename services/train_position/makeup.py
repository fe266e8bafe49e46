"""The train's make-up: length, leading cab, and where its own unit stands in it.

Either every cab has sensors of its own, and forward is where the leading cab looks (a pulse counter that cannot
tell directions counts like that, too); or sensors are mounted once on a unit, whose cab A is the end that its
forward axis points to, whichever cab leads. Other units may be coupled ahead or behind. From the sensors' end
the front end follows by a lever arm along forward: what is coupled beyond it, or, with cab B leading a unit
whose sensors look to cab A, back by the rest of the train. Cab change, coupling and uncoupling change the
lever arm and so move the front end; where each cab has its own sensors a cab change turns forward round.
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

from schemas.position import Cab, TrainChange

LONGEST_M: Final = 1000.0
"""No train is longer."""
Forward = Literal["cab", "vehicle"]


class Makeup(NamedTuple):
    """How the train is made up."""

    length_m: float
    cab: Cab
    ahead_m: float = 0.0
    """What is coupled beyond the sensors' end (that of the leading cab, or of cab A),"""
    doubt_m: float = 0.0
    """and by how much it may be more or less."""
    forward: Forward = "cab"
    """What the sensors count as forward."""
    flips: int = 0
    """How often that has turned round."""

    @property
    def front_m(self) -> float:
        """Front end, ahead of the sensors' end along forward."""
        return self.ahead_m if self.cab == "A" or self.forward == "cab" else self.ahead_m - self.length_m

    @property
    def sign(self) -> int:
        """+1 when the front end looks forward."""
        return 1 if self.cab == "A" or self.forward == "cab" else -1


class Shift(NamedTuple):
    """How far the front end moved forward, in the sense of before: between these."""

    least_m: float
    greatest_m: float


def refusal(change: TrainChange, makeup: Makeup) -> str:
    """Why a change cannot be meant; empty when it can."""
    if change.length_m is not None and change.length_m > LONGEST_M:
        return f"a train of {change.length_m:.0f} m"
    if change.front_shift_m is not None and abs(change.front_shift_m) > LONGEST_M:
        return f"a front end that moved {change.front_shift_m:.0f} m"
    if change.kind == "cab" and change.cab is None:
        return "a cab change that names no cab"
    if change.kind == "coupled" and change.length_m is not None and change.length_m < makeup.length_m:
        return f"coupled to {change.length_m:.0f} m, shorter than before ({makeup.length_m:.0f} m)"
    if change.kind == "uncoupled" and change.length_m is not None and change.length_m > makeup.length_m:
        return f"uncoupled to {change.length_m:.0f} m, longer than before ({makeup.length_m:.0f} m)"
    return ""


def changed(makeup: Makeup, change: TrainChange) -> tuple[Makeup, Shift]:
    """Make-up after a change, and how the front end moved.

    Coupling without a stated shift may have put everything in front or behind; without a stated length
    the train is as long as any is.
    """
    if change.kind == "cab" and change.cab is not None:
        if change.cab == makeup.cab:
            return makeup, Shift(0.0, 0.0)
        if makeup.forward == "cab":
            other = makeup._replace(cab=change.cab, ahead_m=0.0, doubt_m=0.0, flips=makeup.flips + 1)
            return other, Shift(-makeup.length_m, -makeup.length_m)
        after = makeup._replace(cab=change.cab)
        moved_m = after.front_m - makeup.front_m
        return after, Shift(moved_m, moved_m)
    if change.kind not in {"coupled", "uncoupled"}:
        return makeup, Shift(0.0, 0.0)
    coupled = change.kind == "coupled"
    length_m = change.length_m if change.length_m is not None else (LONGEST_M if coupled else makeup.length_m)
    added_m = length_m - makeup.length_m
    # Towards the front, in the sense of the leading cab.
    if change.front_shift_m is not None:
        forward = (change.front_shift_m, change.front_shift_m)
    elif coupled or change.length_m is not None:
        forward = (min(0.0, added_m), max(0.0, added_m))
    else:
        forward = (-makeup.length_m, 0.0)
    middle_m = (forward[0] + forward[1]) / 2.0
    ahead_m = makeup.ahead_m + (middle_m if makeup.sign > 0 else added_m - middle_m)
    doubt_m = makeup.doubt_m + (forward[1] - forward[0]) / 2.0
    after = makeup._replace(length_m=length_m, ahead_m=ahead_m, doubt_m=doubt_m)
    ends_m = sorted((makeup.sign * forward[0], makeup.sign * forward[1]))
    return after, Shift(ends_m[0], ends_m[1])
