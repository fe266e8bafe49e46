"""What landmarks and balises say of the front end."""

from __future__ import annotations

from typing import Final

from schemas.position import BalisePassage, LandmarkMatch
from services.train_position.branches import MAIN
from services.train_position.claims import Claim
from services.train_position.held import Held
from services.train_position.instants import Instant
from services.train_position.makeup import LONGEST_M

BOUND_SIGMAS: Final = 3.0
"""A location accuracy is taken for so many standard deviations."""
LANDMARK_SIGMAS: Final = 6.0
"""A match's bound adds up five standard deviations of noise and the largest errors of all else, so errors are smaller:
0.9 m rms where the bounds are 10 m (docs/landmark_matching.md)."""
LARGEST_BOUND_M: Final = 1000.0
FARTHEST_M: Final = 1e7
"""No line is longer."""
DELAYED_S: Final = 5.0
"""Curvature is averaged over less: the odometry's distance of a match is no older than this."""


def landmark_claim(held: Held, match: LandmarkMatch, then: Instant) -> Claim | str:
    """Claim of an accepted match; a reason in words where it cannot be used."""
    if not match.accepted:
        return f"landmark {match.landmark}: {match.reason}"
    if not held.branches.knows(match.branch):
        return f"landmark {match.landmark} is on the branch {match.branch}, which the line does not have"
    if match.bound_m > LARGEST_BOUND_M or abs(match.axis_m) > FARTHEST_M:
        return f"landmark {match.landmark} at {match.axis_m:.0f} m ± {match.bound_m:.0f} m"
    if match.origin == held.origin and not held.blind:
        reach_m = (abs(then.speed_mps) + then.speed_bound_mps) * DELAYED_S + 2.0 * then.provisional_m + 10.0
        if abs(match.distance_m - then.distance_m) > reach_m:
            return (
                f"time and distance of landmark {match.landmark} are {match.distance_m - then.distance_m:.0f} m apart"
            )
    running = 1 if match.direction == "up" else -1
    if held.sense_at(then.t_ns) * then.speed_mps * running < 0.0:
        return f"landmark {match.landmark} was matched running {match.direction}, while the train ran the other way"
    bound_m = match.bound_m + held.clock_bound_m(then)
    sigma_m = max(match.bound_m / LANDMARK_SIGMAS, 0.3)
    return Claim("landmark", match.landmark, match.t_ns, match.axis_m, bound_m, sigma_m, match.branch)


def balise_claim(held: Held, passage: BalisePassage, then: Instant) -> Claim | str:
    """Claim of a balise's passage; a reason in words where it cannot be used."""
    balise = None if held.line is None else held.line.balise(passage.balise)
    if balise is None:
        return f"the line knows no balise {passage.balise}"
    if abs(passage.sensor_offset_m) > LONGEST_M or passage.detection_bound_m > LARGEST_BOUND_M:
        return (
            f"balise {passage.balise} read {passage.sensor_offset_m:.0f} m behind the front end, "
            f"± {passage.detection_bound_m:.0f} m"
        )
    facing = held.sense_at(then.t_ns) * held.makeup_at(then.t_ns).sign
    axis_m = balise.axis_m + facing * passage.sensor_offset_m
    bound_m = balise.accuracy_m + passage.detection_bound_m
    unknown_m = abs(passage.sensor_offset_m) if facing == 0 else 0.0
    sigma_m = max(bound_m / BOUND_SIGMAS, 0.3)
    bound_m += unknown_m + held.clock_bound_m(then)
    return Claim("balise", passage.balise, passage.t_ns, axis_m, bound_m, sigma_m, MAIN)
