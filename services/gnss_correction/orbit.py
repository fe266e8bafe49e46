"""Satellite position, velocity and clock from broadcast ephemerides.

Earth-fixed coordinates of the satellite's own system at the moment of transmission (WGS 84,
GTRF, CGCS2000, PZ-90.11: they agree within some centimetres and are taken as one).
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.gnss_correction.atmosphere import L1_HZ, LIGHT_MPS
from services.gnss_correction.ephemeris_table import BEIDOU_GEO, STATE_VECTOR, EphemerisTable
from services.numerics.kernel import kernel

GLONASS_A_M: Final = 6_378_136.0
"""Equatorial radius of PZ-90 (GLONASS ICD 5.1, table 3.2)."""
GLONASS_J2: Final = 1.0826257e-3
"""Second zonal harmonic (GLONASS ICD 5.1, A.3.1.2)."""
GLONASS_STEP_S: Final = 60.0
"""Longest Runge-Kutta step; 120 s already keep the error below a millimetre in 15 min."""
GLONASS_LONGEST_S: Final = 86_400.0
"""Beyond this a state vector is not integrated."""
GEO_TILT_RAD: Final = np.radians(-5.0)
"""Tilt of the frame of BeiDou's geostationary elements (BDS-SIS-ICD-B1I 3.0, table 5-11)."""
KEPLER_ROUNDS: Final = 30

GLONASS_L1_HZ: Final = 1_602.0e6
GLONASS_L1_STEP_HZ: Final = 0.5625e6
"""GLONASS ICD 5.1, 3.3.1.1."""
BEIDOU_B1I_HZ: Final = 1_561.098e6
"""BDS-SIS-ICD-B1I 3.0, 4.2.1."""


class SatelliteStates(NamedTuple):
    """Row i belongs to pair i. NaN where the ephemeris gives no orbit."""

    position_m: NDArray[np.float64]
    """Shape (n, 3), Earth-fixed at the moment of transmission."""
    velocity_mps: NDArray[np.float64]
    """Shape (n, 3), in the rotating frame."""
    clock_bias_s: NDArray[np.float64]
    """Satellite clock minus system time on L1, E1 or B1I: polynomial, relativity and group delay."""
    clock_drift: NDArray[np.float64]
    """[s/s]."""


def carrier_hz(system: str, frequency_channel: float = 0.0) -> float:
    """Carrier of the signal that this service uses: L1, E1, B1I; GLONASS by channel."""
    if system == "R":
        return GLONASS_L1_HZ + frequency_channel * GLONASS_L1_STEP_HZ
    return BEIDOU_B1I_HZ if system == "C" else L1_HZ


@kernel
def _eccentric_anomaly(mean_rad: float, eccentricity: float) -> float:
    """Kepler's equation by Newton's method."""
    anomaly = mean_rad
    for _ in range(KEPLER_ROUNDS):
        step = (anomaly - eccentricity * np.sin(anomaly) - mean_rad) / (1.0 - eccentricity * np.cos(anomaly))
        anomaly -= step
        if abs(step) < 1e-14:  # noqa: PLR2004 - some 0.3 micrometres along the orbit
            break
    return anomaly


