"""Occupied or clear, from the level of the received signal relative to a slowly tracked reference.

Rain moves the level of a long circuit by more than a train of poor shunt does, but slowly: so the level is compared
with what it was lately while clear. Whatever is not certain to be clear is occupied. While a train stands long in a
circuit, drying ballast lifts the level to where the clear one was; then only a step upwards, such as weather never
makes, shows that it has left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

Positive = Annotated[float, Meta(gt=0.0)]
HOUR_S: Final = 3_600.0
ENTRY_S: Final = 10.0
"""The depth of a drop is taken from this long after it began."""
DEPTH_TOLERANCE_DB: Final = 4.0
"""By how much less than the drop the rise may be."""


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
        self._under_db: float | None = None
        self._depth_db = 0.0
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
            self._pick_up(level_db, below_db, t_s)
            self._follow_under(level_db, below_db, gone_s, t_s)
        else:
            self._follow(level_db, gone_s, t_s)

    def _low(self, t_s: float, reason: str) -> None:
        self._high_since_s = None
        self._low_since_s = t_s if self._low_since_s is None else self._low_since_s
        if self._state == "occupied":
            self._reason = reason
        elif t_s - self._low_since_s >= self._settings.drop_s:
            self._turn("occupied", t_s, reason)

    def _pick_up(self, level_db: float, below_db: float, t_s: float) -> None:
        if (
            below_db > self._settings.pick_up_db
            or (self._settings.needs_telegrams and self._overdue(t_s))
            or not self._left(level_db, below_db, t_s)
        ):
            self._high_since_s = None
            return
        self._high_since_s = t_s if self._high_since_s is None else self._high_since_s
        if t_s - self._high_since_s >= self._settings.pick_up_s:
            self._turn("clear", t_s, "level and telegrams as when clear")

    def _left(self, level_db: float, below_db: float, t_s: float) -> bool:
        """The level cannot be that of an occupied circuit which dried meanwhile."""
        moved_db = self._moved_db(t_s)
        if moved_db <= self._settings.sure_db and -below_db <= self._settings.pick_up_db + moved_db:
            return True
        if self._under_db is None:
            self._reason = "the reference is too old to tell"
            return False
        rise_db = max(self._settings.rise_db, self._depth_db - DEPTH_TOLERANCE_DB)
        if level_db - self._under_db < rise_db:
            self._reason = "the level came back without a step: weather, not a train that left"
            return False
        return True

    def _moved_db(self, t_s: float) -> float:
        """How far weather may have moved the clear level since it was last seen."""
        if self.clear_s is None:
            return math.inf
        return self._settings.follow_db_per_h / HOUR_S * max(t_s - self.clear_s, 0.0)

    def _follow_under(self, level_db: float, below_db: float, gone_s: float, t_s: float) -> None:
        """The level under the train, followed no faster than weather moves it."""
        if self._state != "occupied" or below_db <= self._settings.drop_db:
            if self._state == "occupied" and self._under_db is not None and self._high_since_s is None:
                self._under_db += self._limited(level_db - self._under_db, gone_s)
            return
        if self._under_db is None or t_s - self._since_s < ENTRY_S:
            self._under_db = level_db if self._under_db is None else min(self._under_db, level_db)
            self._depth_db = max(self._depth_db, below_db)
            return
        self._under_db += self._limited(level_db - self._under_db, gone_s)

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
        self._under_db, self._depth_db = None, 0.0
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
