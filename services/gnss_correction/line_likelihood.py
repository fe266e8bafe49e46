"""How well places on a line explain the measurements of one epoch: the kernel of method `line`.

At every cell (a place on the axis) stands a small filter of its own, given that the train is there:
speed along the axis and receiver clock drift, estimated together from Doppler, whose direction the
axis knows; and one receiver clock per constellation, estimated from the pseudoranges. What is left
over after these is the cell's cost, and from costs come the probabilities.

Measurements are weighted by the redescending function of Geman and McClure 1987, rho(z) = z² / (1 + z²/a²),
through iteratively reweighted steps: reflections lie far out and then count for nothing. Errors
of one satellite repeat from epoch to epoch, so pseudoranges are tempered: of each epoch only the
share that is new counts, in clock and cost alike.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.gnss_correction.atmosphere import LIGHT_MPS
from services.gnss_correction.line_of_sight import EARTH_RATE_RADPS, delay_m, direct, look
from services.gnss_correction.position_fit import geodetic
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.solver_arrays import MOST_SYSTEMS, Float64s, Records
from services.gnss_correction.weighting import LOWEST_SINE, MISSING_CN0_DBHZ
from services.numerics.kernel import kernel

SPEED, DRIFT, VAR_SPEED, COVARIANCE, VAR_DRIFT, CLOCK = 0, 1, 2, 3, 4, 5
"""Columns of a cell's state; from CLOCK on the clocks [m], then as many variances of theirs [m²]."""
VAR_CLOCK: Final = CLOCK + MOST_SYSTEMS
STATES: Final = CLOCK + 2 * MOST_SYSTEMS
UNKNOWN_CLOCK_M2: Final = 1e9
WANDERED_M2: Final = 900.0
"""A clock less certain than this starts from the median instead of its past."""
UNKNOWN_DRIFT_M2PS2: Final = 1e4

CODE_FLOOR_M: Final = 3.0
"""Standard deviation of the best pseudoranges: orbits, air, and the axis not quite under the antenna."""
CODE_NOISE_M: Final = 3.0
"""More at 40 dB-Hz in the zenith, growing with falling power and elevation."""
RATE_FLOOR_MPS: Final = 0.15
RATE_NOISE_MPS: Final = 0.5
"""Of Doppler, at 35 dB-Hz."""
REACH: Final = 2.0
"""`a` of the weight function: cost never exceeds its square."""
TANGENT_RAD: Final = 0.05
"""How far the train's course may differ from the direction of the axis (3 degrees)."""
ROUNDS: Final = 4

SIGHT: Final = np.dtype(
    [
        ("system", np.int64),
        *(
            (name, np.float64)
            for name in (
                "x_m",
                "y_m",
                "z_m",
                "vx_mps",
                "vy_mps",
                "vz_mps",
                # pseudorange and range rate without the satellite's clock and the delays of the air
                "range_m",
                "rate_mps",
                "sigma_m",
                "sigma_mps",
                # scratch: what remains at the present cell, and how the rate answers to speed
                "left_m",
                "left_mps",
                "along",
            )
        ),
    ]
)
"""A satellite as the cells see it."""

_USABLE, _LOW, _WEAK, _ALONE = (
    int(one) for one in (Rejection.USABLE, Rejection.BELOW_MASK, Rejection.WEAK_SIGNAL, Rejection.ALONE_IN_SYSTEM)
)


@kernel
def take_sights(rows: Records, place: Float64s, tow_s: float, rules: Any, sights: Records) -> int:  # noqa: ANN401 - numba record
    """Fill `sights` from the usable rows of an epoch, seen from about `place` (3,); gives how many.

    Completes direction and rejection of the rows.
    """
    level = geodetic(place[0], place[1], place[2])
    count = 0
    for row in rows:
        if row.rejection in (_LOW, _WEAK, _ALONE):
            row.rejection = _USABLE
        if row.rejection != _USABLE:
            continue
        look(row, place)
        direct(row, level)
        if row.elevation_rad < rules.elevation_mask_rad:
            row.rejection = _LOW
            continue
        if row.strength_dbhz < rules.cn0_mask_dbhz:
            row.rejection = _WEAK
            continue
        sight = sights[count]
        count += 1
        sight.system = row.system
        sight.x_m, sight.y_m, sight.z_m = row.x_m, row.y_m, row.z_m
        sight.vx_mps, sight.vy_mps, sight.vz_mps = row.vx_mps, row.vy_mps, row.vz_mps
        sight.range_m = row.pseudorange_m + row.clock_m - delay_m(row, level, tow_s, rules)
        sight.rate_mps = row.range_rate_mps + row.drift_mps
        sine = max(np.sin(row.elevation_rad), LOWEST_SINE)
        density = row.strength_dbhz if np.isfinite(row.strength_dbhz) else MISSING_CN0_DBHZ
        code_m2 = CODE_NOISE_M * CODE_NOISE_M * 10.0 ** ((40.0 - density) / 10.0) / (sine * sine)
        sight.sigma_m = np.sqrt(CODE_FLOOR_M * CODE_FLOOR_M + code_m2)
        rate_m2ps2 = RATE_NOISE_MPS * RATE_NOISE_MPS * 10.0 ** ((35.0 - density) / 10.0) / sine
        sight.sigma_mps = np.sqrt(RATE_FLOOR_MPS * RATE_FLOOR_MPS + rate_m2ps2)
    return count


