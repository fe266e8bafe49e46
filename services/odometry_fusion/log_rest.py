"""Whether a motion log begins at rest, or with a wheel that is locked: `first_rest` over the samples of a file.

A file shows more than live samples do: what the sensor shows at later stops, and how the doubt ends. A doubt that a
departure ends, or a rest without any braking before it, is taken back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from services.odometry_fusion.first_rest import (
    ROUGHLY_QUIET,
    UNVOUCHED,
    WINDOW_S,
    FirstRest,
    Rest,
    Shaking,
    shaking_of,
)
from services.odometry_fusion.log_motion import FirstSlip, contradicts, first_slip, vouched_before, widened
from services.odometry_fusion.motion_log import DEGRADED, LOST, VALID, Floats, MotionLog, MotionRows, columns_of

BLOCK_S: Final = 0.1
GONE_M: Final = 20.0
"""Once the wheel has turned so far a stop is one to which the train has come."""
MOST_STOPS: Final = 30
"""Windows at stops from which the level at rest is learned."""
FELT_MPS2: Final = 0.15
"""A locked wheel brakes its train; by less than this no train comes to rest from a speed that shakes it."""
DEPARTING_MPS2: Final = 2.5
"""No train gains speed so fast; a wheel that is released does."""
AFTER_S: Final = 2.0
VALID_M: Final = 4.99
VALID_SHARE: Final = 0.05
"""A larger error than this and this share of the way is not stated while the status is `valid`."""
WIDE: Final = "the wheel may have been locked when the log began: what went unseen then stays in the bound"
Run = Callable[[MotionLog], MotionRows]


@dataclass(frozen=True, slots=True)
class Doubt:
    """A wheel that stands while nothing shows that the train does, until the instant `until_s`."""

    since_s: float
    until_s: float
    fastest_mps: float
    anew: bool
    """Odometry begins anew there; else it lasts to the end of the log."""


def parts_of(log: MotionLog, run: Run, known: Shaking | None = None) -> list[MotionRows]:
    """Odometry of a log, cut where it has to begin anew; what is not vouched for is in the bounds.

    `known`: what the inertial sensor shows at rest.
    """
    rows = run(log)
    if not len(rows):
        return [rows]
    doubt = _doubt_of(log, rows, known)
    if doubt is None:
        slip = first_slip(log, known or _level_at_stops(log, rows))
        if slip is None:
            return [rows]
        return _parts_at(log, run, known, slip) if contradicts(slip, log, rows) else [widened(rows, slip)]
    begun = int(np.searchsorted(log.tacho_t_s, doubt.until_s))
    if not doubt.anew or len(log.tacho_t_s) - begun < 2:  # noqa: PLR2004 - a way needs two counts
        return [unvouched(rows, doubt)]
    at_s = float(log.tacho_t_s[begun])
    return [unvouched(run(_cut(log, -np.inf, at_s)), doubt), *parts_of(_cut(log, at_s, np.inf), run, known)]


def _parts_at(log: MotionLog, run: Run, known: Shaking | None, slip: FirstSlip) -> list[MotionRows]:
    """Two parts, or more: until the wheel has returned from the slip in which the log begins, and from there on."""
    begun = int(np.searchsorted(log.tacho_t_s, slip.until_s))
    at_s = float(log.tacho_t_s[begun])
    return [vouched_before(run(_cut(log, -np.inf, at_s)), slip), *parts_of(_cut(log, at_s, np.inf), run, known)]


def joined(parts: list[MotionRows]) -> MotionRows:
    """One odometry of its parts: what was not known of one stays in the bounds of the next."""
    whole = parts[0]
    for part in parts[1:]:
        whole = _joined(whole, part)
    return whole


def unvouched(rows: MotionRows, doubt: Doubt) -> MotionRows:
    """The rows with the way that the train may have gone unseen."""
    inside = rows.t_s >= doubt.since_s
    more_m = doubt.fastest_mps * np.clip(rows.t_s, doubt.since_s, doubt.until_s) - doubt.fastest_mps * doubt.since_s
    unknown = np.where(inside, np.nan, 0.0)
    return replace(
        rows,
        bound_m=rows.bound_m + more_m,
        excess_m=rows.excess_m + more_m,
        speed_bound_mps=np.where(inside, doubt.fastest_mps, rows.speed_bound_mps),
        standstill=rows.standstill & ~inside,
        status=np.where(inside & (rows.status != LOST), DEGRADED, rows.status).astype(np.int8),
        reason=np.where(inside, len(rows.reasons), rows.reason).astype(np.int16),
        reasons=(*rows.reasons, UNVOUCHED),
        curvature_per_m=rows.curvature_per_m + unknown,
        curvature_sigma_per_m=rows.curvature_sigma_per_m + unknown,
        curvature_distance_m=rows.curvature_distance_m + unknown,
    )


def _doubt_of(log: MotionLog, rows: MotionRows, known: Shaking | None) -> Doubt | None:
    """What is not vouched for at the log's beginning; None where nothing is, or it was taken back."""
    if _watched(log, FirstRest(limits=Shaking(*ROUGHLY_QUIET))) is None:
        return None
    level = known or _level_at_stops(log, rows)
    limits = None if level is not None else Shaking(*ROUGHLY_QUIET)
    doubt = _watched(log, FirstRest(level, limits=limits))
    if doubt is None or (doubt.anew and (_departed(log, doubt) or _never_braked(log, doubt))):
        return None
    return doubt


