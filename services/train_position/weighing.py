"""A claim weighed: into the interval, the estimate, the wheel's scale, the routes; with what is to be told of it."""

from __future__ import annotations

from typing import Final

from schemas.message import Message
from schemas.position import ReferencePass
from services.train_position.belief import Outcome, Verdict
from services.train_position.branches import MAIN
from services.train_position.claims import STREAM, Claim, Interval, offsets_of
from services.train_position.estimate import Estimate
from services.train_position.held import Held, Said, is_reference
from services.train_position.instants import Instant
from services.train_position.scale_message import learned_scale

AGREEING: Final[frozenset[Outcome]] = frozenset({"taken", "first", "resolved"})
"""How a claim ends that the others bear out."""
SCALE_SIGMAS: Final = 3.0
"""What the odometry vouches for is taken for so many standard deviations of the wheel's scale."""


def weigh(held: Held, claim: Claim, then: Instant) -> list[Message]:
    """Take a claim that was true at `then`; returns passes and events."""
    now = held.reach.now
    if now is None:
        return []
    before = held.places_at(then)
    supposed_m = None if before is None else before.clip(_at(held, then, now, before))
    verdict = held.belief.take(claim, then, now)
    told = _passed(held, claim, then, before, supposed_m)
    held.said[claim.source] = _said(claim, verdict, before, supposed_m)
    if is_reference(claim):
        told += _reset(held, claim, then, supposed_m, verdict)
    if verdict.outcome == "contradiction":
        told.append(held.event("contradiction", f"sources contradict each other: {verdict.text}", now.t_ns, supposed_m))
        held.scale.forget()
    elif verdict.outcome == "resolved":
        told.append(held.event("contradiction", f"contradiction resolved: {verdict.text}", now.t_ns, claim.axis_m))
    _estimate(held, claim, then, now, verdict)
    if verdict.outcome in AGREEING:
        told += _taken(held, claim, then)
    return told


def _at(held: Held, then: Instant, now: Instant, places: Interval) -> float:
    if held.estimate is None:
        return (places.least_m + places.greatest_m) / 2.0
    return held.estimate.back(then, now)


def _said(claim: Claim, verdict: Verdict, before: Interval | None, supposed_m: float | None) -> Said:
    """The source's state after its claim."""
    said = Said(claim.t_ns, verdict.outcome in AGREEING, verdict.text or claim.words)
    if before is not None and supposed_m is not None:
        said.difference_m = claim.axis_m - supposed_m
        towards_m = before.greatest_m - supposed_m if said.difference_m > 0.0 else supposed_m - before.least_m
        said.allowed_m = max(towards_m, 0.0) + claim.bound_m
    return said


def _passed(
    held: Held, claim: Claim, then: Instant, before: Interval | None, supposed_m: float | None
) -> list[Message]:
    """Error against bound at a balise or landmark."""
    if not is_reference(claim) or before is None or supposed_m is None:
        return []
    error_m = supposed_m - claim.axis_m
    towards_m = supposed_m - before.least_m if error_m > 0.0 else before.greatest_m - supposed_m
    bound_m = max(towards_m, 0.0) + claim.bound_m
    return [
        ReferencePass(
            t_ns=claim.t_ns,
            reference=claim.name,
            kind="landmark" if claim.source == "landmark" else "balise",
            axis_m=claim.axis_m,
            error_m=error_m,
            bound_m=bound_m,
            within=abs(error_m) <= bound_m,
            way_m=max(then.way_m - held.reference_way_m, 0.0),
        )
    ]


def _reset(held: Held, claim: Claim, then: Instant, supposed_m: float | None, verdict: Verdict) -> list[Message]:
    """What a reference resets; one that contradicts the others resets nothing."""
    if verdict.outcome not in AGREEING:
        return []
    held.reference, held.reference_way_m = claim.name, then.way_m
    if supposed_m is None:
        return []
    text = f"{claim.words}; the position was {supposed_m - claim.axis_m:+.1f} m from it"
    return [held.event("reset", text, claim.t_ns, claim.axis_m)]


def _estimate(held: Held, claim: Claim, then: Instant, now: Instant, verdict: Verdict) -> None:
    """Take the claim into the estimate, and keep that inside of what is certain."""
    places, scale = held.belief.places(now), held.scale_now()
    if places is None:
        return
    if held.estimate is None:
        moved_m = now.likeliest_m - then.likeliest_m
        held.estimate = Estimate(claim.axis_m + moved_m, claim.sigma_m, 0.0, scale.largest / SCALE_SIGMAS)
    elif verdict.outcome in {"taken", "resolved"}:
        if verdict.outcome == "resolved" and not places.least_m <= held.estimate.axis_m <= places.greatest_m:
            # The side that it stood on was refuted: begin anew where the others are.
            middle_m = (places.least_m + places.greatest_m) / 2.0
            scale_sigma = scale.largest / SCALE_SIGMAS
            held.estimate = Estimate(middle_m, max(places.width_m, 0.1) / 4.0, held.estimate.scale, scale_sigma)
        held.estimate.measure(claim.axis_m, claim.sigma_m, then, now)
    held.estimate.confine(places.least_m, places.greatest_m, scale.least, scale.greatest)


def _taken(held: Held, claim: Claim, then: Instant) -> list[Message]:
    """What follows from a claim that holds."""
    told: list[Message] = []
    now = held.reach.now
    held.lost = ""
    if held.belief.offsets() == offsets_of(claim.axis_m, claim.bound_m, then):
        # Nothing older bounds the place any more.
        held.narrowed_way_m = then.way_m
        if held.odometry is not None:
            held.reach.share = held.odometry.share_bound
    if claim.source in {"landmark", "balise", STREAM} and not held.confirmed:
        held.confirmed, held.unconfirmed = True, ""
        told.append(held.event("restart", f"confirmed by {claim.words}", claim.t_ns, claim.axis_m))
    if claim.source == STREAM:
        held.satellites_ns = max(claim.t_ns, held.satellites_ns or claim.t_ns)
    if is_reference(claim) and claim.branch is not None:
        told += decide(held, claim, now)
    if now is None or held.belief.contradicted or held.blind or claim.source not in {"landmark", "balise", STREAM}:
        return told
    wrong = held.scale.reference(claim, then, held.reach.sense)
    if wrong:
        told.append(held.event("change", wrong, claim.t_ns, claim.axis_m))
    return told if claim.source == STREAM else told + learned_scale(held, now.t_ns, claim.name)


def decide(held: Held, claim: Claim, now: Instant | None) -> list[Message]:
    """What a reference on a branch, or beyond junctions on the main line, says of the route."""
    if claim.branch:
        disputed = held.branches.decide(claim.branch, None, "reference")
        if disputed and now is not None:
            return [held.event("branch", disputed, now.t_ns, claim.axis_m)]
        return []
    if held.line is not None and claim.branch == MAIN:
        for branch, leaves_m in held.line.leaves_m.items():
            if leaves_m < claim.axis_m - claim.bound_m:
                held.branches.exclude(branch)
    return []
