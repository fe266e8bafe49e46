"""Whether a motion log begins under way with a wheel that slips already, by what comes after: `first_motion` for files.

Once the wheel has adhered for a while, the inertial sensor tells backwards from there how fast the train was before,
and so by how much the wheel was off when the log began. Until the wheel has returned, what is vouched for takes in
the way by the inertial sensor; where the method's own bound does not, odometry begins anew with the wheel's return.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from services.odometry_fusion.first_motion import CALM_S as FIRST_CALM_S
from services.odometry_fusion.first_motion import UNSEEN
from services.odometry_fusion.first_rest import TURNING_MPS, Shaking, limits_of
from services.odometry_fusion.motion_log import DEGRADED, LOST, Floats, MotionLog, MotionRows
from services.odometry_fusion.motion_track import APART_TICKS, SPEED_TICKS, TICK_S, MotionTrack

LONGEST_S: Final = 40.0
"""A slip of before the log is over by then."""
CALM_S: Final = 10.0
"""A wheel that has agreed with the inertial sensor for so long has returned."""
RETURNED_TICKS: Final = 2 * APART_TICKS - 10
"""Rim and inertial sensor show as parted until so long after they last did."""
FIRST_TICKS: Final = SPEED_TICKS + 2 * APART_TICKS
"""They do not show before; what shows right then may have been at any time since the first count."""
PARTING_TICKS: Final = 10
"""So long after it began a parting shows at the latest."""
LEVEL_TICKS: Final = 100
LEAST_LEVEL_TICKS: Final = 40
"""From so many ticks without parting, at least, the inertial sensor's even share is taken."""
SETTLED_S: Final = 5.0
"""After a slip a method has made up its mind."""
SLIPPING_MPS: Final = 0.5
SLIPPING_MPS2: Final = 0.06
"""A wheel that differs from the inertial sensor by more, and so much more per second between, slips."""
DOUBT_MPS: Final = 0.4
DOUBT_MPS2: Final = 0.12
DOUBT_MPS3: Final = 0.008
"""What the inertial speed is known to, so much more per second, and per second squared, before the wheel's return."""


@dataclass(frozen=True, slots=True)
class FirstSlip:
    """A slip that was under way when the log began."""

    until_s: float
    """The wheel has returned."""
    t_s: Floats
    """Instants from the first count until then,"""
    way_m: Floats
    """and the way by the inertial sensor since the first of them."""
    speed_mps: Floats


def first_slip(log: MotionLog, rest: Shaking | None = None) -> FirstSlip | None:
    """The slip with which a log begins; None where it begins at rest, or the wheel adheres, or nothing tells.

    `rest`: what the inertial sensor shows at rest.
    """
    track = _track_of(log)
    found = None if track is None else _returned(track, limits_of(rest))
    if track is None or found is None:
        return None
    parted, returned = found
    ahead_mps = np.array([track.ahead_mps(at) for at in range(SPEED_TICKS, track.ticks)])
    if not np.isfinite(ahead_mps[: returned - SPEED_TICKS + LEVEL_TICKS]).all():
        return None
    last = max(min(parted - PARTING_TICKS, returned) - SPEED_TICKS, 0) if parted > FIRST_TICKS else 0
    slip_mps = _slip_of(ahead_mps, last, returned - SPEED_TICKS)
    # Until they first parted the wheel slipped as it did when the log began, or not at all.
    first = max(last - SPEED_TICKS, 0)
    until_s = (returned - first) * TICK_S
    if abs(float(np.mean(slip_mps[first : first + SPEED_TICKS]))) <= SLIPPING_MPS + SLIPPING_MPS2 * until_s:
        return None
    rim_mps = np.array([track.rim_mps(at) for at in range(SPEED_TICKS, returned)])
    speed_mps: Floats = np.r_[np.full(SPEED_TICKS, rim_mps[0] - slip_mps[0]), rim_mps - slip_mps]
    t_s: Floats = float(log.tacho_t_s[0]) + TICK_S * np.arange(returned + 1, dtype=np.float64)
    way_m: Floats = np.r_[0.0, np.cumsum(speed_mps) * TICK_S]
    last_mps: Floats = np.r_[speed_mps, speed_mps[-1]]
    return FirstSlip(float(t_s[-1]), t_s, way_m, last_mps)


def _slip_of(ahead_mps: Floats, parted: int, returned: int) -> Floats:
    """Slip until the wheel returned, positive where it was too fast, by what the rim was ahead since the first tick.

    The inertial sensor's even share is that after the return; where it shows before they parted, too, it changed
    evenly from that one to this.
    """
    ticks = np.arange(len(ahead_mps), dtype=np.float64)
    after = np.polynomial.Polynomial.fit(ticks[returned:][:LEVEL_TICKS], ahead_mps[returned:][:LEVEL_TICKS], 1)
    if parted < LEAST_LEVEL_TICKS:
        slip_mps: Floats = ahead_mps[:returned] - after(ticks[:returned])
        return slip_mps
    within = slice(max(parted - LEVEL_TICKS, 0), parted)
    before = np.polynomial.Polynomial.fit(ticks[within], ahead_mps[within], 1)
    slopes = [float(one.deriv()(0.0)) for one in (before, after)]
    gone = np.maximum(ticks[:returned] - parted, 0.0)
    at_parting_mps = float(after(float(returned))) - (slopes[0] + slopes[1]) / 2.0 * (returned - parted)
    share_mps = at_parting_mps + slopes[0] * (ticks[:returned] - parted)
    share_mps += (slopes[1] - slopes[0]) * gone**2 / (2.0 * max(returned - parted, 1))
    found_mps: Floats = ahead_mps[:returned] - share_mps
    return found_mps


