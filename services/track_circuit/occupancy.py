"""Occupied or clear, from the level of the received signal relative to a slowly tracked reference.

Rain moves the level of a long circuit by more than a train of poor shunt does, but slowly: so the level is compared
with what it was lately while clear. Whatever is not certain to be clear is occupied. While a train stands long in a
circuit, drying ballast lifts the level to where the clear one was; then only steps upwards, such as weather never
makes, show that it has left: as many decibels as the steps downwards of all trains that entered, one or several.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

Positive = Annotated[float, Meta(gt=0.0)]
HOUR_S: Final = 3_600.0
STEP_DB: Final = 2.0
"""A level so far from its slow part has stepped."""
STEP_S: Final = 5.0
"""Upwards it counts as a step only if it came within this: rain may stop at once, but no ballast dries so."""
DEPTH_TOLERANCE_DB: Final = 4.0
"""By how much less than all drops the rises may be."""


class OccupancySettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Thresholds of a circuit."""

    drop_db: Annotated[float, Meta(ge=1.0, le=40.0)] = 5.0
    """Occupied once the level is so far below the reference."""
    pick_up_db: Annotated[float, Meta(ge=0.0, le=40.0)] = 3.0
    """Clear again only from no further below it than this."""
    drop_s: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.3
    """How long the level must be low."""
    pick_up_s: Annotated[float, Meta(ge=0.0, le=60.0)] = 2.5
    """How long it must be back."""
    follow_db_per_h: Annotated[float, Meta(gt=0.0, le=60.0)] = 20.0
    """How fast the reference may follow while clear. Dry to wet in two hours moves 1 km at 12 kHz by 11 dB/h."""
    telegram_timeout_s: Positive = 3.0
    """Without a good telegram for longer, the most restrictive aspect holds."""
    silence_s: Positive = 1.0
    """Without samples for longer, occupied."""
    needs_telegrams: bool = True
    """Clear only with good telegrams of this very circuit; a neighbour's signal must not clear it."""
    sure_db: Annotated[float, Meta(ge=0.0, le=6.0)] = 2.0
    """While weather may have moved the clear level by no more than this, the level alone tells that a train left."""
    rise_db: Annotated[float, Meta(ge=1.0, le=40.0)] = 6.0
    """Least step upwards that shows it later on."""

    def __post_init__(self) -> None:
        """Refuse a hysteresis that is none."""
        if self.pick_up_db >= self.drop_db:
            msg = f"pick_up_db {self.pick_up_db:g} must be below drop_db {self.drop_db:g}"
            raise ValueError(msg)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Occupied or clear, and why."""

    state: Literal["clear", "occupied"]
    reason: str
    level_db: float | None
    reference_db: float | None
    most_restrictive: bool
    since_s: float


class Occupancy:
    """One circuit's state. Times are seconds of any clock that does not step."""

    def __init__(self, settings: OccupancySettings, now_s: float) -> None:
        """Occupied: nothing is known. `confirm_clear` alone gives it a reference to become clear by."""
        self._settings = settings
        self._state: Literal["clear", "occupied"] = "occupied"
        self._since_s = now_s
        self._reason = "not known since the start"
        self._level_db: float | None = None
        self.reference_db: float | None = None
        self.clear_s: float | None = None
        """When the reference was last known to be right."""
        self._slow_db: float | None = None
        """Under a train: the level as followed no faster than weather moves it; None where nothing is known."""
        self._steps_db = self._lowest_db = 0.0
        """Sum of all steps since it was clear, and the lowest that it was."""
        self._recent: deque[tuple[float, float]] = deque()
        """Times and levels of the last STEP_S; the latest one always."""
        self._low_since_s: float | None = None
        self._high_since_s: float | None = None
        self._heard_s: float | None = None
        self._telegram_s: float | None = None

    def confirm_clear(self, reference_db: float, t_s: float) -> None:
        """A level known to be that of the clear circuit at `t_s`: kept from before, or a person's word.

        Clear is said only once the level has stood there for `pick_up_s`.
        """
        self.reference_db, self.clear_s = reference_db, t_s

    def fresh_level_db(self, t_s: float) -> float | None:
        """The level, if it was heard just now."""
        silent = self._heard_s is None or t_s - self._heard_s > self._settings.silence_s
        return None if silent else self._level_db

    def telegram(self, t_s: float) -> None:
        """A good telegram of this circuit was received."""
        self._telegram_s = t_s if self._telegram_s is None else max(t_s, self._telegram_s)

    def level(self, level_db: float | None, t_s: float) -> None:
        """The level over some tenths of a second that end at `t_s`; None without a signal."""
        gone_s = 0.0 if self._heard_s is None else t_s - self._heard_s
        if gone_s < 0.0:
            return
        self.verdict(t_s)
        self._level_db, self._heard_s = level_db, t_s
        reference = self.reference_db
        if level_db is None or reference is None:
            self._low(t_s, "no signal" if level_db is None else "the clear circuit's level is not known")
            return
        below_db = reference - level_db
        if below_db > self._settings.drop_db:
            self._low(t_s, f"level {below_db:.1f} dB below the reference")
        else:
            self._low_since_s = None
        if self._state == "occupied":
            self._follow_steps(level_db, gone_s, t_s)
            self._pick_up(below_db, t_s)
        else:
            self._follow(level_db, gone_s, t_s)

    def _low(self, t_s: float, reason: str) -> None:
        self._high_since_s = None
        self._low_since_s = t_s if self._low_since_s is None else self._low_since_s
        if self._state == "occupied":
            self._reason = reason
        elif t_s - self._low_since_s >= self._settings.drop_s:
            self._turn("occupied", t_s, reason)

    def _pick_up(self, below_db: float, t_s: float) -> None:
        if (
            below_db > self._settings.pick_up_db
            or (self._settings.needs_telegrams and self._overdue(t_s))
            or not self._left(below_db, t_s)
        ):
            self._high_since_s = None
            return
        self._high_since_s = t_s if self._high_since_s is None else self._high_since_s
        if t_s - self._high_since_s >= self._settings.pick_up_s:
            self._turn("clear", t_s, "level and telegrams as when clear")

    def _left(self, below_db: float, t_s: float) -> bool:
        """The level cannot be that of an occupied circuit which dried meanwhile."""
        moved_db = self._moved_db(t_s)
        if moved_db <= self._settings.sure_db and -below_db <= self._settings.pick_up_db + moved_db:
            return True
        if self._slow_db is None or self._lowest_db > -self._settings.drop_db:
            self._reason = "the reference is too old to tell"
            return False
        rise_db = max(self._settings.rise_db, -self._lowest_db - DEPTH_TOLERANCE_DB)
        if self._steps_db - self._lowest_db < rise_db:
            self._reason = "the level came back without its steps: weather, not a train that left"
            return False
        return True

    def _moved_db(self, t_s: float) -> float:
        """How far weather may have moved the clear level since it was last seen."""
        if self.clear_s is None:
            return math.inf
        return self._settings.follow_db_per_h / HOUR_S * max(t_s - self.clear_s, 0.0)

    def _follow_steps(self, level_db: float, gone_s: float, t_s: float) -> None:
        """Tell steps of the level from weather. Without samples for long nobody knows which it was."""
        while len(self._recent) > 1 and t_s - self._recent[0][0] > STEP_S:
            self._recent.popleft()
        risen_db = level_db - min((level for _, level in self._recent), default=level_db)
        self._recent.append((t_s, level_db))
        if self._slow_db is None:
            return
        if self._settings.follow_db_per_h / HOUR_S * gone_s > self._settings.sure_db:
            self._slow_db = None
            return
        self._slow_db += self._limited(level_db - self._slow_db, gone_s)
        step_db = level_db - self._slow_db
        if abs(step_db) > STEP_DB:
            self._steps_db += min(step_db, risen_db)
            self._lowest_db = min(self._lowest_db, self._steps_db)
            self._slow_db = level_db

    def _follow(self, level_db: float, gone_s: float, t_s: float) -> None:
        """The reference follows while certainly clear, by a bounded rate: a train's step cannot drag it along."""
        if self.reference_db is None or self._low_since_s is not None:
            return
        self.reference_db += self._limited(level_db - self.reference_db, gone_s)
        self.clear_s = t_s

    def _limited(self, difference_db: float, gone_s: float) -> float:
        step_db = self._settings.follow_db_per_h / HOUR_S * min(gone_s, self._settings.silence_s)
        return min(max(difference_db, -step_db), step_db)

    def _overdue(self, t_s: float) -> bool:
        return self._telegram_s is None or t_s - self._telegram_s > self._settings.telegram_timeout_s

    def _turn(self, state: Literal["clear", "occupied"], t_s: float, reason: str) -> None:
        self._state, self._since_s, self._reason = state, t_s, reason
        self._slow_db = self.reference_db if state == "occupied" else None
        self._steps_db = self._lowest_db = 0.0
        self._recent.clear()
        self._high_since_s = None

    def verdict(self, t_s: float) -> Verdict:
        """What holds at `t_s`: time alone can make a circuit occupied, never clear."""
        silent = self._heard_s is None or t_s - self._heard_s > self._settings.silence_s
        overdue = self._overdue(t_s)
        if self._state == "clear" and silent:
            self._turn("occupied", t_s, "no samples")
        if self._state == "clear" and self._settings.needs_telegrams and overdue:
            self._turn("occupied", t_s, "no telegram in time")
        return Verdict(self._state, self._reason, self._level_db, self.reference_db, overdue or silent, self._since_s)
