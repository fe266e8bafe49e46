"""One passage of a curve: the samples, where the lower limit was crossed, and what the straights beside it tell."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.line import Landmark
from services.landmark_matching.anchor import Anchor
from services.landmark_matching.curve_shape import Crossing, CurveShape, crossings, mean_curvature
from services.landmark_matching.settings import MatchSettings
from services.landmark_matching.track_record import CURVATURE, DISTANCE, EXCESS, SIGMA, SPEED, WINDOW, T, TrackRecord

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Straight:
    """A stretch of straight track beside the curve."""

    yaw_rate_radps: float | None
    """Mean yaw rate on it: the gyro's bias, since the track does not turn. None where the curve is too near."""
    samples: int


@dataclass(frozen=True, slots=True)
class Passage:
    """Columns of shape (n,), from well before the entry to the newest sample; crossings as distances."""

    landmark: Landmark
    shape: CurveShape
    anchor: Anchor
    t_s: Floats
    distance_m: Floats
    curvature_per_m: Floats
    speed_mps: Floats
    window_m: Floats
    excess_m: Floats
    sigma_per_m: float
    faults: tuple[str, ...]
    entry_m: float
    exit_m: float

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Samples between the two crossings."""
        return (self.distance_m >= self.entry_m) & (self.distance_m <= self.exit_m)

    @property
    def windows_m(self) -> tuple[float, float]:
        """Way over which curvature is averaged, at entry and exit."""
        return (
            float(np.interp(self.entry_m, self.distance_m, self.window_m)),
            float(np.interp(self.exit_m, self.distance_m, self.window_m)),
        )

    @property
    def exit_speed_mps(self) -> float:
        """Speed at the exit crossing."""
        return float(np.interp(self.exit_m, self.distance_m, self.speed_mps))

    @property
    def exit_t_s(self) -> float:
        """Time of the exit crossing."""
        return float(np.interp(self.exit_m, self.distance_m, self.t_s))

    def excess_at(self, distance_m: float) -> float:
        """Odometry's excess at a distance of the passage."""
        return float(np.interp(distance_m, self.distance_m, self.excess_m))


@dataclass(frozen=True, slots=True)
class Measured:
    """What the whole passage says about the curve, once its straights are known."""

    scale: float
    """Mean curvature over the database's."""
    shape_error: float
    """Root mean square difference after the scale, as a share of the arc's curvature."""
    entry: Crossing
    """Where the database and scale expect the crossings."""
    exit: Crossing
    entry_m: float
    """Where they were measured, the gyro's bias removed."""
    exit_m: float

    @property
    def length_error_m(self) -> float:
        """Measured minus expected length between the crossings."""
        return (self.exit_m - self.entry_m) - (self.exit.u_m - self.entry.u_m)


def cut_passage(
    record: TrackRecord, begin: int, landmark: Landmark, shape: CurveShape, anchor: Anchor, ends_m: tuple[float, float]
) -> Passage:
    """Passage from sample `begin` to the newest one; `ends_m` are its two crossings."""
    end = record.end
    cut = {which: record.column(which, begin, end).copy() for which in (T, DISTANCE, CURVATURE, SPEED, WINDOW, EXCESS)}
    sigma = record.column(SIGMA, begin, end)
    known = sigma[np.isfinite(sigma)]
    return Passage(
        landmark=landmark,
        shape=shape,
        anchor=anchor,
        t_s=cut[T],
        distance_m=cut[DISTANCE],
        curvature_per_m=cut[CURVATURE],
        speed_mps=cut[SPEED],
        window_m=cut[WINDOW],
        excess_m=cut[EXCESS],
        sigma_per_m=float(np.median(known)) if len(known) else math.nan,
        faults=tuple(record.faults(begin, end)),
        entry_m=ends_m[0],
        exit_m=ends_m[1],
    )


def straight_stretch(
    way_m: Floats, curvature_per_m: Floats, length_m: float, limit_per_m: float, share: float
) -> tuple[int, int] | None:
    """Samples (begin, end) of the first stretch of `length_m` of which a share has less curvature than the limit.

    `way_m` is the distance from the curve, rising; both have shape (n,).
    """
    if len(way_m) < 2:  # noqa: PLR2004 - a way needs two ends
        return None
    straight = np.abs(curvature_per_m) < limit_per_m
    both = straight[1:] & straight[:-1]
    good = np.concatenate([[0.0], np.cumsum(np.where(both, np.diff(way_m), 0.0))])
    ends = np.searchsorted(way_m, way_m + length_m - 1e-9)
    inside = np.flatnonzero(ends < len(way_m))
    enough = good[ends[inside]] - good[inside] >= share * (way_m[ends[inside]] - way_m[inside])
    fitting = inside[enough & straight[inside]]
    return (int(fitting[0]), int(ends[fitting[0]]) + 1) if len(fitting) else None


