"""How good chainages are: against the truth, projected onto the line near its place before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from services.gnss_correction.evaluation import FixTrack, Polyline, inside_truth
from services.gnss_correction.solver_arrays import Float64s
from services.line.line_file import LineGeometry
from services.line.projection import follow

NEAR_M: Final = 100.0
"""The truth is looked for this far along the line from its place before, and as far as a train gets besides."""
FASTEST_MPS: Final = 100.0


@dataclass(frozen=True, slots=True)
class AlongError:
    """Error of the chainage at the epochs inside the truth [m]."""

    known_percent: float
    """Epochs with a chainage, predicted ones included."""
    mean_m: float
    p95_m: float
    maximum_m: float
    bound_p50_m: float | None
    """Median of the bounds; None without any."""
    beyond_bound: int
    """Epochs whose error is larger than their bound, or that have no bound."""


def true_chainage_m(t_s: Float64s, truth: Polyline, line: LineGeometry) -> Float64s:
    """Chainage of the truth at instants, interpolated linearly; where the line passes itself it goes on as it came."""
    axis = line.axis
    true_m = axis.to_plane(truth.lat_deg, truth.lon_deg, truth.h_m)
    places = np.stack([np.interp(t_s, truth.at, true_m[:, k]) for k in range(2)], axis=-1)
    reach_m = NEAR_M + FASTEST_MPS * np.clip(np.diff(t_s, prepend=t_s[:1]), 0.0, 10.0)
    feet = follow(axis, places, reach_m, 0.0 if _starts_at_start(places, axis.plane_m) else np.nan)
    return line.chainage.at(feet[:, 0])


def _starts_at_start(places: Float64s, plane_m: Float64s) -> bool:
    """Whether a run begins where the line does: then not on a later passage of the same ground."""
    return bool(np.hypot(*(places[0] - plane_m[0])) < NEAR_M / 2.0)


def along_error(track: FixTrack, truth: Polyline, line: LineGeometry) -> AlongError | None:
    """Error of a track's chainages; None where it has none inside the truth."""
    if track.chainage_m is None:
        return None
    inside = inside_truth(track.t_s, truth.at)
    counted = inside & np.isfinite(track.chainage_m)
    if not counted.any():
        return None
    error = np.abs(track.chainage_m - true_chainage_m(track.t_s, truth, line))[counted]
    bound = np.full(len(error), np.nan) if track.chainage_bound_m is None else track.chainage_bound_m[counted]
    return AlongError(
        known_percent=100.0 * float(counted.sum()) / float(inside.sum()),
        mean_m=float(error.mean()),
        p95_m=float(np.percentile(error, 95)),
        maximum_m=float(error.max()),
        bound_p50_m=float(np.nanmedian(bound)) if np.isfinite(bound).any() else None,
        beyond_bound=int((~(error <= bound)).sum()),
    )