def _watched(log: MotionLog, rest: FirstRest) -> Doubt | None:
    """Take the log's samples block by block, as they would come; the doubt that is left of it."""
    fastest_mps, until_s = 0.0, log.end_s
    for end_s, imu, counts in _blocks(log):
        whole = np.isfinite(log.imu[imu]).all(axis=1)
        rest.take_imu(_ns(log.imu_t_s[imu][whole]), log.imu[imu][whole])
        way_m = log.pulses[counts].astype(np.float64) * log.vehicle.metres_per_pulse
        rest.take_way("", _ns(log.tacho_t_s[counts]), way_m)
        if rest.state is Rest.UNSURE:
            fastest_mps = rest.fastest_mps
        if rest.state is Rest.OVER or rest.settled:
            until_s = end_s
            break
    if rest.state is Rest.SURE or rest.unsure_since_ns is None:
        return None
    return Doubt(rest.unsure_since_ns / 1e9, until_s, fastest_mps, rest.state is Rest.OVER)


def _blocks(log: MotionLog) -> Iterator[tuple[float, slice, slice]]:
    """Ends of blocks from the first count on, and the samples of both sensors in them."""
    edges_s = np.arange(log.tacho_t_s[0], log.end_s + BLOCK_S, BLOCK_S)
    imu = np.searchsorted(log.imu_t_s, edges_s).tolist()
    counts = np.searchsorted(log.tacho_t_s, edges_s).tolist()
    for k in range(1, len(edges_s)):
        yield float(edges_s[k]), slice(imu[k - 1], imu[k]), slice(counts[k - 1], counts[k])


def _level_at_stops(log: MotionLog, rows: MotionRows) -> Shaking | None:
    """What the sensor shows where the train has come to rest; None where it never does."""
    stopped_s = rows.t_s[rows.standstill & (np.abs(rows.distance_m - rows.distance_m[0]) > GONE_M)]
    seen: list[Shaking] = []
    for t_s in stopped_s[:: round(WINDOW_S / BLOCK_S)][:MOST_STOPS].tolist():
        within = slice(*np.searchsorted(log.imu_t_s, [t_s - WINDOW_S, t_s]).tolist())
        imu = log.imu[within]
        imu = imu[np.isfinite(imu).all(axis=1)]
        if len(imu) > 1:
            seen.append(shaking_of(imu))
    if not seen:
        return None
    force_mps2, rate_radps = np.median(np.array(seen), axis=0).tolist()
    return Shaking(force_mps2, rate_radps)