def find_straight(passage: Passage, settings: MatchSettings, *, entry: bool) -> Straight | None:
    """The straight nearest to the curve on one side, or None.

    It has the length of the database's row, `straight_share` of it below the limit (Iwata et al.,
    section 3.2, diagnoses 2 and 4). It is looked for beyond the transition and half a window, where the
    average no longer reaches into the curve; only there does it tell the gyro's bias. Straights too short
    for that are looked for from the crossing on, without a bias.
    """
    crossing_m = passage.entry_m if entry else passage.exit_m
    order = slice(None, None, -1) if entry else slice(None)
    way = np.abs(passage.distance_m - crossing_m)[order]
    beyond = (passage.distance_m <= crossing_m if entry else passage.distance_m >= crossing_m)[order]
    curvature = passage.curvature_per_m[order]
    length_m, limit = straight_rows(passage.landmark, settings, entry=entry)
    first_m = clear_of_curve_m(passage.shape, passage.landmark, passage.windows_m[0 if entry else 1], entry=entry)
    last_m = max(settings.straight_within_m, first_m + 2.0 * length_m)
    for begin_m in (first_m, 0.0):
        near = beyond & (way >= begin_m) & (way <= last_m)
        if straight_stretch(way[near], curvature[near], length_m, limit, settings.straight_share) is None:
            continue
        if not begin_m:
            return Straight(None, 0)
        straight = near & (np.abs(curvature) < limit)
        return Straight(float(np.mean((curvature * passage.speed_mps[order])[straight])), int(np.sum(straight)))
    return None


def clear_of_curve_m(shape: CurveShape, landmark: Landmark, window_m: float, *, entry: bool) -> float:
    """Distance from the lower limit's crossing at which an average over `window_m` is free of the curve."""
    transition_m = shape.arc_start_m - shape.start_m if entry else shape.end_m - shape.arc_end_m
    return landmark.lower_share * transition_m + 0.5 * window_m


def common_bias_radps(*straights: Straight | None) -> float:
    """The gyro's bias by the straights that tell it, weighted with their samples; 0 when none does."""
    told = [(one.yaw_rate_radps, one.samples) for one in straights if one is not None]
    known = [(rate, samples) for rate, samples in told if rate is not None]
    return sum(rate * samples for rate, samples in known) / sum(samples for _, samples in known) if known else 0.0


def straight_rows(landmark: Landmark, settings: MatchSettings, *, entry: bool) -> tuple[float, float]:
    """Length of a straight by the database, and the curvature below which it counts as straight."""
    ends = (
        (landmark.entry_straight_start_m, landmark.entry_straight_end_m)
        if entry
        else (landmark.exit_straight_start_m, landmark.exit_straight_end_m)
    )
    return abs(ends[1] - ends[0]), min(settings.straight_per_m, 0.4 / landmark.radius_m)


def _crossing_near(place: Floats, size: Floats, level: float, about_m: float, *, rising: bool) -> float | None:
    """The crossing nearest to `about_m`, interpolated between samples."""
    above = size >= level
    edges = np.flatnonzero((above[1:] & ~above[:-1]) if rising else (~above[1:] & above[:-1]))
    if not len(edges):
        return None
    at = place[edges] + (place[edges + 1] - place[edges]) * (level - size[edges]) / (size[edges + 1] - size[edges])
    return float(at[np.argmin(np.abs(at - about_m))])


def measure(passage: Passage, bias_radps: float) -> Measured | None:
    """Scale, shape and crossings of a passage, after the gyro's bias is taken off; None where they do not show.

    The database's curve is laid with its middle on the measured one, which no error of scale moves;
    the scale then follows by least squares over all samples.
    """
    shape, rows = passage.shape, passage.landmark
    arc = abs(shape.curvature_per_m)
    curvature = passage.curvature_per_m - bias_radps / np.maximum(passage.speed_mps, 0.1)
    level = rows.lower_share * arc
    size = np.abs(curvature)
    entry_m = _crossing_near(passage.distance_m, size, level, passage.entry_m, rising=True)
    exit_m = _crossing_near(passage.distance_m, size, level, passage.exit_m, rising=False)
    if entry_m is None or exit_m is None or exit_m <= entry_m:
        return None
    expected = crossings(shape, level, passage.windows_m)
    scale, shape_error = 1.0, math.inf
    for _ in range(3):  # scale and expected crossings settle within two rounds
        if expected is None:
            return None
        shift = 0.5 * (expected[0].u_m + expected[1].u_m - entry_m - exit_m)
        u = passage.distance_m + shift
        near = (u >= shape.start_m) & (u <= shape.end_m) & np.isfinite(curvature)
        model = mean_curvature(shape, u[near], passage.window_m[near])
        energy = float(model @ model)
        if not energy:
            return None
        scale = float(model @ curvature[near]) / energy
        if scale <= 0.0:
            return None
        difference = curvature[near] - scale * model
        shape_error = math.sqrt(float(difference @ difference) / len(difference)) / (scale * arc)
        expected = crossings(shape, level, passage.windows_m, scale)
    if expected is None:
        return None
    return Measured(scale, shape_error, expected[0], expected[1], entry_m, exit_m)