@kernel
def _weight(z: float) -> float:
    """Weight that goes with the cost of a standardised residual."""
    share = 1.0 + z * z / (REACH * REACH)
    return 1.0 / (share * share)


@kernel
def _cost(z: float) -> float:
    return z * z / (1.0 + z * z / (REACH * REACH))


@kernel
def _look(sights: Records, x: float, y: float, z: float, tangent: Float64s) -> None:
    """What pseudoranges and rates leave over at a place, but for clock, drift and speed."""
    turn = EARTH_RATE_RADPS / LIGHT_MPS
    for sight in sights:
        dx, dy, dz = sight.x_m - x, sight.y_m - y, sight.z_m - z
        distance_m = np.sqrt(dx * dx + dy * dy + dz * dz)
        ex, ey, ez = dx / distance_m, dy / distance_m, dz / distance_m
        sight.left_m = sight.range_m - distance_m - turn * (sight.x_m * y - sight.y_m * x)
        approach_mps = ex * sight.vx_mps + ey * sight.vy_mps + ez * sight.vz_mps
        sight.left_mps = sight.rate_mps - approach_mps - turn * (sight.vx_mps * y - sight.vy_mps * x)
        sight.along = -(ex * tangent[0] + ey * tangent[1] + ez * tangent[2])


@kernel
def _fit_clock(sights: Records, state: Float64s, system: int, fresh: float, spare: Float64s) -> float:
    """Bring one constellation's clock up to date; gives its cost."""
    count = 0
    for sight in sights:
        if sight.system == system:
            spare[count] = sight.left_m
            count += 1
    if count == 0:
        return 0.0
    before_m, before_m2 = state[CLOCK + system], state[VAR_CLOCK + system]
    clock_m = before_m if before_m2 < WANDERED_M2 else np.median(spare[:count])
    information = 0.0
    for _ in range(ROUNDS):
        information, whole = 1.0 / before_m2, before_m / before_m2
        for sight in sights:
            if sight.system == system:
                weight = fresh * _weight((sight.left_m - clock_m) / sight.sigma_m) / (sight.sigma_m * sight.sigma_m)
                information += weight
                whole += weight * sight.left_m
        clock_m = whole / information
    cost = (clock_m - before_m) ** 2 / before_m2
    for sight in sights:
        if sight.system == system:
            cost += fresh * _cost((sight.left_m - clock_m) / sight.sigma_m)
    state[CLOCK + system], state[VAR_CLOCK + system] = clock_m, 1.0 / information
    return float(cost)


@kernel
def _fit_speed(sights: Records, state: Float64s, wheel: Float64s, spare: Float64s) -> float:
    """Bring speed and drift up to date by Doppler and wheel speed; gives the cost.

    `wheel`: speed without a sign and its variance; NaN where there is none.
    """
    v0, d0 = state[SPEED], state[DRIFT]
    determinant = state[VAR_SPEED] * state[VAR_DRIFT] - state[COVARIANCE] * state[COVARIANCE]
    i00, i01, i11 = state[VAR_DRIFT] / determinant, -state[COVARIANCE] / determinant, state[VAR_SPEED] / determinant
    v, d, count = v0, d0, 0
    for sight in sights:
        if np.isfinite(sight.left_mps):
            spare[count] = sight.left_mps - sight.along * v
            count += 1
    if count > 0 and state[VAR_DRIFT] > UNKNOWN_DRIFT_M2PS2:
        d = np.median(spare[:count])
    j00, j01, j11 = i00, i01, i11
    for _ in range(ROUNDS):
        j00, j01, j11 = i00, i01, i11
        g0, g1 = i00 * v0 + i01 * d0, i01 * v0 + i11 * d0
        for sight in sights:
            if np.isfinite(sight.left_mps):
                z = (sight.left_mps - sight.along * v - d) / sight.sigma_mps
                weight = _weight(z) / (sight.sigma_mps * sight.sigma_mps)
                j00 += weight * sight.along * sight.along
                j01 += weight * sight.along
                j11 += weight
                g0 += weight * sight.along * sight.left_mps
                g1 += weight * sight.left_mps
        if np.isfinite(wheel[0]):
            j00 += 1.0 / wheel[1]
            g0 += (wheel[0] if v >= 0.0 else -wheel[0]) / wheel[1]
        both = j00 * j11 - j01 * j01
        v, d = (j11 * g0 - j01 * g1) / both, (j00 * g1 - j01 * g0) / both
    both = j00 * j11 - j01 * j01
    state[SPEED], state[DRIFT] = v, d
    state[VAR_SPEED], state[COVARIANCE], state[VAR_DRIFT] = j11 / both, -j01 / both, j00 / both
    cost = i00 * (v - v0) ** 2 + 2.0 * i01 * (v - v0) * (d - d0) + i11 * (d - d0) ** 2
    for sight in sights:
        if np.isfinite(sight.left_mps):
            spread = np.sqrt(sight.sigma_mps * sight.sigma_mps + (TANGENT_RAD * v) ** 2)
            cost += _cost((sight.left_mps - sight.along * v - d) / spread)
    return float(cost)


