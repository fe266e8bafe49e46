"""Occupied or clear, from the level of the received signal relative to a slowly tracked reference.

Rain moves the level of a long circuit by more than a train of poor shunt does, but slowly: so the level is compared
with what it was lately while clear. Whatever is not certain to be clear is occupied.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

Positive = Annotated[float, Meta(gt=0.0)]
DAY_S: Final = 86_400.0


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
    reference_db: float | None = None
    """Level of the clear circuit, as measured when it was set up; None: to be confirmed after every start."""
    reference_reach_db: Annotated[float, Meta(ge=0.0, le=60.0)] = 25.0
    """How far weather moves the clear circuit's level from `reference_db`."""

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
        """Occupied: nothing is known. A circuit becomes clear by `confirm_clear` or a kept reference alone."""
        self._settings = settings
        self._state: Literal["clear", "occupied"] = "occupied"
        self._since_s = now_s
        self._reason = "not known since the start"
        self._level_db: float | None = None
        self.reference_db: float | None = None
        self._low_since_s: float | None = None
        self._high_since_s: float | None = None
        self._heard_s: float | None = None
        self._telegram_s: float | None = None
        self._leave_out = False

    def confirm_clear(self, reference_db: float) -> None:
        """A level known to be that of the clear circuit: kept from before, or a person's word at set-up.

        Clear is said only once the level itself has stood there for `pick_up_s`.
        """
        self.reference_db = reference_db

    def telegram(self, t_s: float) -> None:
        """A good telegram of this circuit was received."""
        self._telegram_s = t_s

    def level(self, level_db: float | None, t_s: float) -> None:
        """The level over some tenths of a second that end at `t_s`; None without a signal."""
        gone_s = 0.0 if self._heard_s is None else t_s - self._heard_s
        if gone_s < 0.0:
            return
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
        self._pick_up(below_db, t_s)
        self._follow(level_db, gone_s)

    def _low(self, t_s: float, reason: str) -> None:
        self._high_since_s = None
        self._low_since_s = t_s if self._low_since_s is None else self._low_since_s
        if self._state == "occupied":
            self._reason = reason
        elif t_s - self._low_since_s >= self._settings.drop_s:
            self._turn("occupied", t_s, reason)

    def _pick_up(self, below_db: float, t_s: float) -> None:
        if below_db > self._settings.pick_up_db or (self._settings.needs_telegrams and self._overdue(t_s)):
            self._high_since_s = None
            return
        self._high_since_s = t_s if self._high_since_s is None else self._high_since_s
        if self._state == "occupied" and t_s - self._high_since_s >= self._settings.pick_up_s:
            self._turn("clear", t_s, "level and telegrams as when clear")

    def _follow(self, level_db: float, gone_s: float) -> None:
        """The reference follows while certainly clear, by a bounded rate: a train's step cannot drag it along."""
        if self._state != "clear" or self.reference_db is None or self._low_since_s is not None:
            return
        step_db = self._settings.follow_db_per_h / 3600.0 * min(gone_s, self._settings.silence_s)
        moved = self.reference_db + min(max(level_db - self.reference_db, -step_db), step_db)
        nominal, reach = self._settings.reference_db, self._settings.reference_reach_db
        self.reference_db = moved if nominal is None else min(max(moved, nominal - reach), nominal + reach)

    def _overdue(self, t_s: float) -> bool:
        return self._telegram_s is None or t_s - self._telegram_s > self._settings.telegram_timeout_s

    def _turn(self, state: Literal["clear", "occupied"], t_s: float, reason: str) -> None:
        self._state, self._since_s, self._reason = state, t_s, reason

    def verdict(self, t_s: float) -> Verdict:
        """What holds at `t_s`: time alone can make a circuit occupied, never clear."""
        silent = self._heard_s is None or t_s - self._heard_s > self._settings.silence_s
        overdue = self._overdue(t_s)
        if self._state == "clear" and silent:
            self._turn("occupied", t_s, "no samples")
            self._high_since_s = None
        if self._state == "clear" and self._settings.needs_telegrams and overdue:
            self._turn("occupied", t_s, "no telegram in time")
            self._high_since_s = None
        return Verdict(self._state, self._reason, self._level_db, self.reference_db, overdue or silent, self._since_s)
