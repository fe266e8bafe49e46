"""Finds landmarks that works have moved.

Three landmarks accepted one after the other say how far the middle one stands from where it should. With d1, d2
the true spacings and r1, r2 measured minus true spacing, a wheel scale e and a shift m of the middle one give

    r1 = e d1 + m,    r2 = e d2 - m    →    e = (r1 + r2) / (d1 + d2),    m = r1 - e d1,

so that no error of the wheel's scale looks like a shift. A shift beyond what the bounds b of the three passages
(TOLD_SHARE of b with b² = b2² + (b1² + b3²)/4) and slips between them explain is reported at once; seen again on
the next passage with the same sign, the landmark is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from schemas.line import Landmark
from services.landmark_matching.diagnoses import Verdict

LONGEST_SPACING_M: Final = 6000.0
"""Landmarks further apart say nothing about shifts: the wheel's scale may have changed between."""
TOLD_SHARE: Final = 0.6
"""Bounds allow for five standard deviations; three are worth telling, since nothing is refused at the first time."""
REFUSED_AFTER: Final = 2
"""Passages in a row that must show the same shift before the landmark is refused."""


@dataclass(frozen=True, slots=True)
class Moved:
    """A landmark that seems to stand elsewhere."""

    landmark: str
    shift_m: float
    """Along the direction of running: the curve stands further by this than the database says."""
    passages: int

    @property
    def text(self) -> str:
        """Words for people."""
        return f"landmark {self.landmark} may have moved by {self.shift_m:+.0f} m ({self.passages} passages)"


@dataclass(frozen=True, slots=True)
class _Passed:
    landmark: Landmark
    u_m: float
    distance_m: float
    excess_m: float
    bound_m: float


@dataclass(slots=True)
class MovedWatch:
    """Remembers the last passages and what they say of each landmark."""

    shifts_m: dict[str, list[float]] = field(default_factory=dict)
    """Shifts seen, newest last, by landmark; emptied by a passage that shows none."""
    _last: list[_Passed] = field(default_factory=list)

    def restart(self) -> None:
        """Forget the passages of this way; the shifts stay."""
        self._last.clear()

    @property
    def moved(self) -> list[Moved]:
        """Landmarks under suspicion."""
        return [Moved(name, sum(seen) / len(seen), len(seen)) for name, seen in self.shifts_m.items() if seen]

    def take(self, landmark: Landmark, verdict: Verdict, excess_m: float) -> str | None:
        """Note a passage that fits; words that refuse it where the landmark is known to have moved.

        Passages refused for their place alone count too: after a moved landmark the next one seems to be elsewhere.
        """
        self._last.append(_Passed(landmark, verdict.u_m, verdict.distance_m, excess_m, verdict.bound_m))
        self._last.sort(key=lambda one: one.distance_m)
        del self._last[:-3]
        if len(self._last) == 3:  # noqa: PLR2004 - the one in the middle has two neighbours
            self._judge_middle()
        seen = self.shifts_m.get(landmark.id, [])
        if len(seen) >= REFUSED_AFTER:
            return f"{self._of(landmark.id).text}; survey it anew"
        return None

    def _of(self, name: str) -> Moved:
        seen = self.shifts_m[name]
        return Moved(name, sum(seen) / len(seen), len(seen))

    def _judge_middle(self) -> None:
        first, middle, last = self._last
        d1, d2 = middle.u_m - first.u_m, last.u_m - middle.u_m
        if not (0.0 < d1 < LONGEST_SPACING_M and 0.0 < d2 < LONGEST_SPACING_M):
            return
        r1 = (middle.distance_m - first.distance_m) - d1
        r2 = (last.distance_m - middle.distance_m) - d2
        shift_m = r1 - (r1 + r2) / (d1 + d2) * d1
        explained_m = math.sqrt(middle.bound_m**2 + 0.25 * (first.bound_m**2 + last.bound_m**2))
        limit_m = TOLD_SHARE * explained_m + last.excess_m - first.excess_m
        seen = self.shifts_m.setdefault(middle.landmark.id, [])
        if abs(shift_m) <= limit_m or (seen and seen[-1] * shift_m < 0.0):
            seen.clear()
        if abs(shift_m) > limit_m:
            seen.append(shift_m)
