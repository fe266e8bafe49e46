"""The speed profile that takes least traction energy for a given running time.

Dynamic programming (Bellman 1957) over the way: at each place and speed the cheapest of the controls that can be
optimal (full traction, holding the speed, coasting, braking, following the limit), where cost is energy plus a
price on time; the price is found by bisection so that the running time is the one wanted. Values are
interpolated between speeds, and the profile is then driven forward with the exact motion of each step, so
that what is returned is a run that keeps every limit, with its own time and energy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.line.alignment import Alignment
from services.numerics.kernel import inner_kernel, kernel
from services.run_history.traction_energy import JOULE_PER_KWH
from services.run_history.vehicle import Vehicle

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
STEP_M: Final = 10.0
SPEED_STEP_MPS: Final = 0.1
FEWEST_STEPS: Final = 20
FULL, HOLD, COAST, BRAKE, LIMIT = 0, 1, 2, 3, 4
CONTROLS: Final = ("accelerate", "hold", "coast", "brake", "follow the limit")
ROUNDING: Final = 1e-6
MOST_PRICE_W: Final = 1e8
TURNS: Final = 40
WITHIN_S: Final = 0.2
"""A running time this near to the wanted one will do."""


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
    """Cheapest profile of a running time. Raises OptimumError when no profile is so fast."""
    fastest = _solve(section, vehicle, MOST_PRICE_W)
    if fastest.running_time_s > running_time_s + WITHIN_S:
        msg = f"no faster than {fastest.running_time_s:.1f} s within limits, traction and brakes"
        raise OptimumError(msg)
    low, high = 0.0, np.log(MOST_PRICE_W)
    best = fastest
    for _ in range(TURNS):
        middle = 0.5 * (low + high)
        found = _solve(section, vehicle, float(np.exp(middle)))
        if found.running_time_s <= running_time_s + WITHIN_S:
            high = middle
            if found.traction_kwh <= best.traction_kwh:
                best = found
            if running_time_s - found.running_time_s <= WITHIN_S:
                break
        else:
            low = middle
    return best


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
    energy = _value(section.force_n, limit, figures, step_m, price_w, values, speed, time, control)
    if not np.isfinite(energy):
        msg = "the train cannot get through: a gradient too steep for its traction, or a limit of zero"
        raise OptimumError(msg)
    return Optimum(section.axis_m, speed, time, control, float(time[-1]), energy / JOULE_PER_KWH, price_w)


@kernel
def _value(
    force_n: Floats,
    limit: Floats,
    figures: Floats,
    step_m: float,
    price_w: float,
    values: Floats,
    speed: Floats,
    time: Floats,
    control: Ints,
) -> float:
    """Fill the values backwards, drive forwards; gives the energy [J], inf when there is no way."""
    n, levels = values.shape
    for i in range(levels):
        values[n - 1, i] = 0.0 if i == 0 else np.inf
    for k in range(n - 2, -1, -1):
        for i in range(levels):
            v = i * SPEED_STEP_MPS
            if v > limit[k] + SPEED_STEP_MPS:
                values[k, i] = np.inf
                continue
            v = min(v, limit[k])
            best = np.inf
            for which in range(5):
                ahead, seconds, joules = _step(which, v, force_n[k], limit[k + 1], figures, step_m)
                if seconds > 0.0:
                    best = min(best, joules + price_w * seconds + _at(values[k + 1], ahead))
            values[k, i] = best
    return _drive(force_n, limit, figures, step_m, price_w, values, speed, time, control)


@inner_kernel
def _drive(
    force_n: Floats,
    limit: Floats,
    figures: Floats,
    step_m: float,
    price_w: float,
    values: Floats,
    speed: Floats,
    time: Floats,
    control: Ints,
) -> float:
    """Forwards by the values: fills speed, time and control; gives the energy [J], inf when there is no way."""
    n = values.shape[0]
    energy = 0.0
    speed[0] = 0.0
    time[0] = 0.0
    for k in range(n - 1):
        best, chosen, next_v, next_s, next_j = np.inf, -1, 0.0, 0.0, 0.0
        for which in range(5):
            ahead, seconds, joules = _step(which, speed[k], force_n[k], limit[k + 1], figures, step_m)
            if seconds > 0.0:
                cost = joules + price_w * seconds + _at(values[k + 1], ahead)
                if cost < best:
                    best, chosen, next_v, next_s, next_j = cost, which, ahead, seconds, joules
        if chosen < 0:
            return np.inf
        control[k] = chosen
        speed[k + 1] = next_v
        time[k + 1] = time[k] + next_s
        energy += next_j
    control[n - 1] = BRAKE
    return energy


@inner_kernel
def _at(values: Floats, v: float) -> float:
    """Value between two speeds; that of the one below where the other has none."""
    x = v / SPEED_STEP_MPS
    i = min(int(x), values.size - 2)
    share = x - i
    low, high = float(values[i]), float(values[i + 1])
    if share < ROUNDING:  # exactly on a level
        return low
    if not np.isfinite(high):
        return low
    return low + share * (high - low)


@inner_kernel
def _step(
    which: int, v: float, force_n: float, limit_ahead: float, figures: Floats, step_m: float
) -> tuple[float, float, float]:
    """Speed ahead, seconds and joules of one step; seconds of 0 for a control that cannot be."""
    mass, a0, b0, c0, most_n, most_w, most_mps2, brake, efficiency = figures
    against = a0 + b0 * v + c0 * v * v + force_n
    pull = min(most_n, most_w / max(v, 1.0))
    coasting = -against / mass
    full = min((pull - against) / mass, most_mps2)
    to_limit = (limit_ahead * limit_ahead - v * v) / (2.0 * step_m)
    if which == FULL:
        acceleration = full
    elif which == HOLD:
        acceleration = 0.0
    elif which == COAST:
        acceleration = coasting
    elif which == BRAKE:
        acceleration = -brake
    else:
        acceleration = to_limit
    # Rounding must not forbid the braking curve that the limit itself is made of.
    if acceleration > full + ROUNDING or acceleration < -brake - ROUNDING:
        return 0.0, 0.0, 0.0
    squared = v * v + 2.0 * acceleration * step_m
    if squared < -ROUNDING:
        return 0.0, 0.0, 0.0
    ahead = np.sqrt(max(squared, 0.0))
    if ahead > limit_ahead + ROUNDING:
        return 0.0, 0.0, 0.0
    if ahead + v <= ROUNDING:  # it would stand
        return 0.0, 0.0, 0.0
    seconds = 2.0 * step_m / (v + ahead)
    mean = step_m / seconds
    traction = mass * acceleration + a0 + b0 * mean + c0 * mean * mean + force_n
    joules = max(traction, 0.0) * step_m / efficiency
    return ahead, seconds, joules