def contradicts(slip: FirstSlip, log: MotionLog, rows: MotionRows) -> bool:
    """Whether a method's rows have gone a way that the slip excludes, until SETTLED_S after it."""
    counts_m = log.pulses.astype(np.float64) * log.vehicle.metres_per_pulse
    within = rows.t_s <= slip.until_s + SETTLED_S
    t_s = rows.t_s[within]
    # Once it has returned the wheel tells the way.
    rolled_m = np.interp(t_s, log.tacho_t_s, counts_m) - float(np.interp(slip.until_s, log.tacho_t_s, counts_m))
    way_m = np.interp(t_s, slip.t_s, slip.way_m) + np.where(t_s > slip.until_s, rolled_m, 0.0)
    apart_m = np.abs(rows.distance_m[within] - rows.distance_m[0] - way_m)
    return bool((apart_m > rows.bound_m[within]).any())


def widened(rows: MotionRows, slip: FirstSlip) -> MotionRows:
    """Rows of a method that has met the slip: until the wheel returned they are vouched for as the slip tells."""
    apart_m = np.abs(rows.distance_m - rows.distance_m[0] - np.interp(rows.t_s, slip.t_s, slip.way_m))
    lacking_m = apart_m + _doubt(rows.t_s, slip)[1] - rows.bound_m
    more_m = np.where(rows.t_s <= slip.until_s, np.maximum(lacking_m, 0.0), 0.0)
    wider = more_m > 0.0
    return replace(
        rows,
        bound_m=rows.bound_m + more_m,
        provisional_m=rows.provisional_m + more_m,
        status=np.where(wider & (rows.status != LOST), DEGRADED, rows.status).astype(np.int8),
        reason=np.where(wider, len(rows.reasons), rows.reason).astype(np.int16),
        reasons=(*rows.reasons, UNSEEN),
    )


def vouched_before(rows: MotionRows, slip: FirstSlip) -> MotionRows:
    """Rows until the wheel returned: the method may be right, or the inertial sensor backwards from there."""
    doubt_mps, more_m = _doubt(rows.t_s, slip)
    more_m += np.abs(rows.distance_m - rows.distance_m[0] - np.interp(rows.t_s, slip.t_s, slip.way_m))
    apart_mps = np.abs(rows.speed_mps - np.interp(rows.t_s, slip.t_s, slip.speed_mps))
    unknown = np.full(len(rows), np.nan)
    return replace(
        rows,
        bound_m=rows.bound_m + more_m,
        provisional_m=rows.provisional_m + more_m,
        speed_bound_mps=rows.speed_bound_mps + apart_mps + doubt_mps,
        status=np.where(rows.status == LOST, LOST, DEGRADED).astype(np.int8),
        reason=np.full(len(rows), len(rows.reasons), np.int16),
        reasons=(*rows.reasons, UNSEEN),
        curvature_per_m=unknown,
        curvature_sigma_per_m=unknown,
        curvature_distance_m=unknown,
    )


def _doubt(t_s: Floats, slip: FirstSlip) -> tuple[Floats, Floats]:
    """What the inertial speed, and the way by it, are known to at instants until the wheel returned."""
    before_s = slip.until_s - slip.t_s[0]
    left_s = np.clip(slip.until_s - t_s, 0.0, before_s)
    doubt_mps = DOUBT_MPS + DOUBT_MPS2 * left_s + DOUBT_MPS3 * left_s**2
    doubt_m = DOUBT_MPS * (t_s - slip.t_s[0]) + DOUBT_MPS2 * (before_s**2 - left_s**2) / 2.0
    return doubt_mps, doubt_m + DOUBT_MPS3 * (before_s**3 - left_s**3) / 3.0


def _track_of(log: MotionLog) -> MotionTrack | None:
    """Speeds of the log's beginning; None where it does not begin under way."""
    first_s = float(log.tacho_t_s[0])
    counts = log.tacho_t_s <= first_s + LONGEST_S + CALM_S
    samples = (log.imu_t_s <= first_s + LONGEST_S + CALM_S) & np.isfinite(log.imu).all(axis=1)
    way_m = log.pulses[counts].astype(np.float64) * log.vehicle.metres_per_pulse
    if not _turns(log.tacho_t_s[counts], way_m):
        return None
    track = MotionTrack(log.imu_latency_s)
    track.take(
        np.rint(log.imu_t_s[samples] * 1e9).astype(np.int64),
        log.imu[samples],
        np.rint(log.tacho_t_s[counts] * 1e9).astype(np.int64),
        way_m,
    )
    return track


def _turns(t_s: Floats, way_m: Floats) -> bool:
    """Whether the wheel turns in the first half second."""
    end_s = float(t_s[0]) + SPEED_TICKS * TICK_S
    gone_m = float(np.interp(end_s, t_s, way_m)) - float(way_m[0])
    return abs(gone_m) > TURNING_MPS * SPEED_TICKS * TICK_S


def _returned(track: MotionTrack, limits: Shaking) -> tuple[int, int] | None:
    """Tick at which rim and inertial sensor first parted, and the one from which on the wheel has adhered.

    None where it has from the beginning, or never does.
    """
    first: int | None = None
    parted = SPEED_TICKS
    calm_since = SPEED_TICKS
    for at in range(SPEED_TICKS, track.ticks):
        # A wheel that stands may be locked, unless the train stands, too.
        sound = abs(track.rim_mps(at)) > TURNING_MPS or track.shaking[at].within(limits)
        if not sound or track.parts(at):
            first = at if first is None else first
            parted, calm_since = at, at
        calm_s = (at - calm_since) * TICK_S
        if first is not None and calm_s >= CALM_S:
            return first, max(parted - RETURNED_TICKS, SPEED_TICKS + 1)
        if calm_s >= FIRST_CALM_S:
            return None
    return None
