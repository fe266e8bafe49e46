"""Curves that could be taken for one another: where two of them lie within the search window, neither is matched."""

from __future__ import annotations

from collections.abc import Sequence

from services.landmark_matching.curve_shape import CurveShape, crossings
from services.landmark_matching.passage import Measured, Passage
from services.landmark_matching.settings import MatchSettings

ALIKE_MORE = 0.05
"""Curves count as alike up to this much beyond the tolerance of the scale."""


def twin_of(
    passage: Passage, measured: Measured, others: Sequence[tuple[str, CurveShape]], settings: MatchSettings
) -> str | None:
    """Name and place of another curve that the passage may have been, or None.

    `others` are all curves that the train may meet, the landmark's own among them: a curve that overlaps it is
    the same one.
    """
    own = passage.shape
    level = passage.landmark.lower_share * abs(own.curvature_per_m)
    length_m = measured.exit_m - measured.entry_m
    place_m = passage.anchor.place(measured.exit_m)
    behind_m, ahead_m = passage.anchor.window(measured.exit_m, passage.excess_at(measured.exit_m))
    slack_m = passage.landmark.accuracy_m + 0.5 * max(passage.windows_m)
    tolerance = settings.scale_tolerance + ALIKE_MORE
    for name, other in others:
        if min(other.end_m, own.end_m) > max(other.start_m, own.start_m):
            continue
        ratio = other.curvature_per_m / own.curvature_per_m
        if not (1.0 - tolerance <= ratio <= 1.0 + tolerance):
            continue
        expected = crossings(other, level, passage.windows_m, measured.scale / ratio)
        if expected is None:
            continue
        difference_m = expected[1].u_m - place_m
        if not (-behind_m - slack_m <= difference_m <= ahead_m + slack_m):
            continue
        other_length_m = expected[1].u_m - expected[0].u_m
        if abs(other_length_m - length_m) <= max(0.3 * length_m, settings.length_floor_m):
            return (
                f"curve {name}, {abs(expected[1].u_m - measured.exit.u_m):.0f} m away, is alike and within the window"
            )
    return None
