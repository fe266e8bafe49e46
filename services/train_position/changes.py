"""What the train's equipment or a person says has changed, and what the curves say of the branch."""

from __future__ import annotations

from schemas.message import Message
from schemas.position import BranchEvidence, TrainChange
from services.train_position.held import Held
from services.train_position.makeup import changed, refusal
from services.train_position.parallel_track import track_taken
from services.train_position.scale_message import unknown_scale


def apply_change(held: Held, change: TrainChange) -> list[Message]:
    """Let the bounds react to a change; returns events."""
    wrong = refusal(change, held.makeup)
    if change.kind == "route" and (change.branch is None or not held.branches.knows(change.branch)):
        wrong = f"a route onto {change.branch}, which the line does not have"
    if wrong:
        return held.refuse("route" if change.kind == "route" else None, change.t_ns, "change", wrong)
    match change.kind:
        case "cab" | "coupled" | "uncoupled":
            text = _make_up(held, change)
        case "wheel_turned":
            held.scale.turn()
            text = f"wheels turned: way is good to {held.config.turned_share:.0%} until two references tell the scale"
            held.reach.share = max(held.reach.share, held.config.turned_share)
        case "moved_cold":
            held.lose("the train was moved while nobody watched: a reference must confirm its place")
            if held.config.facing is None:
                held.reach.sense = 0
            held.confirmed, held.unconfirmed = False, "moved while nobody watched"
            text = held.lost
        case "route":
            places = held.places()
            held.branches.set_route(change.branch or "", None if places is None else held.span(places))
            held.track = change.track
            text = f"route set onto {change.branch or 'the main line'}"
            held.say("route", change.t_ns, text, taken=True)
    places = held.places()
    if change.note:
        text = f"{text} ({change.note[:200]})"
    told: list[Message] = [held.event("change", text, change.t_ns, None if places is None else held.estimate_m(places))]
    return told + unknown_scale(held, change.t_ns, "wheels turned") if change.kind == "wheel_turned" else told


def _make_up(held: Held, change: TrainChange) -> str:
    """Another make-up moves the front end along the train."""
    makeup, shift = changed(held.makeup, change)
    now, sense = held.reach.now, held.reach.sense
    if now is not None:
        if sense == 0:
            far_m = max(abs(shift.least_m), abs(shift.greatest_m))
            held.reach.shift(-far_m, far_m)
        else:
            ends_m = sorted((sense * shift.least_m, sense * shift.greatest_m))
            held.reach.shift(ends_m[0], ends_m[1])
        after = held.reach.now
        if held.estimate is not None and after is not None:
            held.estimate.move(now, after)
        if makeup.flips != held.makeup.flips:
            held.reach.sense = -sense
            # Along the axis that is forward from now on.
            held.reach.doubt_speed(-now.speed_mps, now.speed_bound_mps)
            held.scale.restart()
        held.change_makeup(now.t_ns, makeup)
    else:
        held.change_makeup(change.t_ns, makeup)
    if change.kind == "cab":
        return f"cab {makeup.cab} leads: the front end is the other end of the train"
    return f"{change.kind}: the train is {makeup.length_m:.0f} m long"


def apply_evidence(held: Held, evidence: BranchEvidence) -> list[Message]:
    """Take evidence for a branch; returns events."""
    if evidence.decided is None:
        held.say("route", evidence.t_ns, f"curvature: {evidence.reason}", taken=False)
        return []
    if not held.branches.knows(evidence.decided):
        text = f"evidence for the branch {evidence.decided}, which the line does not have"
        return held.refuse("route", evidence.t_ns, "branch", text)
    if held.reach.at(evidence.t_ns) is None:
        return held.refuse("route", evidence.t_ns, "old", "evidence for a branch from before the history")
    places = held.places()
    if places is not None and held.span(places).greatest_m < evidence.junction_axis_m:
        text = f"evidence for a junction at {evidence.junction_axis_m:.0f} m, which the train has not reached"
        return held.refuse("route", evidence.t_ns, "branch", text)
    disputed = held.branches.decide(evidence.decided, evidence.junction_axis_m, "curvature")
    held.say("route", evidence.t_ns, f"curvature: {evidence.reason}", taken=not disputed)
    if not disputed and held.line is not None:
        held.track_taken = track_taken(held.line, evidence.decided, evidence.junction_axis_m)
    if disputed:
        held.track_taken = None
        return [held.event("branch", disputed, evidence.t_ns, evidence.junction_axis_m)]
    return []
