"""The speed profile that takes least traction energy for a given running time.

Dynamic programming (Bellman 1957) over the way: at each place and speed the cheapest of the controls that can be
optimal (full traction, holding the speed, coasting, braking, following the limit), where cost is energy plus a
price on time; prices are tried until the running time wanted lies between two runs that cost nearly the same, and
these are blended. Values are interpolated between speeds, and the profile is driven with the exact motion of each
step, so that what is returned is a run that keeps every limit, with its own time and energy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.line.alignment import Alignment
from services.run_history.optimum_values import BRAKE, COAST, FULL, HOLD, SPEED_STEP_MPS, cheapest_way
from services.run_history.traction_energy import JOULE_PER_KWH
from services.run_history.vehicle import Vehicle

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
STEP_M: Final = 10.0
FEWEST_STEPS: Final = 20
MOST_PRICE_W: Final = 1e8
TURNS: Final = 40
LEAST_PRICE_W: Final = 1.0
CHORD_SHARE: Final = 1e-4
"""Two optima are near enough to be blended where that costs less than this share of the energy."""
SHARE_STEP: Final = 1e-6
PULL_SHARE: Final = 0.005
"""Above its traction a blend may ask of a train: the speed within a step is not told more closely."""
SLIGHT_MPS2: Final = 0.02
"""Less than this is neither driving nor braking."""
WITHIN_S: Final = 0.2
"""A fastest run this near to the wanted time will do."""


class OptimumError(ValueError):
    """No run can be found; the text says why."""


@dataclass(frozen=True, slots=True)
class Section:
    """What there is between two stations, on a grid in the direction of running. Arrays have shape (n,)."""

    axis_m: Floats
    force_n: Floats
    """Gradient and curves, against the motion, at the middle of the step that begins here."""
    limit_mps: Floats


@dataclass(frozen=True, slots=True)
class Optimum:
    """A profile. Arrays have shape (n,)."""

    axis_m: Floats
    speed_mps: Floats
    time_s: Floats
    """Since departure."""
    control: Ints
    """Of the step that begins here, an index into CONTROLS."""
    running_time_s: float
    traction_kwh: float
    """From the line."""
    price_w: float
    """What a second less would cost: the slope of energy against time."""


def section_between(way: Alignment, vehicle: Vehicle, start_m: float, end_m: float, step_m: float = STEP_M) -> Section:
    """Section from one place to another along a line; limits hold for the whole train. Raises OptimumError."""
    length = abs(end_m - start_m)
    if length < FEWEST_STEPS * step_m:
        msg = f"{length:.0f} m are too short for a profile"
        raise OptimumError(msg)
    count = int(np.ceil(length / step_m)) + 1
    along = np.linspace(0.0, length, count)
    sign = 1.0 if end_m > start_m else -1.0
    axis = start_m + sign * along
    middle = axis + sign * 0.5 * (along[1] - along[0])
    force = vehicle.track_force_n(sign * way.gradient_permille(middle), way.curvature_per_m(middle))
    limit = np.minimum(way.speed_limit_mps(axis), vehicle.max_speed_mps)
    # The rear end leaves a restriction a train's length later.
    reach = int(np.ceil(vehicle.length_m / (along[1] - along[0])))
    held = np.array([limit[max(0, k - reach) : k + 1].min() for k in range(count)])
    return Section(axis, force, held)


def optimum(section: Section, vehicle: Vehicle, running_time_s: float) -> Optimum:
    """Cheapest profile of a running time, never slower. Raises OptimumError when no profile is so fast.

    Two profiles, one faster and one slower, are found by the price of time and then blended.
    """
    fast = _solve(section, vehicle, MOST_PRICE_W)
    if fast.running_time_s > running_time_s + WITHIN_S:
        msg = f"no faster than {fast.running_time_s:.1f} s within limits, traction and brakes"
        raise OptimumError(msg)
    if fast.running_time_s >= running_time_s:
        return fast
    slow: Optimum | None = None
    # The first price is the power of the fastest run, and then less: what a second costs is of this order.
    price, smaller = max(fast.traction_kwh * JOULE_PER_KWH / fast.running_time_s, LEAST_PRICE_W), 3.0
    for turn in range(TURNS):
        found = _solve(section, vehicle, price)
        if found.running_time_s > running_time_s:
            slow = found
        else:
            fast = found
        if slow is None:
            if price <= LEAST_PRICE_W:
                return fast
            price, smaller = max(price / smaller, LEAST_PRICE_W), smaller * smaller
        elif _chord_j(slow, fast) < CHORD_SHARE * fast.traction_kwh * JOULE_PER_KWH:
            break
        else:
            price = _between(slow, fast, running_time_s, halves=turn % 3 == 2)  # noqa: PLR2004 - every third turn
    return fast if slow is None else _blended(section, vehicle, slow, fast, running_time_s)


def _between(slow: Optimum, fast: Optimum, wanted_s: float, *, halves: bool) -> float:
    """The next price, from those of two runs: by a line between their times, or half way (both in logarithms)."""
    share = (slow.running_time_s - wanted_s) / (slow.running_time_s - fast.running_time_s)
    share = 0.5 if halves else min(max(share, 0.1), 0.9)
    return float(slow.price_w * (fast.price_w / slow.price_w) ** share)


def _chord_j(slow: Optimum, fast: Optimum) -> float:
    """How far a blend of two optima can lie above the curve of optima, which is convex with the prices as slopes."""
    return 0.25 * (slow.running_time_s - fast.running_time_s) * (fast.price_w - slow.price_w)


def _blended(section: Section, vehicle: Vehicle, slow: Optimum, fast: Optimum, wanted_s: float) -> Optimum:
    """A run of the wanted time between two runs, the faster one where such a run would ask too much of the train.

    Blended are squares of speed: accelerations blend with them, so limits and brakes are kept, and as time and energy
    are convex in them the blend costs no more than its share of both.
    """
    step_m = abs(float(section.axis_m[1] - section.axis_m[0]))
    low, high = 0.0, 1.0
    while high - low > SHARE_STEP:
        share = 0.5 * (low + high)
        speed = np.sqrt((1.0 - share) * slow.speed_mps**2 + share * fast.speed_mps**2)
        if float(np.sum(2.0 * step_m / (speed[1:] + speed[:-1]))) > wanted_s:
            low = share
        else:
            high = share
    speed = np.sqrt((1.0 - high) * slow.speed_mps**2 + high * fast.speed_mps**2)
    acceleration = np.diff(speed**2) / (2.0 * step_m)
    mean = 0.5 * (speed[1:] + speed[:-1])
    traction = vehicle.inertial_mass_kg * acceleration + vehicle.resistance_n(mean) + section.force_n[:-1]
    pull = np.minimum(vehicle.max_tractive_kn * 1e3, vehicle.max_power_kw * 1e3 / np.maximum(speed[:-1], 1.0))
    joules = float(np.maximum(traction, 0.0).sum()) * step_m * vehicle.calibration / vehicle.line_to_wheel
    if (traction > pull * (1.0 + PULL_SHARE)).any() or joules > fast.traction_kwh * JOULE_PER_KWH:
        return fast
    time = np.concatenate(([0.0], np.cumsum(step_m / mean)))
    price = slow.price_w + high * (fast.price_w - slow.price_w)
    control = _controls(slow, fast, acceleration, traction / vehicle.inertial_mass_kg)
    return Optimum(section.axis_m, speed, time, control, float(time[-1]), joules / JOULE_PER_KWH, price)


def _controls(slow: Optimum, fast: Optimum, acceleration_mps2: Floats, traction_mps2: Floats) -> Ints:
    """Controls of a blend: those of both runs where they agree, by what the blend does where they do not."""
    driven = np.where(acceleration_mps2 > SLIGHT_MPS2, FULL, HOLD)
    named = np.where(traction_mps2 < -SLIGHT_MPS2, BRAKE, np.where(traction_mps2 < SLIGHT_MPS2, COAST, driven))
    return np.where(slow.control == fast.control, fast.control, np.append(named, BRAKE))


def fastest_run(section: Section, vehicle: Vehicle) -> Optimum:
    """The shortest running time, whatever it costs. Raises OptimumError."""
    return _solve(section, vehicle, MOST_PRICE_W)


def driven(vehicle: Vehicle, share: float) -> Vehicle:
    """The same vehicle with a driver who uses a share of its acceleration and of its brakes."""
    return msgspec.structs.replace(
        vehicle,
        max_acceleration_mps2=vehicle.max_acceleration_mps2 * share,
        service_brake_mps2=vehicle.service_brake_mps2 * share,
    )


def _solve(section: Section, vehicle: Vehicle, price_w: float) -> Optimum:
    n = len(section.axis_m)
    step_m = abs(float(section.axis_m[1] - section.axis_m[0]))
    brake = vehicle.service_brake_mps2
    left = step_m * np.arange(n - 1, -1, -1)
    limit = np.minimum(section.limit_mps, np.sqrt(2.0 * brake * left))
    # From behind: what can still be braked down to each limit ahead.
    for k in range(n - 2, -1, -1):
        limit[k] = min(limit[k], np.sqrt(limit[k + 1] ** 2 + 2.0 * brake * step_m))
    levels = int(np.ceil(float(limit.max()) / SPEED_STEP_MPS)) + 2
    a, b, c = vehicle.coefficients()
    figures = np.array(
        [
            vehicle.inertial_mass_kg,
            a,
            b,
            c,
            vehicle.max_tractive_kn * 1e3,
            vehicle.max_power_kw * 1e3,
            vehicle.max_acceleration_mps2,
            brake,
            vehicle.line_to_wheel / vehicle.calibration,
        ]
    )
    values = np.empty((n, levels))
    speed, time = np.zeros(n), np.zeros(n)
    control = np.zeros(n, np.int64)
    energy = cheapest_way(section.force_n, limit, figures, step_m, price_w, values, speed, time, control)
    if not np.isfinite(energy):
        msg = "the train cannot get through: a gradient too steep for its traction, or a limit of zero"
        raise OptimumError(msg)
    return Optimum(section.axis_m, speed, time, control, float(time[-1]), energy / JOULE_PER_KWH, price_w)
