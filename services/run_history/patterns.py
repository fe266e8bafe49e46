"""The five runs that the article colours in a population (Maki et al., section 4.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from services.run_history.run_rows import RunRow

AT_TIME_S: Final = 1.0
ABOUT_S: Final = 3.0
OFFSET_S: Final = 10.0
PatternName = Literal["on_time_saving", "on_time_wasteful", "slower_saving", "faster_saving", "fastest"]


@dataclass(frozen=True, slots=True)
class Pattern:
    """A run that stands for a way of driving; None where no run is such a one."""

    name: PatternName
    row: RunRow | None


def patterns_of(rows: Sequence[RunRow], reference_s: float) -> tuple[Pattern, ...]:
    """Scheduled ± 1 s cheap and dear, about 10 s slower and faster and cheap (± 3 s), and the fastest."""

    def near(offset_s: float, reach_s: float) -> list[RunRow]:
        return [row for row in rows if abs(row.running_time_s - reference_s - offset_s) <= reach_s]

    on_time = near(0.0, AT_TIME_S)
    dearest = _least(on_time, lambda row: -row.energy_kwh) if len(on_time) > 1 else None
    return (
        Pattern("on_time_saving", _least(on_time, lambda row: row.energy_kwh)),
        Pattern("on_time_wasteful", dearest),
        Pattern("slower_saving", _least(near(OFFSET_S, ABOUT_S), lambda row: row.energy_kwh)),
        Pattern("faster_saving", _least(near(-OFFSET_S, ABOUT_S), lambda row: row.energy_kwh)),
        Pattern("fastest", _least(rows, lambda row: row.running_time_s)),
    )


def _least(rows: Sequence[RunRow], by: Callable[[RunRow], float]) -> RunRow | None:
    return min(rows, key=lambda row: (by(row), row.run_id), default=None)
