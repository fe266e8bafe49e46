"""Broadcast ephemerides as one table, and the choice of the right one for a moment.

Times in a table are seconds from the start of its GPS week, on the GPS time scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.gnss import Ephemeris, KeplerOrbit, StateVectorOrbit
from schemas.gnss_time import WEEK_S
from services.gnss_receiver.observations import SYSTEMS, satellite_code
from services.numerics.kernel import kernel

KEPLER: Final = 0
BEIDOU_GEO: Final = 1
STATE_VECTOR: Final = 2

NO_EPHEMERIS: Final = -1
STALE: Final = -2
UNHEALTHY: Final = -3
"""What `select` gives instead of a row."""

BEIDOU_BEHIND_GPS_S: Final = 14
"""BDT is 14 s behind GPS time (BDS-SIS-ICD-B1I 3.0, 3.3)."""
BEIDOU_GEO_NUMBERS: Final = frozenset(range(1, 6)) | frozenset(range(59, 64))
"""PRN of the geostationary satellites (BDS-SIS-ICD-B1I 3.0, table 4-1)."""
CODES: Final = 100 * len(SYSTEMS)

KEPLER_FIELDS: Final = tuple(KeplerOrbit.__struct_fields__)
STATE_FIELDS: Final = ("x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps", "ax_mps2", "ay_mps2", "az_mps2")
EPHEMERIS: Final = np.dtype(
    [
        ("kind", np.int64),
        ("mu_m3ps2", np.float64),
        ("earth_rate_radps", np.float64),
        ("toe_s", np.float64),
        ("toe_own_tow_s", np.float64),
        ("toc_s", np.float64),
        ("clock_bias_s", np.float64),
        ("clock_drift", np.float64),
        ("clock_drift_rate_per_s", np.float64),
        ("group_delay_s", np.float64),
        ("fit_interval_s", np.float64),
        ("healthy", np.int64),
        ("issue", np.int64),
        ("frequency_channel", np.float64),
        *((name, np.float64) for name in KEPLER_FIELDS),
        *((name, np.float64) for name in STATE_FIELDS),
    ]
)
"""One ephemeris as a kernel reads it; units as in schemas.gnss."""

_EARTH: Final = {
    # gravitational parameter [m^3/s^2], rotation rate [rad/s]
    "G": (3.986005e14, 7.2921151467e-5),  # IS-GPS-200, table 20-IV
    "J": (3.986005e14, 7.2921151467e-5),  # IS-QZSS-PNT, 5.5.2: as GPS
    "I": (3.986005e14, 7.2921151467e-5),  # NavIC SIS ICD, appendix B: as GPS
    "E": (3.986004418e14, 7.2921151467e-5),  # Galileo OS SIS ICD, table 66 (GTRF)
    "C": (3.986004418e14, 7.2921150e-5),  # BDS-SIS-ICD-B1I, table 5-11 (CGCS2000)
    "R": (3.986004418e14, 7.292115e-5),  # GLONASS ICD 5.1, table 3.2 (PZ-90)
    "S": (3.986005e14, 7.2921151467e-5),  # RTCA DO-229: WGS 84
}


@dataclass(frozen=True, slots=True)
class EphemerisTable:
    """Ephemerides sorted by satellite and reference time."""

    gps_week: int
    """Week from whose start times are counted."""
    rows: NDArray[np.void]
    """Shape (n,), dtype EPHEMERIS."""
    first: NDArray[np.int64]
    """Shape (CODES + 1,): rows of satellite code k are `first[k]:first[k + 1]`."""

    def seconds(self, gps_week: int, tow_s: float) -> float:
        """Time of a table in seconds."""
        return (gps_week - self.gps_week) * WEEK_S + tow_s


def _row(ephemeris: Ephemeris, gps_week: int) -> tuple[float, ...]:
    system = ephemeris.satellite[0]
    offset_s = (ephemeris.gps_week - gps_week) * WEEK_S
    mu_m3ps2, earth_rate_radps = _EARTH[system]
    behind_s = BEIDOU_BEHIND_GPS_S if system == "C" else 0
    orbit = ephemeris.orbit
    kepler, state, kind, channel = (0.0,) * len(KEPLER_FIELDS), (0.0,) * len(STATE_FIELDS), KEPLER, 0.0
    if isinstance(orbit, StateVectorOrbit):
        kind, channel = STATE_VECTOR, float(orbit.frequency_channel)
        state = (*orbit.position_m, *orbit.velocity_mps, *orbit.acceleration_mps2)
    else:
        kepler = tuple(getattr(orbit, name) for name in KEPLER_FIELDS)
        if system == "C" and int(ephemeris.satellite[1:]) in BEIDOU_GEO_NUMBERS:
            kind = BEIDOU_GEO
    return (
        kind,
        mu_m3ps2,
        earth_rate_radps,
        ephemeris.toe_s + offset_s,
        (ephemeris.toe_s - behind_s) % WEEK_S,
        ephemeris.toc_s + offset_s,
        ephemeris.clock_bias_s,
        ephemeris.clock_drift,
        ephemeris.clock_drift_rate_per_s,
        ephemeris.group_delay_s,
        ephemeris.fit_interval_s,
        int(ephemeris.healthy),
        ephemeris.issue,
        channel,
        *kepler,
        *state,
    )


def tabulate(ephemerides: Sequence[Ephemeris], gps_week: int | None = None) -> EphemerisTable:
    """Table of `ephemerides`, counting from `gps_week` (default: the first one's week, else 0).

    Rows that share satellite and reference time stand in the order of transmission, then issue.
    """
    if gps_week is None:
        gps_week = ephemerides[0].gps_week if ephemerides else 0
    ordered = sorted(
        ephemerides, key=lambda one: (satellite_code(one.satellite), one.gps_week, one.toe_s, one.t_ns, one.issue)
    )
    rows = np.array([_row(one, gps_week) for one in ordered], dtype=EPHEMERIS)
    codes = np.array([satellite_code(one.satellite) for one in ordered], dtype=np.int64)
    return EphemerisTable(gps_week, rows, np.searchsorted(codes, np.arange(CODES + 1)).astype(np.int64))


@kernel
def select_row(rows: NDArray[np.void], first: NDArray[np.int64], code: int, t_s: float) -> int:
    """Row for one satellite and time, or why there is none; see `select`."""
    best, nearest_s = NO_EPHEMERIS, np.inf
    for row in range(first[code], first[code + 1]):
        age_s = abs(t_s - rows[row].toe_s)
        if age_s <= nearest_s:
            best, nearest_s = row, age_s
    if best >= 0 and not nearest_s <= rows[best].fit_interval_s:
        return STALE
    if best >= 0 and rows[best].healthy == 0:
        return UNHEALTHY
    return best


def select(table: EphemerisTable, code: NDArray[np.int64], t_s: NDArray[np.float64]) -> NDArray[np.int64]:
    """Row of the table for each satellite code and time, or why there is none (negative).

    The nearest reference time decides; of two equally near the later one, of two with the same
    the one sent last. If that one is older than its fit interval the satellite is STALE, if it
    says so UNHEALTHY: a worse ephemeris never stands in for what the best one says.
    """
    pairs = zip(code.tolist(), t_s.tolist(), strict=True)
    return np.array([select_row(table.rows, table.first, one, time_s) for one, time_s in pairs], np.int64)


def selection_reason(table: EphemerisTable, code: int, t_s: float, chosen: int) -> str:
    """In words why `select` gave no row for a satellite at a time; empty when it gave one.

    >>> selection_reason(tabulate([]), satellite_code("G01"), 0.0, NO_EPHEMERIS)
    'no ephemeris'
    """
    if chosen == NO_EPHEMERIS:
        return "no ephemeris"
    if chosen == UNHEALTHY:
        return "unhealthy"
    if chosen == STALE:
        rows = table.rows[table.first[code] : table.first[code + 1]]
        age_s = np.abs(t_s - rows["toe_s"])
        nearest = int(np.argmin(age_s))
        return f"ephemeris stale by {age_s[nearest] - rows['fit_interval_s'][nearest]:.0f} s"
    return ""
