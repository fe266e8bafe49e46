"""Prediction and correction of one branch: the equations of the error-state filter.

    V' = V + a dt,  a = ax cos TH - M ay - az sin TH  (Iwata et al., equation 2, where az is gravity)
    TH' = TH + (-ωy + ωz φ + B + C ωz - M ωx) dt      (Iwata et al., equations 4 and 5)
    D' = D + V dt + a dt²/2,  W' = W + (V + U + L a) dt + a dt²/2

with the roll angle φ of `inertial_window`. U is micro-slip (Gauss-Markov) while the wheels adhere and a free random
walk in a slip. B, C, M and L hardly change.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.fused_layout import (
    ADHERING,
    GRAVITY_MPS2,
    SIZE,
    TH,
    B,
    C,
    Covariance,
    D,
    L,
    M,
    Record,
    State,
    U,
    V,
    W,
)
from services.odometry_fusion.motion_log import Floats

MOST_HEAVE_MPS2: Final = 3.0
"""No train is accelerated more than this upwards or downwards for a tick."""
CREEP_TIME_S: Final = 2.0
"""Correlation time of micro-slip."""
ATTITUDE_WALK: Final = 1.4e-4
"""Random walk of the attitude beside the gyro's noise (springs, accelerometer bias), rad per √s."""
BIAS_WALK: Final = 7e-6
LEAK_WALK: Final = 3e-4
LAG_WALK: Final = 2e-4
"""Random walks of B, C and L, per √s."""
OUTLIER_SIGMA: Final = 3.0
"""Beyond this many standard deviations an innovation's weight falls (Huber)."""
FIRST_SIGMAS: Final = (0.05, 0.02, 1.0, 0.1, 0.0035, 0.02, 0.02, 0.05, 0.05)
"""Of D, W, V, TH, B, C, M, L, U when nothing is known yet but the wheel's speed: no standstill is needed to begin."""
FORCE: Final = 0
RATE: Final = 1
CREEP: Final = 2
ACCELERATION: Final = 3
WALK: Final = 4
"""Places in `noise`: variances of ax [m²/s⁴], of the pitch rate over a step [rad²/s²] and of micro-slip [m²/s²];
intensities of an unknown acceleration [m²/s³] and of the slip speed's walk [m²/s³]."""


@kernel
def begin_state(x: State, p: Covariance) -> None:
    """State of a train of which nothing is known."""
    x[:] = 0.0
    p[:] = 0.0
    for i in range(SIZE):
        p[i, i] = FIRST_SIGMAS[i] ** 2


@kernel
def acceleration(x: State, tick: Record) -> float:
    """Of the train, level [m/s²]: along the track but for the cosine of its gradient, of which nothing is left at 35 ‰.

    Both axes count, not x and gravity alone (Iwata et al., equation 2, to which this comes where TH is small): over a
    crest the train is accelerated downwards by v TH', and of that a sensor whose nose is down shows some on x.
    """
    return float(tick.ax_mps2 * np.cos(x[TH]) - x[M] * tick.ay_mps2 - vertical_force(tick) * np.sin(x[TH]))


@kernel
def steady_force(x: State, tick: Record) -> float:
    """What x shows while the train keeps its speed [m/s²]."""
    return float((x[M] * tick.ay_mps2 + vertical_force(tick) * np.sin(x[TH])) / np.cos(x[TH]))


@kernel
def vertical_force(tick: Record) -> float:
    """Specific force on z [m/s²], never far from gravity whatever a broken axis shows."""
    return float(min(max(tick.az_mps2, GRAVITY_MPS2 - MOST_HEAVE_MPS2), GRAVITY_MPS2 + MOST_HEAVE_MPS2))


@kernel
def predict(x: State, p: Covariance, mode: int, dt_s: float, tick: Record, now: Record, noise: Floats) -> None:
    """Take state and covariance over a step with its means (`tick`), the roll angle and biases (`now`)."""
    gx = tick.gx_radps - now.roll_bias_radps
    gz = tick.gz_radps - now.yaw_bias_radps
    ay = tick.ay_mps2
    a = acceleration(x, tick)
    fade = np.exp(-dt_s / CREEP_TIME_S) if mode == ADHERING else 1.0
    half = 0.5 * a * dt_s * dt_s
    x[D] += x[V] * dt_s + half
    x[W] += (x[V] + x[U] + x[L] * a) * dt_s + half
    x[V] += a * dt_s
    x[TH] += (-tick.gy_radps + gz * now.roll_rad + x[B] + x[C] * gz - x[M] * gx) * dt_s
    x[U] *= fade
    _spread(p, dt_s, fade, -ay * dt_s, gz * dt_s, -gx * dt_s, a * dt_s)
    p[V, V] += noise[FORCE] * dt_s * dt_s + noise[ACCELERATION] * dt_s
    p[TH, TH] += noise[RATE] * dt_s * dt_s + ATTITUDE_WALK**2 * dt_s
    p[B, B] += BIAS_WALK**2 * dt_s
    p[C, C] += LEAK_WALK**2 * dt_s
    p[L, L] += LAG_WALK**2 * dt_s
    p[U, U] += noise[CREEP] * (1.0 - fade * fade) if mode == ADHERING else noise[WALK] * dt_s


@kernel
def _spread(p: Covariance, dt_s: float, fade: float, v_m: float, th_c: float, th_m: float, w_l: float) -> None:
    """F P Fᵀ, rows and then columns; F is the identity but for a few entries (v_m: of M in V', and so on)."""
    v_th = -GRAVITY_MPS2 * dt_s
    for j in range(SIZE):
        p[D, j] += dt_s * p[V, j]
        p[W, j] += dt_s * (p[V, j] + p[U, j]) + w_l * p[L, j]
        p[V, j] += v_th * p[TH, j] + v_m * p[M, j]
        p[TH, j] += dt_s * p[B, j] + th_c * p[C, j] + th_m * p[M, j]
        p[U, j] *= fade
    for i in range(SIZE):
        p[i, D] += dt_s * p[i, V]
        p[i, W] += dt_s * (p[i, V] + p[i, U]) + w_l * p[i, L]
        p[i, V] += v_th * p[i, TH] + v_m * p[i, M]
        p[i, TH] += dt_s * p[i, B] + th_c * p[i, C] + th_m * p[i, M]
        p[i, U] *= fade


@kernel
def correct(x: State, p: Covariance, row: int, residual: float, variance: float) -> float:
    """Correct by a measurement of one unknown; gives the logarithm of its likelihood but for a constant.

    An innovation beyond OUTLIER_SIGMA is weighed down, and its likelihood falls linearly only (Huber), so that one
    wrong sample kills no branch.
    """
    spread = p[row, row] + variance
    score = abs(residual) / np.sqrt(spread)
    likelihood = -0.5 * np.log(spread)
    if score > OUTLIER_SIGMA:
        likelihood -= OUTLIER_SIGMA * (score - 0.5 * OUTLIER_SIGMA)
        spread *= score / OUTLIER_SIGMA
    else:
        likelihood -= 0.5 * score * score
    gain = p[:, row].copy()
    for i in range(SIZE):
        x[i] += gain[i] * residual / spread
        for j in range(SIZE):
            p[i, j] -= gain[i] * gain[j] / spread
    return float(likelihood)
