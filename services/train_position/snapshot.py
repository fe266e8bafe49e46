"""What survives a restart, and how much of it still holds afterwards."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.message import Message
from schemas.motion import Odometry
from schemas.position import Cab
from services.train_position.belief import Alternative
from services.train_position.claims import offsets_of
from services.train_position.estimate import Estimate
from services.train_position.held import Held
from services.train_position.instants import Instant, Scale, Sense
from services.train_position.makeup import Makeup

FORMAT = 1
Number = Annotated[float, Meta(gt=-1e9, lt=1e9)]
Metres = Annotated[float, Meta(ge=0.0, lt=1e9)]
DEEP_M = 1e5
"""A kept interval wider than this tells nothing."""


class Sure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An instant before the slip that was under way; sums counted from the snapshot's."""

    t_ns: int
    speed_mps: Number
    speed_bound_mps: Metres
    least_m: Number
    greatest_m: Number


class Snapshot(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The state of the position at one instant."""

    format: int = FORMAT
    line: str
    line_version: str
    t_ns: int
    origin: str
    distance_m: Number
    way_m: Metres
    excess_m: Metres
    provisional_m: Metres
    share: Annotated[float, Meta(ge=0.0, le=10.0)]
    speed_mps: Number
    speed_bound_mps: Metres
    standstill: bool
    sense: Sense
    least_m: Number | None
    """None: there was no place."""
    greatest_m: Number | None
    axis_m: Number | None
    variance_m2: Metres
    scale: Number
    scale_variance: Metres
    contradicted: bool
    length_m: Metres
    cab: Cab
    ahead_m: Number
    doubt_m: Metres
    learned_least: Number | None
    learned_greatest: Number | None
    turned: bool
    applied_scale: Number = 1.0
    routes: tuple[str, ...]
    route: str | None
    track: str | None
    reference: str
    reference_way_m: Number
    narrowed_way_m: Number
    unconfirmed: str
    lost: str
    sure: Sure | None = None
    """None: the wheels adhered."""
    doubted: str = ""


def snapshot_of(held: Held, sure: Sure | None = None) -> Snapshot | None:
    """State of now, with the sure instant before a slip under way; None before anything was heard."""
    now = held.reach.now
    if now is None:
        return None
    places, estimate, learned = held.places(), held.estimate, held.scale.learned
    makeup = held.makeup
    return Snapshot(
        line=held.line.id if held.line is not None else "",
        line_version=held.line.version if held.line is not None else "",
        t_ns=now.t_ns,
        origin="" if held.blind else held.origin,
        distance_m=now.distance_m,
        way_m=now.way_m,
        excess_m=now.excess_m,
        provisional_m=now.provisional_m,
        share=held.reach.share,
        speed_mps=now.speed_mps,
        speed_bound_mps=now.speed_bound_mps,
        standstill=held.odometry is not None and held.odometry.standstill and not held.blind,
        sense=held.reach.sense,
        least_m=None if places is None else places.least_m,
        greatest_m=None if places is None else places.greatest_m,
        axis_m=None if places is None else held.estimate_m(places),
        variance_m2=0.0 if estimate is None else estimate.var_m2,
        scale=0.0 if estimate is None else estimate.scale,
        scale_variance=0.0 if estimate is None else estimate.scale_var,
        contradicted=held.belief.contradicted,
        length_m=makeup.length_m,
        cab=makeup.cab,
        ahead_m=makeup.ahead_m,
        doubt_m=makeup.doubt_m,
        learned_least=None if learned is None else learned.least,
        learned_greatest=None if learned is None else learned.greatest,
        turned=held.scale.turned,
        applied_scale=held.scale.applied,
        routes=tuple(sorted(held.branches.possible)),
        route=held.branches.route,
        track=held.track,
        reference=held.reference,
        reference_way_m=held.reference_way_m,
        narrowed_way_m=held.narrowed_way_m,
        unconfirmed=held.unconfirmed,
        lost=held.lost,
        sure=sure,
        doubted=held.doubted,
    )


def restore(held: Held, kept: Snapshot, odometry: Odometry) -> list[Message]:
    """Take up the kept state with the first message of odometry; returns events.

    The make-up, the sense, the wheel's scale and the routes are taken over. The place is, too, when the
    odometry counts on from the same origin (then nothing was missed), or when the gap is short enough for
    physics to bound it. Otherwise the train may have been moved: there is no place until a reference tells one.
    """
    line, version = (held.line.id, held.line.version) if held.line is not None else ("", "")
    if (kept.line, kept.line_version) != (line, version):
        held.lose(
            f"the position kept was of line {kept.line} {kept.line_version}, this is {line} {version}: "
            "a reference must tell the place"
        )
        return [held.event("line_version", held.lost, odometry.t_ns)]
    held.change_makeup(
        held.makeups[0][0],
        Makeup(kept.length_m, kept.cab, kept.ahead_m, kept.doubt_m, held.config.forward),
    )
    if held.reach.sense == 0:
        held.reach.sense = kept.sense
    held.scale.turned, held.scale.applied = kept.turned, kept.applied_scale
    if kept.learned_least is not None and kept.learned_greatest is not None:
        held.scale.learned = Scale(kept.learned_least, kept.learned_greatest)
    if kept.routes and all(held.branches.knows(one) for one in kept.routes):
        held.branches.possible = set(kept.routes)
    held.branches.route, held.track = kept.route, kept.track
    instant = _instant_of(kept)
    held.reach.begin(instant, kept.share)
    held.doubted, held.blind = kept.doubted, bool(kept.doubted)
    if kept.least_m is None or kept.greatest_m is None or kept.greatest_m - kept.least_m > DEEP_M:
        held.lose(f"restarted; before that there was no place either: {kept.lost}")
        return [held.event("restart", held.lost, odometry.t_ns)]
    return _restore_place(held, kept, instant, odometry)


def _instant_of(kept: Snapshot) -> Instant:
    return Instant(
        kept.t_ns,
        kept.distance_m,
        kept.way_m,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        kept.excess_m,
        kept.provisional_m,
        kept.speed_mps,
        kept.speed_bound_mps,
    )


def _restore_place(held: Held, kept: Snapshot, instant: Instant, odometry: Odometry) -> list[Message]:
    least_m, greatest_m = kept.least_m or 0.0, kept.greatest_m or 0.0
    middle_m, half_m = (least_m + greatest_m) / 2.0, max(greatest_m - least_m, 0.0) / 2.0
    away_s = (odometry.t_ns - kept.t_ns) / 1e9
    counts_on = bool(kept.origin) and kept.origin == odometry.origin and not held.reach.refusal(odometry)
    if not counts_on and not 0.0 <= away_s <= held.config.longest_gap_s:
        held.lose(
            f"restarted after {away_s:.0f} s without odometry: the train may have been moved; it was at "
            f"{middle_m:.0f} m ± {half_m:.0f} m, to be confirmed by a reference"
        )
        held.say("restart", kept.t_ns, held.lost, taken=False)
        return [held.event("restart", held.lost, odometry.t_ns)]
    # The interval kept holds the provisional part of the odometry, which the offsets add themselves.
    places = offsets_of(middle_m, max(half_m - 2.0 * instant.provisional_m, 0.0), instant)
    held.belief.alternatives = [Alternative(places, None, ("restart",))]
    held.belief.unsettled = kept.contradicted
    held.estimate = Estimate(kept.axis_m or middle_m, 0.0, kept.scale, 0.0)
    held.estimate.var_m2, held.estimate.scale_var = kept.variance_m2, kept.scale_variance
    held.reference, held.reference_way_m = kept.reference, kept.reference_way_m
    held.narrowed_way_m = kept.narrowed_way_m
    held.origin = kept.origin if counts_on else ""
    how = "carried on by the odometry" if counts_on else f"widened by {away_s:.1f} s without odometry"
    held.confirmed, held.lost = False, ""
    held.unconfirmed = f"restarted: the position of before, {how}, waits for a reference to confirm it"
    if kept.unconfirmed and kept.unconfirmed != held.unconfirmed and "restarted" not in kept.unconfirmed:
        held.unconfirmed = f"{kept.unconfirmed}; {held.unconfirmed}"
    held.say("restart", kept.t_ns, held.unconfirmed, taken=True)
    return [held.event("restart", held.unconfirmed, odometry.t_ns, middle_m)]
