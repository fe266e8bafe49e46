"""How good fixes are: against a line, as in the tables of Yoshinaga et al. 2008, and against the truth.

Everything is horizontal and in metres. Instants are seconds of GPS time since 1980.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.line.line_file import LineGeometry
from services.numerics.geodesy import enu_about, geodetic_from_ecef

Float64s = NDArray[np.float64]

MARGIN_S: Final = 0.06
"""An epoch this close to a truth point counts as inside, at the ends and beside gaps."""
LONGEST_TRUTH_GAP_S: Final = 1.5
"""Between truth points further apart nothing is interpolated."""
_CHUNK: Final = 2_000_000


@dataclass(frozen=True, slots=True)
class FixTrack:
    """What one method made of a recording; one element per epoch, NaN where there is no fix."""

    name: str
    t_s: Float64s
    fixed: NDArray[np.bool_]
    lat_deg: Float64s
    lon_deg: Float64s
    h_m: Float64s
    bound_m: Float64s | None = None
    """Horizontal bound; NaN where none is vouched for, None where the file has no such column."""
    chainage_m: Float64s | None = None
    chainage_bound_m: Float64s | None = None
    """Place on the line and its bound, likewise."""


@dataclass(frozen=True, slots=True)
class Polyline:
    """Points in order: a centreline, or the truth of a run."""

    lat_deg: Float64s
    lon_deg: Float64s
    h_m: Float64s
    at: Float64s
    """Chainage [m] of a line, instant [s] of a truth."""

    @property
    def reference_deg(self) -> tuple[float, float, float]:
        """Latitude, longitude [deg] and height [m] of the first point."""
        return float(self.lat_deg[0]), float(self.lon_deg[0]), float(self.h_m[0])


def centreline_of(line: LineGeometry) -> Polyline:
    """Vertices of a line's axis with their chainages."""
    lat_rad, lon_rad, h_m = geodetic_from_ecef(*line.axis.ecef_m.T)
    return Polyline(np.degrees(lat_rad), np.degrees(lon_rad), h_m, line.chainage.at(line.axis.axis_m))


@dataclass(frozen=True, slots=True)
class LineDistance:
    """A column of the paper's Table 1 [m]."""

    average_m: float
    maximum_m: float
    minimum_m: float
    standard_deviation_m: float
    """About the average, over all fixes (divisor n)."""


@dataclass(frozen=True, slots=True)
class TruthError:
    """Horizontal error at the epochs inside the truth [m]."""

    epochs: int
    fixation_percent: float
    mean_m: float
    p50_m: float
    p95_m: float
    maximum_m: float


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Everything about one method; None where there is nothing to compare with, or no fix."""

    name: str
    epochs: int
    fixation_percent: float
    """The paper's Table 2: epochs with a fix, of all epochs."""
    line: LineDistance | None
    truth: TruthError | None


def horizontal_m(track: FixTrack | Polyline, reference_deg: tuple[float, float, float]) -> Float64s:
    """East and north [m], shape (n, 2), about a reference; a missing height is taken for the reference's."""
    h_m = np.where(np.isfinite(track.h_m), track.h_m, reference_deg[2])
    return np.asarray(enu_about(reference_deg, track.lat_deg, track.lon_deg, h_m)[:, :2])


def distances_to_line_m(points_m: Float64s, line_m: Float64s) -> Float64s:
    """Shortest distance of each point (n, 2) to a polyline (m, 2), m of at least 2.

    >>> distances_to_line_m(np.array([[5.0, 3.0], [-4.0, 3.0]]), np.array([[0.0, 0.0], [10.0, 0.0]]))
    array([3., 5.])
    """
    start, along = line_m[:-1], np.diff(line_m, axis=0)
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    nearest = np.empty(len(points_m))
    step = max(1, _CHUNK // len(start))
    for first in range(0, len(points_m), step):
        offset = points_m[first : first + step, None, :] - start
        share = np.clip((offset * along).sum(axis=2) / square, 0.0, 1.0)
        gap = offset - share[..., None] * along
        nearest[first : first + step] = np.sqrt((gap**2).sum(axis=2).min(axis=1))
    return nearest


def line_distance(track: FixTrack, line: Polyline) -> LineDistance | None:
    """Distance of the fixes to the line; None without a fix."""
    if not track.fixed.any():
        return None
    reference = line.reference_deg
    points = horizontal_m(track, reference)[track.fixed]
    distance = distances_to_line_m(points, horizontal_m(line, reference))
    return LineDistance(
        average_m=float(distance.mean()),
        maximum_m=float(distance.max()),
        minimum_m=float(distance.min()),
        standard_deviation_m=float(distance.std()),
    )


def inside_truth(t_s: Float64s, truth_s: Float64s) -> NDArray[np.bool_]:
    """Epochs at which the truth is known."""
    after = np.clip(np.searchsorted(truth_s, t_s), 1, len(truth_s) - 1)
    nearest = np.minimum(np.abs(truth_s[after] - t_s), np.abs(truth_s[after - 1] - t_s))
    known = (truth_s[after] - truth_s[after - 1] <= LONGEST_TRUTH_GAP_S) | (nearest < MARGIN_S)
    return np.asarray((t_s >= truth_s[0] - MARGIN_S) & (t_s <= truth_s[-1] + MARGIN_S) & known)


def errors_m(track: FixTrack, truth: Polyline) -> tuple[Float64s, NDArray[np.bool_]]:
    """Horizontal error [m] of every epoch against the truth, interpolated linearly, and which lie inside it."""
    reference = truth.reference_deg
    true_m = horizontal_m(truth, reference)
    at = np.stack([np.interp(track.t_s, truth.at, true_m[:, k]) for k in range(2)], axis=-1)
    return np.hypot(*(horizontal_m(track, reference) - at).T), inside_truth(track.t_s, truth.at)


def truth_error(track: FixTrack, truth: Polyline) -> TruthError | None:
    """Error of the fixes against the truth; None without a fix inside it."""
    every, inside = errors_m(track, truth)
    counted = inside & track.fixed
    if not counted.any():
        return None
    error = every[counted]
    return TruthError(
        epochs=int(inside.sum()),
        fixation_percent=100.0 * float(counted.sum()) / float(inside.sum()),
        mean_m=float(error.mean()),
        p50_m=float(np.median(error)),
        p95_m=float(np.percentile(error, 95)),
        maximum_m=float(error.max()),
    )


def evaluate(track: FixTrack, truth: Polyline | None, line: Polyline | None) -> Evaluation:
    """Everything about one method."""
    return Evaluation(
        name=track.name,
        epochs=len(track.t_s),
        fixation_percent=100.0 * float(track.fixed.mean()) if len(track.t_s) else 0.0,
        line=line_distance(track, line) if line else None,
        truth=truth_error(track, truth) if truth else None,
    )
