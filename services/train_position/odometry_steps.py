"""One message of the odometry after the other: steps, repetitions, new origins, silence, and its return."""

from __future__ import annotations

from typing import Final

from schemas.message import Message
from schemas.motion import Odometry
from services.train_position.estimate import Estimate
from services.train_position.held import Held
from services.train_position.instants import Instant, Sense
from services.train_position.interruption import Interruption, advance
from services.train_position.reliance import BLINDLY, ROUGH_MPS, Reliance
from services.train_position.snapshot import Snapshot, Sure, restore
from services.train_position.weighing import weigh

MOST_REFUSED: Final = 20
"""After so many refusals in a row the odometry is taken to count anew, or its clock to have been set."""
HIGHEST_MPS: Final = 300.0
FARTHEST_M: Final = 1e8
"""Beyond these a figure is a mistake."""


class OdometrySteps:
    """Moves what is held along with the odometry."""

    def __init__(self, held: Held, kept: Snapshot | None) -> None:
        """Begin anew, or with what was kept."""
        self._held = held
        self._kept = kept
        self._refused = 0
        self._gone: Interruption | None = None
        self._heard_ns: int | None = None
        self._reliance = Reliance(held)

    def sure(self) -> Sure | None:
        """What a restart needs to know of before a slip that is under way."""
        return self._reliance.kept()

    def step(self, odometry: Odometry) -> list[Message] | None:
        """Take a message; returns events, or None when it was refused and nothing moved."""
        held = self._held
        absurd = _absurd(odometry)
        if absurd:
            held.refuse("odometry", odometry.t_ns, "odometry", absurd)
            return None
        if held.began_ns is None:
            held.began_ns = odometry.t_ns
        told: list[Message] = []
        if self._kept is not None:
            told = restore(held, self._kept, odometry)
            self._reliance.restore(self._kept)
            self._kept = None
        now = held.reach.now
        if now is None:
            held.reach.first(odometry)
        else:
            moved = self._go_on(odometry, now)
            if moved is None:
                return None
            told += moved
        self._refused = 0
        self._heard_ns = odometry.t_ns
        self._note(odometry, now)
        return told + self._judge(odometry)

    def without(self, now_ns: int, first_ns: int | None) -> list[Message] | None:
        """Go on to a time without odometry; None while it speaks, or while there is nothing to go on from."""
        held = self._held
        silent_ns = held.config.silent_s * 1e9
        if self._heard_ns is None and held.reach.now is None:
            if first_ns is None or now_ns - first_ns < silent_ns:
                return [] if first_ns is None else None
            bound_mps = held.config.most_speed_mps
            held.reach.begin(Instant(first_ns, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, bound_mps), 0.0)
            held.began_ns = first_ns
            held.blind = True
        now = held.reach.now
        if now is None or now_ns - now.t_ns < (1 if held.blind else silent_ns):
            return None
        self._leave(now)
        return self._grope(now_ns)

    def _go_on(self, odometry: Odometry, now: Instant) -> list[Message] | None:
        held = self._held
        if odometry.slip == 0:
            held.astray = False
        told = self._doubts(odometry, now)
        if odometry.status == "lost" or held.astray or held.doubted:
            if odometry.t_ns <= now.t_ns:
                return None
            self._leave(held.reach.now or now)
            return told + self._grope(odometry.t_ns, _onward(odometry) if held.doubted == BLINDLY else 0)
        moved = self._take(odometry, now)
        return None if moved is None else told + moved

    def _doubts(self, odometry: Odometry, now: Instant) -> list[Message]:
        """Whether to believe a message at all, as it begins anew or has been calm for long."""
        held = self._held
        if odometry.t_ns <= now.t_ns:
            return []
        if not held.doubted:
            return self._doubt(self._reliance.begins(odometry, now), odometry)
        if self._reliance.calm(odometry):
            held.doubted = ""
            return [held.event("change", "the odometry is believed again: it has been calm", odometry.t_ns)]
        if self._gone is not None:
            self._gone.follow(odometry)
        return []

    def _take(self, odometry: Odometry, now: Instant) -> list[Message] | None:
        """Take a message that is believed; None when it was refused."""
        held = self._held
        if held.blind:
            return self._return(odometry, now)
        if odometry.origin == held.origin:
            return self._same_origin(odometry, now)
        if odometry.t_ns <= now.t_ns:
            held.refuse("odometry", odometry.t_ns, "odometry", "odometry of another origin from before")
            return None
        return self._new_origin(odometry, now)

    def _doubt(self, why: str, odometry: Odometry) -> list[Message]:
        """Believe the odometry no longer, if there is a reason; physics goes on from where it was sure."""
        held, before = self._held, self._held.reach.now
        if not why or before is None:
            return []
        held.doubted = why
        anew, slipping = odometry.origin != held.origin, self._reliance.slipping
        self._reliance.doubt(since_sure=slipping or not anew)
        now = held.reach.now or before
        if held.estimate is not None:
            held.estimate.move(before, now)
        self._gone = Interruption(held, now, takes_word=anew and not slipping)
        if anew:
            self._gone.begin_anew(odometry)
        held.blind = True
        return [held.event("change", f"the odometry is not believed: {why}", odometry.t_ns)]

    def _judge(self, odometry: Odometry) -> list[Message]:
        """Hold what the odometry has led to against physics."""
        held, now = self._held, self._held.reach.now
        if now is None or held.blind:
            return []
        told = self._doubt(self._reliance.against(odometry, now), odometry)
        if told:
            self._confine()
        else:
            self._reliance.note(odometry, now)
        return told

    def _same_origin(self, odometry: Odometry, now: Instant) -> list[Message] | None:
        held = self._held
        refusal = held.reach.refusal(odometry)
        if refusal:
            self._refused += 1
            if self._refused <= MOST_REFUSED:
                held.refuse("odometry", odometry.t_ns, "odometry", refusal)
                return None
            if odometry.t_ns > now.t_ns:
                return self._new_origin(odometry, now)
            return self._set_back(odometry, now)
        advance(held, held.reach, odometry, now)
        return []

    def _set_back(self, odometry: Odometry, now: Instant) -> list[Message]:
        """Its clock was set back: the way it counts goes on, the history cannot be used any more."""
        held = self._held
        held.reach.begin(now._replace(t_ns=odometry.t_ns - 1), held.reach.share)
        self._reliance = Reliance(held)
        counts_on = odometry.way_m >= now.way_m and odometry.excess_m >= now.excess_m
        far_m = held.config.most_speed_mps * held.config.longest_gap_s
        if counts_on and abs(odometry.distance_m - now.distance_m) <= far_m:
            advance(held, held.reach, odometry, now)
            return [held.event("change", "the odometry's clock was set back; its way goes on", odometry.t_ns)]
        advance(held, held.reach, odometry, now)
        held.lose("the odometry's clock was set back and its way jumped: a reference must tell the place")
        return [held.event("change", held.lost, odometry.t_ns)]

    def _new_origin(self, odometry: Odometry, now: Instant) -> list[Message]:
        """The odometry began anew: physics bounds what lies between."""
        held = self._held
        away_s = (odometry.t_ns - now.t_ns) / 1e9
        told: list[Message] = []
        held.scale.restart()
        if away_s > held.config.longest_gap_s and held.belief.alternatives:
            held.lose(f"the odometry began anew after {away_s:.0f} s: a reference must tell the place")
            told = [held.event("change", held.lost, odometry.t_ns)]
        elif held.belief.alternatives:
            text = f"the odometry began anew after {away_s:.1f} s: the bounds grow by what the train can have gone"
            told = [held.event("change", text, odometry.t_ns)]
        self._across(odometry, now)
        return told

    def _across(self, odometry: Odometry, now: Instant) -> None:
        """Go on after a gap; under another origin ways count anew as well."""
        held = self._held
        held.reach.gap(odometry)
        if odometry.origin != held.origin or odometry.way_m < now.way_m:
            anew_m = odometry.way_m - now.way_m
            held.narrowed_way_m += anew_m
            held.reference_way_m += anew_m
            held.belief.since_way_m += anew_m

    def _leave(self, now: Instant) -> None:
        """Remember what was known when the odometry went."""
        held = self._held
        if self._gone is None and not held.blind:
            # What it counts in a slip whose end it cannot find is no way that it could tell later.
            self._gone = Interruption(held, now, takes_word=not held.astray)
        if not held.blind:
            self._doubt_speed(now)
        held.blind = True

    def _doubt_speed(self, now: Instant) -> None:
        """In a slip the odometry's speed may be anything: physics goes on from the one before."""
        held, before = self._held, self._reliance.newest
        slipping = held.odometry is not None and held.odometry.slip != 0
        if before is None or not slipping or before.t_ns >= now.t_ns:
            return
        since_s = (now.t_ns - before.t_ns) / 1e9
        gained_mps = held.config.most_acceleration_mps2 * since_s
        held.reach.doubt_speed(before.speed_mps, before.speed_bound_mps + gained_mps)

    def _grope(self, t_ns: int, onward: Sense = 0) -> list[Message]:
        """Go on by physics alone; the place is lost when nothing has told it for too long."""
        held = self._held
        before = held.reach.now
        held.reach.blind(t_ns, onward)
        now = held.reach.now
        if held.estimate is not None and before is not None and now is not None:
            held.estimate.move(before, now)
        self._confine()
        places = held.places()
        known_ns = max(self._heard_ns or 0, held.satellites_ns or 0)
        too_long = known_ns > 0 and t_ns - known_ns > held.config.longest_gap_s * 1e9
        too_wide = places is not None and places.width_m > held.config.most_known_m and not held.belief.contradicted
        if places is not None and (too_long or too_wide):
            held.lose("no odometry, and nothing else tells the place")
        return []

    def _return(self, odometry: Odometry, now: Instant) -> list[Message] | None:
        """The odometry speaks again: the way it counted meanwhile is a claim beside what is held by now."""
        held = self._held
        if odometry.t_ns <= now.t_ns:
            held.refuse("odometry", odometry.t_ns, "odometry", "odometry of before")
            return None
        carried = None if self._gone is None else self._gone.carried(odometry)
        held.scale.restart()
        self._across(odometry, now)
        held.blind, self._gone = False, None
        if carried is None:
            return []
        after_gap = held.reach.now or now
        if held.estimate is not None:
            held.estimate.move(now, after_gap)
        told = weigh(held, carried.claim, after_gap)
        if held.estimate is not None and not held.belief.contradicted:
            held.estimate = Estimate(
                carried.middle_m, carried.claim.sigma_m, held.estimate.scale, held.scale_now().largest / 3.0
            )
        return told

    def _note(self, odometry: Odometry, before: Instant | None) -> None:
        """Take over what the message says beside the way."""
        held = self._held
        if not held.blind:
            held.origin = odometry.origin
        held.odometry = odometry
        now = held.reach.now
        if held.estimate is not None and before is not None and now is not None and not held.blind:
            held.estimate.move(before, now)
        self._confine()
        if held.stop_demanded and odometry.standstill:
            held.stop_demanded = False
        if odometry.status == "valid":
            held.say("odometry", odometry.t_ns, odometry.reason or "valid", taken=True)
        else:
            held.say(
                "odometry", odometry.t_ns, f"{odometry.status}: {odometry.reason}", taken=odometry.status != "lost"
            )

    def _confine(self) -> None:
        held = self._held
        places = held.places()
        if places is None or held.estimate is None:
            return
        # While sources contradict each other what each of them says is kept, however far apart.
        if places.width_m > held.config.most_known_m and not held.belief.contradicted:
            held.lose(f"the front end may be anywhere within {places.width_m:.0f} m")
            return
        scale = held.scale_now()
        held.estimate.confine(places.least_m, places.greatest_m, scale.least, scale.greatest)


def _onward(odometry: Odometry) -> Sense:
    """The way that the wheels turn, for sure: in a slip an odometry may tell another speed than theirs."""
    if odometry.slip != 0 or abs(odometry.speed_mps) < ROUGH_MPS:
        return 0
    return 1 if odometry.speed_mps > 0.0 else -1


def _absurd(odometry: Odometry) -> str:
    """Why a message cannot be meant; empty when it can."""
    if odometry.t_ns < 0:
        return f"odometry stamped {odometry.t_ns} ns"
    if abs(odometry.speed_mps) > HIGHEST_MPS or odometry.speed_bound_mps > HIGHEST_MPS:
        return f"odometry of {odometry.speed_mps:.0f} m/s ± {odometry.speed_bound_mps:.0f} m/s"
    largest_m = max(abs(odometry.distance_m), odometry.way_m, odometry.excess_m, odometry.provisional_m)
    if largest_m > FARTHEST_M or odometry.share_bound > 1.0:
        return f"odometry with a way of {largest_m:.0f} m and an error of {odometry.share_bound:.0%}"
    return ""
