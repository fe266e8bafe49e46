"""A run and its optimum under the same limits: the line's, and where those are not known, what runs were seen to do.

Speeds: the line's limits; where it knows none, the speeds that runs had there, the compared run's own among them.
Acceleration, traction and brakes: as the vehicle file states them, or as the compared run used them where it used
more. The way: from where it departed to where it stopped. So the run itself keeps the limits of its optimum, but for
restrictions that it exceeded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.line.alignment import Alignment
from services.run_history.optimum import Section, section_between
from services.run_history.speed_trace import SpeedTrace, speeds_on
from services.run_history.vehicle import Vehicle

Floats = NDArray[np.float64]
ABOUT_M: Final = 30.0
"""Places are known this well: a speed counts as seen this far before and behind."""
BESIDE_M: Final = 300.0
"""Beside stops trains are slow because they stop; there the highest speed seen so near to the stop holds."""
HIGH_PERCENT: Final = 95.0
"""Of the runs' speeds at a place; the highest of many is noise, or one driver's haste."""
ABILITIES: Final = ("max_acceleration_mps2", "service_brake_mps2", "max_tractive_kn", "max_power_kw")
SLOPE_S: Final = 3.0
"""Accelerations are told over this time."""


@dataclass(frozen=True, slots=True)
class SameLimits:
    """What an optimum may do that is compared with a run."""

    section: Section
    vehicle: Vehicle
    observed_share: float
    """Of the way, where no limit is known and observed speeds stand in."""
    over_mps: float
    """How much the run exceeded a known limit, at most; 0 where it kept them."""
    beyond: tuple[str, ...]
    """Names of what the run used more of than the vehicle file states, with the figure."""


def same_limits(
    way: Alignment, vehicle: Vehicle, traces: Sequence[SpeedTrace], own: int, start_m: float, sign: float
) -> SameLimits:
    """For trace `own` of runs from the station at `start_m` in direction `sign` along the axis. Raises OptimumError."""
    trace = traces[own]
    first_m, last_m = (float(np.clip(start_m + sign * one, 0.0, way.length_m)) for one in trace.way_m[[0, -1]])
    section = section_between(way, vehicle, first_m, last_m)
    place_m = sign * (section.axis_m - start_m)
    speed = speeds_on(trace, place_m)
    unknown = ~np.isfinite(way.speed_limit_mps(section.axis_m))
    over = np.where(unknown, 0.0, speed - section.limit_mps)
    # A train that was faster than the file allows it is believed.
    limit = np.where(unknown, np.maximum(section.limit_mps, speed), section.limit_mps)
    limit = np.where(unknown, np.minimum(limit, _seen_mps(section, place_m, traces, speed)), limit)
    able = _able(vehicle, trace, section, place_m)
    return SameLimits(
        replace(section, limit_mps=limit),
        able,
        float(unknown.mean()),
        float(max(0.0, over[1:-1].max(initial=0.0))),
        tuple(
            f"{name} {getattr(able, name):.3g}" for name in ABILITIES if getattr(able, name) > getattr(vehicle, name)
        ),
    )


def _seen_mps(section: Section, place_m: Floats, traces: Sequence[SpeedTrace], own_mps: Floats) -> Floats:
    """Speeds that runs had about each place, at least those of the compared run."""
    speeds = np.stack([speeds_on(one, place_m) for one in traces])
    seen = np.maximum(np.percentile(speeds, HIGH_PERCENT, axis=0), own_mps)
    step_m = abs(float(section.axis_m[1] - section.axis_m[0]))
    reach = int(np.ceil(ABOUT_M / step_m))
    seen = np.lib.stride_tricks.sliding_window_view(np.pad(seen, reach, mode="edge"), 2 * reach + 1).max(axis=1)
    beside = min(int(np.ceil(BESIDE_M / step_m)), len(seen) // 2)
    return np.concatenate(
        (np.full(beside, seen[:beside].max()), seen[beside:-beside], np.full(beside, seen[-beside:].max()))
    )


def _able(vehicle: Vehicle, trace: SpeedTrace, section: Section, place_m: Floats) -> Vehicle:
    """The vehicle with acceleration, traction and brakes raised to what a run used."""
    grid_s = np.arange(0.0, float(trace.time_s[-1]), 1.0)
    half = 0.5 * SLOPE_S
    before, after = (np.interp(grid_s + off, trace.time_s, trace.speed_mps) for off in (-half, half))
    slope = (after - before) / SLOPE_S
    speed = np.interp(grid_s, trace.time_s, trace.speed_mps)
    along = np.interp(np.interp(grid_s, trace.time_s, trace.way_m), place_m, section.force_n)
    force_kn = (vehicle.inertial_mass_kg * slope + vehicle.resistance_n(speed) + along) / 1000.0
    return msgspec.structs.replace(
        vehicle,
        max_acceleration_mps2=max(vehicle.max_acceleration_mps2, float(slope.max(initial=0.0))),
        service_brake_mps2=max(vehicle.service_brake_mps2, float(-slope.min(initial=0.0))),
        max_tractive_kn=max(vehicle.max_tractive_kn, float(force_kn.max(initial=0.0))),
        max_power_kw=max(vehicle.max_power_kw, float((force_kn * speed).max(initial=0.0))),
    )
