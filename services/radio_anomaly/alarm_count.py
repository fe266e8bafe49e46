"""How often a model that learns as it goes reports what is normal: every pass judged before it is learned.

A pass that is judged first and learned afterwards is held out by itself (Dawid 1984, the prequential approach). Nobody
says of live passes whether all was normal on them, so an event counts while chance may have made it: over its first
CHANCE_PASSES passes; what is reported longer is taken to be there. Real faults are in the share with their first
passes, so it is rather too high than too low.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from typing import Final

import msgspec

CHANCE_PASSES: Final = 3
"""An event rests on so many passes at most: one odd pass is heard of no longer."""
LEAST_CELLS: Final = 1000.0
"""Pass-sections below which no share is told: at one in a hundred, ten of them."""
KEPT: Final = 0.995
"""Weight of what was counted before, with each pass: half after 138 passes."""

Cell = tuple[tuple[str, str], int]
"""Radio and channel, and section."""


class AlarmCount(msgspec.Struct):
    """Pass-sections judged, and those of them that were reported; older ones weigh less."""

    passes: int = 0
    cells: float = 0.0
    reported: float = 0.0

    def add(self, judged: AbstractSet[Cell], reported: AbstractSet[Cell], lasting: AbstractSet[Cell]) -> None:
        """Count a pass. `lasting` are sections in events of more than CHANCE_PASSES passes: not counted at all.

        >>> count = AlarmCount()
        >>> count.add({(("R", "c"), k) for k in range(2000)}, {(("R", "c"), 7), (("R", "c"), 8)}, {(("R", "c"), 8)})
        >>> round(count.rate, 6)
        0.0005
        """
        if judged:
            self.passes += 1
            self.cells = KEPT * self.cells + len(judged - lasting)
            self.reported = KEPT * self.reported + len((judged & reported) - lasting)

    @property
    def rate(self) -> float | None:
        """Share of pass-sections reported; None with too few."""
        return self.reported / self.cells if self.cells >= LEAST_CELLS else None
