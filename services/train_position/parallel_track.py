"""Which of parallel tracks the train is on, as a junction's branch tells: satellites err by more than their distance.

A branch whose axis runs as far aside as a parallel track is that track. Evidence for it decides the track; evidence for
the main line decides for the axis itself where no further track lies beside it.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from services.train_position.branches import MAIN
from services.train_position.claims import Interval
from services.train_position.line_places import LinePlaces

ALIKE_M: Final = 1.5
"""Parallel tracks lie further apart than this."""
PARTS: Final = (0.35, 0.5, 0.65)
"""Where along a track its branch is held against it: turnouts lead over at its ends."""


class TrackTaken(NamedTuple):
    """A parallel track, and the stretch on which there is a choice."""

    track: str
    """Empty for the axis itself."""
    stretch: Interval
    """From the junction to the track's end."""


def track_taken(line: LinePlaces, branch: str, junction_m: float) -> TrackTaken | None:
    """What a branch taken at a junction says of parallel tracks; None where it says nothing."""
    here = [one for one, leaves_m in line.leaves_m.items() if abs(leaves_m - junction_m) < 1.0]
    for track in line.parallel:
        stretch = Interval(track.start_axis_m, track.end_axis_m)
        runs = {one for one in here if _runs_on(line, one, stretch, track.aside_m)}
        if branch in runs:
            return TrackTaken(track.id, Interval(min(junction_m, stretch.least_m), stretch.greatest_m))
        beside = [one for one in line.parallel if one.start_axis_m < stretch.greatest_m]
        if branch == MAIN and runs and sum(one.end_axis_m > stretch.least_m for one in beside) == 1:
            return TrackTaken(MAIN, Interval(min(junction_m, stretch.least_m), stretch.greatest_m))
    return None


def _runs_on(line: LinePlaces, branch: str, stretch: Interval, aside_m: float) -> bool:
    """Whether a branch lies where a parallel track does."""
    if line.leaves_m[branch] > stretch.least_m + PARTS[0] * stretch.width_m:
        return False
    for part in PARTS:
        place_m = stretch.least_m + part * stretch.width_m
        lat_deg, lon_deg, h_m = (float(one) for one in line.routes[branch].position(place_m))
        feet = line.feet(MAIN, lat_deg, lon_deg, h_m)
        if not any(abs(foot.aside_m - aside_m) < ALIKE_M for foot in feet):
            return False
    return True