@kernel
def _kepler(eph: Any, t_s: float, position: Any, velocity: Any) -> tuple[float, float]:  # noqa: ANN401 - numba record and array rows
    """Orbit by IS-GPS-200 table 20-IV with rates (Remondi 2004); returns the relativistic clock and its rate."""
    tk_s = t_s - eph.toe_s
    e, a_m = eph.eccentricity, eph.sqrt_a * eph.sqrt_a
    motion = np.sqrt(eph.mu_m3ps2 / (a_m * a_m * a_m)) + eph.delta_n_radps
    anomaly = _eccentric_anomaly(eph.m0_rad + motion * tk_s, e)
    sin_e, cos_e = np.sin(anomaly), np.cos(anomaly)
    anomaly_rate = motion / (1.0 - e * cos_e)
    root = np.sqrt(1.0 - e * e)
    phi = np.arctan2(root * sin_e, cos_e - e) + eph.omega_rad
    phi_rate = root * anomaly_rate / (1.0 - e * cos_e)
    s2, c2 = np.sin(2.0 * phi), np.cos(2.0 * phi)
    u = phi + eph.cus_rad * s2 + eph.cuc_rad * c2
    u_rate = phi_rate * (1.0 + 2.0 * (eph.cus_rad * c2 - eph.cuc_rad * s2))
    r = a_m * (1.0 - e * cos_e) + eph.crs_m * s2 + eph.crc_m * c2
    r_rate = a_m * e * sin_e * anomaly_rate + 2.0 * phi_rate * (eph.crs_m * c2 - eph.crc_m * s2)
    i = eph.i0_rad + eph.i_dot_radps * tk_s + eph.cis_rad * s2 + eph.cic_rad * c2
    i_rate = eph.i_dot_radps + 2.0 * phi_rate * (eph.cis_rad * c2 - eph.cic_rad * s2)
    # A geostationary satellite's node is kept inertial here; the Earth's turn follows below.
    turn = 0.0 if eph.kind == BEIDOU_GEO else eph.earth_rate_radps
    node_rate = eph.omega_dot_radps - turn
    node = eph.omega0_rad + node_rate * tk_s - eph.earth_rate_radps * eph.toe_own_tow_s
    cos_u, sin_u, cos_i, sin_i, cos_n, sin_n = np.cos(u), np.sin(u), np.cos(i), np.sin(i), np.cos(node), np.sin(node)
    xp, yp = r * cos_u, r * sin_u
    xp_rate, yp_rate = r_rate * cos_u - yp * u_rate, r_rate * sin_u + xp * u_rate
    position[0] = xp * cos_n - yp * cos_i * sin_n
    position[1] = xp * sin_n + yp * cos_i * cos_n
    position[2] = yp * sin_i
    across = yp_rate * cos_i - yp * sin_i * i_rate
    velocity[0] = xp_rate * cos_n - across * sin_n - position[1] * node_rate
    velocity[1] = xp_rate * sin_n + across * cos_n + position[0] * node_rate
    velocity[2] = yp_rate * sin_i + yp * cos_i * i_rate
    factor = -2.0 * np.sqrt(eph.mu_m3ps2) / (LIGHT_MPS * LIGHT_MPS) * e * eph.sqrt_a
    return factor * sin_e, factor * cos_e * anomaly_rate


@kernel
def _turn_geostationary(eph: Any, t_s: float, position: Any, velocity: Any) -> None:  # noqa: ANN401 - numba record and array rows
    """BeiDou's Rz(rate · tk) Rx(-5°) from the inertial into the Earth-fixed frame (BDS-SIS-ICD-B1I, table 5-11)."""
    ct, st = np.cos(GEO_TILT_RAD), np.sin(GEO_TILT_RAD)
    turn = eph.earth_rate_radps * (t_s - eph.toe_s)
    cz, sz = np.cos(turn), np.sin(turn)
    x, y, z = position[0], ct * position[1] + st * position[2], ct * position[2] - st * position[1]
    vx, vy, vz = velocity[0], ct * velocity[1] + st * velocity[2], ct * velocity[2] - st * velocity[1]
    position[0], position[1], position[2] = cz * x + sz * y, cz * y - sz * x, z
    velocity[0] = cz * vx + sz * vy + eph.earth_rate_radps * position[1]
    velocity[1] = cz * vy - sz * vx - eph.earth_rate_radps * position[0]
    velocity[2] = vz


@kernel
def _glonass_rate(eph: Any, state: Any, rate: Any) -> None:  # noqa: ANN401 - numba record and array rows
    """Equations of motion in the rotating frame (GLONASS ICD 5.1, A.3.1.2)."""
    x, y, z, vx, vy = state[0], state[1], state[2], state[3], state[4]
    r2 = x * x + y * y + z * z
    pull = eph.mu_m3ps2 / (r2 * np.sqrt(r2))
    flat = 1.5 * GLONASS_J2 * pull * GLONASS_A_M * GLONASS_A_M / r2
    tilt = 5.0 * z * z / r2
    turn = eph.earth_rate_radps
    rate[0], rate[1], rate[2] = state[3], state[4], state[5]
    rate[3] = (-pull - flat * (1.0 - tilt) + turn * turn) * x + 2.0 * turn * vy + eph.ax_mps2
    rate[4] = (-pull - flat * (1.0 - tilt) + turn * turn) * y - 2.0 * turn * vx + eph.ay_mps2
    rate[5] = (-pull - flat * (3.0 - tilt)) * z + eph.az_mps2


