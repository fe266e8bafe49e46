"""The position as it is published: estimate, interval, occupied stretch, status with its reasons."""

from __future__ import annotations

import msgspec

from schemas.position import PositionStatus, TrainPosition
from services.train_position.branches import MAIN
from services.train_position.claims import STREAM, Interval
from services.train_position.held import Held
from services.train_position.instants import Instant


def message_of(held: Held, t_ns: int, ahead_ns: int = 0, late_s: float = 0.0) -> TrainPosition:
    """Position at the newest instant, or `ahead_ns` after it by physics; without a place when it is lost.

    `late_s`: by how much the odometry is late, which is why.
    """
    now = held.reach.now if held.reach.now is None or not ahead_ns else held.reach.ahead(t_ns + ahead_ns)
    places = None if now is None else held.places_at(now)
    odometry = held.odometry
    nowhere = TrainPosition(
        t_ns=t_ns + ahead_ns,
        status="lost",
        reason=held.lost,
        train_length_m=held.makeup.length_m,
        direction=held.direction,
        reference=held.reference,
        sources=held.states(t_ns + ahead_ns),
        stop_demanded=held.stop_demanded,
        line_version=held.line.version if held.line is not None else "",
    )
    if odometry is not None and not held.blind and now is not None:
        nowhere = msgspec.structs.replace(
            nowhere,
            speed_mps=odometry.speed_mps * held.makeup.sign + 0.0,  # no minus before a zero
            speed_bound_mps=now.speed_bound_mps if ahead_ns else odometry.speed_bound_mps,
            standstill=odometry.standstill and not ahead_ns,
            slip=odometry.slip,
        )
    if now is None or places is None:
        return nowhere
    status, reason = status_of(held, places, late_s)
    return msgspec.structs.replace(nowhere, status=status, reason=reason, **_placed(held, now, places))


def _placed(held: Held, now: Instant, places: Interval) -> dict[str, object]:
    """Everything that has to do with the place."""
    newest = held.reach.now or now
    axis_m, span = held.estimate_m(places, now.likeliest_m - newest.likeliest_m), held.span(places)
    above_m, below_m = places.greatest_m - axis_m, axis_m - places.least_m
    facing = held.facing
    branch = held.branch(places)
    here = held.branches.of(Interval(axis_m, axis_m), span) if branch is None else branch
    if facing == 0:
        ahead_m = behind_m = max(above_m, below_m)
    else:
        ahead_m, behind_m = (above_m, below_m) if facing > 0 else (below_m, above_m)
    ends: dict[str, object] = {}
    if facing:
        up = facing > 0
        ends = {
            "max_safe_front_end_m": places.greatest_m if up else places.least_m,
            "min_safe_front_end_m": places.least_m if up else places.greatest_m,
            "min_safe_rear_end_m": span.least_m if up else span.greatest_m,
        }
    return ends | {
        "branch": branch,
        "track": held.track_on(span),
        "axis_m": axis_m,
        "chainage_m": held.chainage_m(axis_m, here),
        "bound_ahead_m": ahead_m,
        "bound_behind_m": behind_m,
        "occupied": held.branches.occupied(span),
        "reference_distance_m": max(now.way_m - held.reference_way_m, 0.0) if held.reference else None,
        "clock_bound_m": held.clock_bound_m(now),
    }


def status_of(held: Held, places: Interval, late_s: float = 0.0) -> tuple[PositionStatus, str]:
    """Status, and everything that speaks against a better one."""
    reasons: list[str] = []
    if held.belief.contradicted:
        named = " against ".join(_people_read(one.names) for one in held.belief.alternatives)
        reasons.append(f"sources contradict each other ({named}): the train may be where either says")
    if not held.confirmed:
        reasons.append(held.unconfirmed)
    reasons += _of_odometry(held, late_s)
    unusable = "" if held.line is None or held.reach.now is None else held.line.unusable(held.reach.now.t_ns)
    if unusable:
        reasons.append(unusable)
    if held.facing == 0:
        reasons.append("the direction of the train on the line is not known yet")
    if held.branches.disputed:
        reasons.append(held.branches.disputed)
    if held.branch(places) is None:
        possible = sorted(held.branches.candidates(held.span(places)))
        reasons.append(f"branch undecided: {', '.join(one or 'main line' for one in possible) or MAIN}")
    if places.width_m > held.config.most_valid_m:
        reasons.append(f"the front end may be anywhere within {places.width_m:.0f} m")
    return ("degraded" if reasons else "valid"), "; ".join(reasons)


def _people_read(names: tuple[str, ...]) -> str:
    return ", ".join("satellites" if name == STREAM else name for name in names)


def _of_odometry(held: Held, late_s: float) -> list[str]:
    """What speaks against the odometry."""
    odometry = held.odometry
    found: list[str] = []
    if late_s:
        found.append(f"the odometry is {late_s:.1f} s late: the way gone since is bounded by physics alone")
    if held.doubted:
        found.append(f"odometry not believed: {held.doubted}; the way gone is bounded by physics alone")
    elif (held.blind or odometry is None) and not late_s:
        found.append("no odometry: the way gone is bounded by physics alone")
    elif odometry is not None and odometry.status != "valid":
        found.append(f"odometry {odometry.status}: {odometry.reason}")
    return found