def _departed(log: MotionLog, doubt: Doubt) -> bool:
    """Whether the wheel has begun to turn as that of a train that departs, and not as one that is released."""
    t_s = np.arange(doubt.since_s, doubt.until_s + AFTER_S, BLOCK_S)
    way_m = np.interp(t_s, log.tacho_t_s, log.pulses * log.vehicle.metres_per_pulse)
    steps = round(WINDOW_S / BLOCK_S)
    speed_mps = (way_m[steps:] - way_m[:-steps]) / WINDOW_S
    gained_mps = np.abs(speed_mps[steps:] - speed_mps[:-steps])
    return bool(np.ptp(way_m) > WINDOW_S and np.max(gained_mps, initial=0.0) <= DEPARTING_MPS2 * WINDOW_S)


def _never_braked(log: MotionLog, doubt: Doubt) -> bool:
    """Whether no force along the train tells the doubt from the rest that ended it."""
    counts = slice(*np.searchsorted(log.tacho_t_s, [doubt.since_s, doubt.until_s]).tolist())
    if np.ptp(log.pulses[counts]) * log.vehicle.metres_per_pulse > WINDOW_S:
        return False
    edges_s = np.arange(doubt.until_s, doubt.since_s, -WINDOW_S)
    felt_mps2: list[float] = []
    for end_s in edges_s.tolist():
        within = slice(*np.searchsorted(log.imu_t_s, [max(end_s - WINDOW_S, doubt.since_s), end_s]).tolist())
        forces_mps2 = log.imu[within, 0]
        forces_mps2 = forces_mps2[np.isfinite(forces_mps2)]
        if len(forces_mps2):
            felt_mps2.append(float(np.median(forces_mps2)))
    return bool(felt_mps2) and max(abs(one - felt_mps2[0]) for one in felt_mps2) <= FELT_MPS2


def _cut(log: MotionLog, first_s: float, end_s: float) -> MotionLog:
    """Samples from an instant on, before another."""
    imu = slice(*np.searchsorted(log.imu_t_s, [first_s, end_s]).tolist())
    counts = slice(*np.searchsorted(log.tacho_t_s, [first_s, end_s]).tolist())
    return replace(
        log, imu_t_s=log.imu_t_s[imu], imu=log.imu[imu], tacho_t_s=log.tacho_t_s[counts], pulses=log.pulses[counts]
    )


def _joined(one: MotionRows, other: MotionRows) -> MotionRows:
    """Two odometries, the second of which counts on from the first."""
    between_s = float(other.t_s[0] - one.t_s[-1])
    lost_m = float(one.bound_m[-1] + one.speed_bound_mps[-1] * between_s)
    way_m = float(one.way_m[-1]) + other.way_m - other.way_m[0]
    bound_m = other.bound_m + lost_m
    wide = (bound_m > VALID_M + VALID_SHARE * way_m) & (other.status == VALID)
    columns: dict[str, Any] = {
        "distance_m": float(one.distance_m[-1]) + other.distance_m - other.distance_m[0],
        "way_m": way_m,
        "excess_m": other.excess_m + lost_m,
        "bound_m": bound_m,
        "curvature_distance_m": float(one.distance_m[-1]) + other.curvature_distance_m - other.distance_m[0],
        "status": np.where(wide, DEGRADED, other.status).astype(np.int8),
        "reason": np.where(wide, len(one.reasons) + len(other.reasons), other.reason + len(one.reasons)).astype(
            np.int16
        ),
    }
    later = replace(other, **columns)
    numbers = max((episode.number for episode in one.episodes), default=0)
    both: dict[str, Any] = {
        name: np.concatenate([getattr(one, name), value]) for name, value in columns_of(later).items()
    }
    return replace(
        one,
        **both,
        reasons=(*one.reasons, *other.reasons, WIDE),
        episodes=one.episodes + tuple(replace(each, number=each.number + numbers) for each in other.episodes),
    )


def _ns(t_s: Floats) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return np.rint(t_s * 1e9).astype(np.int64)
