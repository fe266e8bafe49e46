"""Whether the odometry can be relied on, by what no train can do and by how it began.

It is not believed once its speed or way cannot follow what it said while all was well (services.train_position.
sure_instants), when it sees a slip right after sensors were silent (what comes late is no slip), and when it begins
anew under way: it knows one speed alone then, which may be a sliding wheel's. From there on physics bounds the way,
from the last sure instant on. It is believed again after it has been without slips and leaps for longer than slips
last; what it has counted since it began is then believed, too, unless a slip was under way.
"""

from __future__ import annotations

from typing import Final

import msgspec

from schemas.motion import Odometry
from services.train_position.held import Held
from services.train_position.instants import Instant, Physics
from services.train_position.snapshot import Snapshot, Sure
from services.train_position.sure_instants import SETTLED_S, SLACK_MPS, SureInstants

ROUGH_MPS: Final = 3.0
"""Less is known of the speed by an odometry that is just beginning,"""
BEGINNING_S: Final = 3.0
"""which lasts so long."""
STANDING_MPS: Final = 0.3
BLINDLY: Final = "it began under way, and its wheel has not been seen to adhere"


class Reliance:
    """Watches the odometry on behalf of the position."""

    def __init__(self, held: Held) -> None:
        """Nothing has been heard yet."""
        self._held = held
        self._physics = Physics(held.config.most_speed_mps, held.config.most_acceleration_mps2)
        self._sure = SureInstants(self._physics)
        self._slipping = False
        self._began_ns = 0
        self._origin = ""
        self._first_ns = 0
        """Origin of the odometry that was heard last, and when it was heard first."""
        self._unwell_ns: int | None = None
        """When it last said that sensors were missing while it saw no slip."""
        self._changes = held.changes
        self._sense = held.reach.sense
        self._calm: tuple[int, Odometry] | None = None
        """Since when it has been calm while it is not believed, and its newest message of that time."""

    @property
    def newest(self) -> Instant | None:
        """Newest instant that was sure."""
        return self._sure.newest

    def kept(self) -> Sure | None:
        """What a restart needs: the oldest sure instant, its sums counted from now; None where all is well."""
        sure, now = self._sure.oldest, self._held.reach.now
        if sure is None or now is None or not self._slipping:
            return None
        return Sure(
            t_ns=sure.t_ns,
            speed_mps=sure.speed_mps,
            speed_bound_mps=sure.speed_bound_mps,
            least_m=sure.least_m - now.least_m,
            greatest_m=sure.greatest_m - now.greatest_m,
        )

    def restore(self, kept: Snapshot) -> None:
        """Take up what was kept, once the sums begin at it."""
        self._current()
        now, sure = self._held.reach.now, kept.sure
        if now is None or sure is None:
            return
        self._slipping = True
        changes = msgspec.structs.asdict(sure) | {"provisional_m": 0.0}
        self._sure.begin(now._replace(**changes))

    @property
    def slipping(self) -> bool:
        """A slip was under way when the odometry was last believed."""
        return self._slipping

    def begins(self, odometry: Odometry, now: Instant) -> str:
        """Why an odometry that begins anew is not believed at once; empty when it is, or goes on."""
        held = self._held
        if odometry.status != "valid" and odometry.slip == 0:
            self._unwell_ns = odometry.t_ns
        blindly = BLINDLY if self._begins_blindly(odometry) else ""
        if odometry.origin == held.origin or (odometry.t_ns - now.t_ns) / 1e9 > held.config.longest_gap_s:
            return blindly
        self._began_ns = odometry.t_ns
        if self._slipping:
            return "it began anew while the wheels slipped"
        return "it began anew under way" if abs(now.speed_mps) > STANDING_MPS else blindly

    def _begins_blindly(self, odometry: Odometry) -> bool:
        """Whether an odometry that has just begun counts a way, and does not know the train's speed."""
        if odometry.origin != self._origin:
            self._origin, self._first_ns = odometry.origin, odometry.t_ns
        just_begun = odometry.t_ns - self._first_ns < BEGINNING_S * 1e9
        # It may not even know whether the train moves, though the wheels turn.
        unknown = odometry.status != "valid" and odometry.speed_bound_mps > abs(odometry.speed_mps) + ROUGH_MPS
        return just_begun and unknown and abs(odometry.speed_mps) > STANDING_MPS

    def against(self, odometry: Odometry, now: Instant) -> str:
        """Why what a message says, and the instant that it has led to, are not believed; empty when they are."""
        self._current()
        unwell_ns = self._unwell_ns
        begins = odometry.slip != 0 and not self._slipping
        if begins and unwell_ns is not None and odometry.t_ns - unwell_ns < SETTLED_S * 1e9:
            return "it sees a slip right after sensors were silent"
        return self._impossible(now)

    def _impossible(self, now: Instant) -> str:
        if now.t_ns - self._began_ns < BEGINNING_S * 1e9:
            return ""
        return self._sure.against(now, self._held.reach.sense)

    def note(self, odometry: Odometry, now: Instant) -> None:
        """Take over a message that was believed."""
        self._current()
        self._slipping = odometry.slip != 0
        if self._slipping:
            self._sure.slip()
        elif self._is_calm(odometry):
            self._sure.take(now)

    def doubt(self, *, since_sure: bool) -> None:
        """Believe the odometry no longer; `since_sure`: nor what it has said since it was sure."""
        reach, sure = self._held.reach, self._sure.oldest
        now = reach.now
        self._calm = None
        if now is None or sure is None or sure.t_ns >= now.t_ns or not since_sure:
            return
        gained_mps = self._physics.acceleration_mps2 * (now.t_ns - sure.t_ns) / 1e9
        reach.widen(sure)
        reach.doubt_speed(sure.speed_mps, sure.speed_bound_mps + gained_mps)

    def calm(self, odometry: Odometry) -> bool:
        """Whether an odometry that was not believed has been calm for long enough."""
        if self._calm is not None and odometry.origin != self._calm[1].origin:
            self._began_ns = odometry.t_ns
        if odometry.slip != 0 or odometry.status == "lost":
            self._calm = None
            return False
        since_ns = odometry.t_ns
        if self._calm is not None:
            began_ns, before = self._calm
            dt_s = (odometry.t_ns - before.t_ns) / 1e9
            most_mps = self._physics.acceleration_mps2 * dt_s + SLACK_MPS
            most_mps += odometry.speed_bound_mps + before.speed_bound_mps
            beginning = odometry.t_ns - self._began_ns < BEGINNING_S * 1e9
            leaps = abs(odometry.speed_mps - before.speed_mps) > most_mps and not beginning
            if odometry.origin == before.origin and not leaps:
                since_ns = began_ns
        self._calm = (since_ns, odometry)
        unknown = odometry.speed_bound_mps > ROUGH_MPS
        # A train that stands for sure knows its speed.
        stands = self._held.doubted == BLINDLY and odometry.standstill and odometry.status == "valid"
        if not stands and (unknown or odometry.t_ns - since_ns < self._held.config.calm_s * 1e9):
            return False
        self._sure.begin(None)
        self._slipping = False
        return True

    def _is_calm(self, odometry: Odometry) -> bool:
        beginning = odometry.t_ns - self._began_ns < BEGINNING_S * 1e9
        rough = beginning or odometry.speed_bound_mps > ROUGH_MPS
        return odometry.slip == 0 and odometry.status != "lost" and not rough

    def _current(self) -> None:
        """Sums that count otherwise than before tell nothing of those."""
        held = self._held
        if (held.changes, held.reach.sense) != (self._changes, self._sense):
            self._changes, self._sense = held.changes, held.reach.sense
            self._sure.begin(None)
