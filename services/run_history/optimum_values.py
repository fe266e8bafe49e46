"""The dynamic programme under an optimum: values backwards over way and speed, then the run that follows them.

Compiled. At each place and speed it tries the controls that can be optimal; energies and times are those of the exact
motion of one step, values between two speeds are interpolated.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import inner_kernel, kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
SPEED_STEP_MPS: Final = 0.1
LEVELS_A_MPS: Final = 10.0
"""The same step the other way round, for a multiplication is quicker than a division."""
ROUNDING: Final = 1e-6
FULL, HOLD, COAST, BRAKE, LIMIT = 0, 1, 2, 3, 4
CONTROLS: Final = ("accelerate", "hold", "coast", "brake", "follow the limit")


@kernel
def cheapest_way(
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
    """Fill the values backwards, drive forwards; gives the energy [J], inf when there is no way.

    `force_n`, `limit`, `speed`, `time`, `control` have shape (n,), `values` (n, levels). `figures`: inertial mass,
    three coefficients of resistance, most force, most power, most acceleration, brake, efficiency (SI units).
    """
    n, levels = values.shape
    a0, b0, c0, most_n, most_w = figures[1], figures[2], figures[3], figures[4], figures[5]
    drag, pull = np.empty(levels), np.empty(levels)
    for i in range(levels):
        v = i * SPEED_STEP_MPS
        drag[i] = a0 + b0 * v + c0 * v * v
        pull[i] = min(most_n, most_w / max(v, 1.0))
        values[n - 1, i] = 0.0 if i == 0 else np.inf
    for k in range(n - 2, -1, -1):
        ahead = values[k + 1]
        at_limit = _at(ahead, limit[k + 1])
        for i in range(levels):
            v = i * SPEED_STEP_MPS
            if v <= limit[k]:
                d, p = drag[i], pull[i]
            elif v <= limit[k] + SPEED_STEP_MPS:
                v = limit[k]
                d, p = a0 + b0 * v + c0 * v * v, min(most_n, most_w / max(v, 1.0))
            else:
                values[k, i:] = np.inf
                break
            values[k, i] = _cheapest(v, d, p, force_n[k], limit[k + 1], at_limit, figures, step_m, price_w, ahead)[0]
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
    a0, b0, c0, most_n, most_w = figures[1], figures[2], figures[3], figures[4], figures[5]
    energy = 0.0
    speed[0] = 0.0
    time[0] = 0.0
    for k in range(n - 1):
        v = speed[k]
        d, p = a0 + b0 * v + c0 * v * v, min(most_n, most_w / max(v, 1.0))
        at_limit = _at(values[k + 1], limit[k + 1])
        cost, which, ahead, seconds, joules = _cheapest(
            v, d, p, force_n[k], limit[k + 1], at_limit, figures, step_m, price_w, values[k + 1]
        )
        if not np.isfinite(cost):
            return np.inf
        control[k] = which
        speed[k + 1] = ahead
        time[k + 1] = time[k] + seconds
        energy += joules
    control[n - 1] = BRAKE
    return energy


@inner_kernel
def _at(values: Floats, v: float) -> float:
    """Value between two speeds; that of the one below where the other has none."""
    x = v * LEVELS_A_MPS
    i = min(int(x), values.size - 2)
    share = x - i
    low, high = float(values[i]), float(values[i + 1])
    if share < ROUNDING or not np.isfinite(high):  # exactly on a level, or below a limit
        return low
    return low + share * (high - low)


@inner_kernel
def _cheapest(
    v: float,
    drag_n: float,
    pull_n: float,
    force_n: float,
    limit_ahead: float,
    at_limit: float,
    figures: Floats,
    step_m: float,
    price_w: float,
    values: Floats,
) -> tuple[float, int, float, float, float]:
    """Cost, control, speed ahead, seconds and joules of the cheapest step; a cost of inf where there is none."""
    mass, brake, per_wheel = figures[0], figures[7], step_m / figures[8]
    against = drag_n + force_n
    full = min((pull_n - against) / mass, figures[6])
    coast = -against / mass
    twice = 2.0 * step_m
    squared = v * v
    to_limit = (limit_ahead * limit_ahead - squared) / twice
    best, chosen, best_v, best_s, best_j = np.inf, -1, 0.0, 0.0, 0.0
    for which in range(5):
        if which == FULL:
            acceleration = full
        elif which == HOLD:
            acceleration = 0.0
        elif which == COAST:
            acceleration = coast
        elif which == BRAKE:
            acceleration = -brake
        else:
            acceleration = to_limit
        # Rounding must not forbid the braking curve that the limit itself is made of.
        if acceleration > full + ROUNDING or acceleration < -brake - ROUNDING or acceleration > to_limit + ROUNDING:
            continue
        after = squared + twice * acceleration
        if after < -ROUNDING:
            continue
        ahead = v if which == HOLD else (limit_ahead if which == LIMIT else np.sqrt(max(after, 0.0)))
        both = ahead + v
        if both <= ROUNDING:  # it would stand
            continue
        seconds = twice / both
        mean = 0.5 * both
        traction = mass * acceleration + figures[1] + figures[2] * mean + figures[3] * mean * mean + force_n
        joules = max(traction, 0.0) * per_wheel
        cost = joules + price_w * seconds + (at_limit if which == LIMIT else _at(values, ahead))
        if cost < best:
            best, chosen, best_v, best_s, best_j = cost, which, ahead, seconds, joules
    return best, chosen, best_v, best_s, best_j