@kernel
def weigh_cells(
    places: Float64s,
    tangents: Float64s,
    states: Float64s,
    sights: Records,
    fresh: float,
    fresh_rate: float,
    wheel: Float64s,
    cost: Float64s,
) -> None:
    """Bring the filters of cells up to date with one epoch, and give every cell its `cost` (n,).

    `places`, `tangents` (n, 3) Earth-fixed, `states` (n, STATES). `fresh` is the share of the
    pseudoranges' information that earlier epochs did not already bring, `fresh_rate` that of Doppler
    for the place. Cells whose cost comes in as infinite are left as they are. A cost is minus twice a log-likelihood.
    """
    spare = np.empty(max(sights.size, 1))
    for i in range(places.shape[0]):
        if np.isinf(cost[i]):
            continue
        _look(sights, places[i, 0], places[i, 1], places[i, 2], tangents[i])
        total = fresh_rate * _fit_speed(sights, states[i], wheel, spare)
        for system in range(MOST_SYSTEMS):
            total += _fit_clock(sights, states[i], system, fresh, spare)
        cost[i] = total


@kernel
def level_of(place: Float64s, tangent: Float64s, state: Float64s, sights: Records) -> float:
    """Mean cost of the pseudoranges at a cell as a share of the largest possible: 0 all agree, 1 none does."""
    _look(sights, place[0], place[1], place[2], tangent)
    total = 0.0
    for sight in sights:
        total += _cost((sight.left_m - state[CLOCK + sight.system]) / sight.sigma_m)
    return total / (REACH * REACH * max(sights.size, 1))


@kernel
def rate_level_of(place: Float64s, tangent: Float64s, state: Float64s, sights: Records) -> float:
    """The same of Doppler; 0 where there is none."""
    _look(sights, place[0], place[1], place[2], tangent)
    total, count = 0.0, 0
    for sight in sights:
        if np.isfinite(sight.left_mps):
            total += _cost((sight.left_mps - sight.along * state[SPEED] - state[DRIFT]) / sight.sigma_mps)
            count += 1
    return total / (REACH * REACH * max(count, 1))


@kernel
def common_jump_m(place: Float64s, tangent: Float64s, state: Float64s, sights: Records) -> float:
    """By how much all clocks at a cell are off in common [m]; 0 when more than half of the satellites do not say so."""
    _look(sights, place[0], place[1], place[2], tangent)
    jumps = np.empty(sights.size)
    count = 0
    for sight in sights:
        if state[VAR_CLOCK + sight.system] < WANDERED_M2:
            jumps[count] = sight.left_m - state[CLOCK + sight.system]
            count += 1
    if count < 3:  # noqa: PLR2004 - two satellites may err alike
        return 0.0
    middle_m = np.median(jumps[:count])
    agreeing = 0
    for jump_m in jumps[:count]:
        if abs(jump_m - middle_m) < 50.0:  # noqa: PLR2004 - further than most reflections reach
            agreeing += 1
    return middle_m if 2 * agreeing > count and abs(middle_m) > 150.0 else 0.0  # noqa: PLR2004 - 0.5 microseconds


def no_states(cells: int) -> NDArray[np.float64]:
    """States of cells that know nothing, shape (cells, STATES)."""
    states = np.zeros((cells, STATES))
    states[:, VAR_SPEED] = 400.0
    states[:, VAR_DRIFT] = 1e6
    states[:, VAR_CLOCK:] = UNKNOWN_CLOCK_M2
    return states