@kernel
def _glonass(eph: Any, t_s: float, position: Any, velocity: Any) -> None:  # noqa: ANN401 - numba record and array rows
    """State vector integrated to `t_s` by the classical Runge-Kutta method of fourth order."""
    ahead_s = t_s - eph.toe_s
    start = (eph.x_m, eph.y_m, eph.z_m, eph.vx_mps, eph.vy_mps, eph.vz_mps)
    state, trial, rate, total = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    near = abs(ahead_s) <= GLONASS_LONGEST_S
    for j in range(6):
        state[j] = start[j] if near else np.nan
    steps = max(1, int(np.ceil(abs(ahead_s) / GLONASS_STEP_S))) if near else 1
    step_s = ahead_s / steps
    for _ in range(steps):
        for stage in range(4):
            part_s = step_s if stage == 3 else 0.5 * step_s  # noqa: PLR2004 - the last of four stages
            for j in range(6):
                trial[j] = state[j] + (part_s * rate[j] if stage > 0 else 0.0)
            _glonass_rate(eph, trial, rate)
            weight = 1.0 if stage in (0, 3) else 2.0
            for j in range(6):
                total[j] = weight * rate[j] + (total[j] if stage > 0 else 0.0)
        for j in range(6):
            state[j] += step_s / 6.0 * total[j]
    for j in range(3):
        position[j], velocity[j] = state[j], state[3 + j]


@kernel
def state_at(eph: Any, t_s: float, position: Any, velocity: Any) -> tuple[float, float]:  # noqa: ANN401 - numba record and array rows
    """Orbit at system time `t_s` into `position` and `velocity` (3,); gives clock bias [s] and drift [s/s]."""
    since_s = t_s - eph.toc_s
    bias_s = eph.clock_bias_s + since_s * (eph.clock_drift + since_s * eph.clock_drift_rate_per_s) - eph.group_delay_s
    drift = eph.clock_drift + 2.0 * since_s * eph.clock_drift_rate_per_s
    if eph.kind == STATE_VECTOR:
        # Relativity is inside the broadcast gamma (GLONASS ICD 5.1, 3.3.3).
        _glonass(eph, t_s, position, velocity)
        return bias_s, drift
    relativity_s, relativity_drift = _kepler(eph, t_s, position, velocity)
    if eph.kind == BEIDOU_GEO:
        _turn_geostationary(eph, t_s, position, velocity)
    return bias_s + relativity_s, drift + relativity_drift


@kernel
def state_when_sent(
    eph: Any,  # noqa: ANN401 - numba record
    t_receive_s: float,
    pseudorange_m: float,
    position: Any,  # noqa: ANN401 - numba array
    velocity: Any,  # noqa: ANN401 - numba array
) -> tuple[float, float]:
    """State at the moment when the signal left that was received at `t_receive_s` by the receiver's clock.

    Reception time minus pseudorange over c is the satellite's own stamp whatever the receiver's
    clock says; the satellite's clock polynomial turns it into system time (IS-GPS-200,
    20.3.3.3.3.1; group delay and relativity in it move an orbit by less than 0.3 mm).
    """
    stamp_s = t_receive_s - pseudorange_m / LIGHT_MPS
    since_s = stamp_s - eph.toc_s
    ahead_s = eph.clock_bias_s + since_s * (eph.clock_drift + since_s * eph.clock_drift_rate_per_s)
    bias_s, drift = state_at(eph, stamp_s - ahead_s, position, velocity)
    return bias_s, drift


@kernel
def _states(rows: NDArray[np.void], row: NDArray[np.int64], t_s: NDArray[np.float64]) -> SatelliteStates:
    states = SatelliteStates(
        np.full((row.size, 3), np.nan),
        np.full((row.size, 3), np.nan),
        np.full(row.size, np.nan),
        np.full(row.size, np.nan),
    )
    for i in range(row.size):
        if row[i] >= 0:
            states.clock_bias_s[i], states.clock_drift[i] = state_at(
                rows[row[i]], t_s[i], states.position_m[i], states.velocity_mps[i]
            )
    return states


def satellite_states(table: EphemerisTable, row: NDArray[np.int64], t_s: NDArray[np.float64]) -> SatelliteStates:
    """States of the satellites in table rows `row` at system times `t_s` (both shape (n,)).

    `t_s` counts from the start of the table's week on the GPS time scale. Negative rows (see
    `ephemeris_table.select`) give NaN.
    """
    return _states(table.rows, row, t_s)
