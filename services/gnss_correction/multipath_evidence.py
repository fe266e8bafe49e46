"""What speaks for multipath in each pseudorange: figures from its past, its signal and the place found from all.

Every figure is causal. Common modes (drift and jumps of the receiver's clock) are the medians over
the satellites of an epoch and are taken out. Peaks are held and decay: a reflection that came in
with a jump mostly stays for seconds although nothing moves any more (slow, long biases show in
the change of a pseudorange only when they come and go).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.atmosphere import LIGHT_MPS
from services.gnss_correction.ephemeris_table import CODES
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.solver_arrays import Float64s, Ints, Records
from services.numerics.kernel import kernel

EVIDENCE: Final = np.dtype(
    [
        (name, np.float64)
        for name in (
            "residual_m",
            "residual_mean_m",
            "deficit_db",
            "drop_db",
            "change_m",
            "change_hold_m",
            "divergence_m",
            "divergence_hold_m",
            "rate_residual_mps",
            "rate_hold_mps",
            "slip_hold",
        )
    ]
)
"""Evidence of one satellite at one epoch; NaN where there is none.

`residual_m` against the reference solution and `residual_mean_m`, its recent mean; `deficit_db` of
C/N0 under the receiver's profile at that elevation and `drop_db` under the satellite's own recent
best; `change_m` of the pseudorange that Doppler did not predict, `divergence_m` that the carrier
phase did not, `rate_residual_mps` of Doppler against the reference's velocity, common modes
removed; `…_hold…` their decaying peaks; `slip_hold` the decaying memory of a cycle slip, 0 to 1.
"""

ZENITH_DBHZ: Final = 48.0
"""C/N0 of a clear satellite overhead before the receiver's own is known: an outdoor antenna, IS-GPS-200 power."""
PROFILE_DB: Final = 8.0
"""Fall of C/N0 from zenith to horizon: gain of a patch antenna; linear in the sine of the elevation."""
PROFILE_ROOM_DB: Final = 8.0
"""How far a receiver's own level may lie from ZENITH_DBHZ; beyond that everything is reflected or jammed."""
CLEAR_SHARE: Final = 0.9
"""The profile is the level below which this share of all measurements lies: reflections weaken, they do not lift."""
PROFILE_DB_PER_S: Final = 0.05
"""Speed of learning with one satellite: several minutes for one decibel at the quantile."""
BEST_DB_PER_S: Final = 0.1
"""Decay of a satellite's recent best C/N0."""
HOLD_S: Final = 4.0
"""Time constant of held peaks: a facade at 15 m/s passes within some seconds."""
MEAN_S: Final = 1.0
"""Time constant of the residual's mean."""
LONGEST_GAP_S: Final = 1.5
"""Changes over a longer gap say nothing; receivers of 1 Hz stay below."""
MOST_CHANGE_M: Final = 10.0
MOST_RATE_MPS: Final = 5.0
"""Held peaks are clipped here, so that one absurd value is forgotten as quickly as any other."""
SLIP_M: Final = 0.5
"""A carrier phase that leaves its Doppler by more between two epochs has slipped; Doppler noise over 1 s is below."""

_T, _SIGNAL, _CODE, _RATE, _CARRIER, _BEST, _CHANGE, _DIVERGENCE, _DOPPLER, _SLIP, _MEAN = range(11)
_KNOWN: Final = 11
_REFUSED, _MISSING = int(Rejection.EPOCH_REFUSED), int(Rejection.NO_PSEUDORANGE)
_EARTH_RATE_RADPS: Final = 7.2921151467e-5


@kernel
def _median(values: Float64s, count: int) -> float:
    return float(np.median(values[:count])) if count > 0 else 0.0


@kernel
def _rate_residual(row: Any, solution: Any) -> float:  # noqa: ANN401 - numba records
    """Range rate less that of satellite and vehicle [m/s]; still with the drift of the receiver's clock."""
    sin_lat, cos_lat = np.sin(solution.lat_rad), np.cos(solution.lat_rad)
    sin_lon, cos_lon = np.sin(solution.lon_rad), np.cos(solution.lon_rad)
    outwards_mps = cos_lat * solution.vu_mps - sin_lat * solution.vn_mps
    vx_mps = row.vx_mps - (cos_lon * outwards_mps - sin_lon * solution.ve_mps)
    vy_mps = row.vy_mps - (sin_lon * outwards_mps + cos_lon * solution.ve_mps)
    vz_mps = row.vz_mps - (sin_lat * solution.vu_mps + cos_lat * solution.vn_mps)
    # Turn of the Earth while the signal travels, for a receiver at sea level: millimetres per second are left.
    radius_m = 6_378_137.0 * cos_lat
    turn_mps = _EARTH_RATE_RADPS / LIGHT_MPS * radius_m * (row.vx_mps * sin_lon - row.vy_mps * cos_lon)
    along_mps = row.line_x * vx_mps + row.line_y * vy_mps + row.line_z * vz_mps
    return float(row.range_rate_mps - (along_mps + turn_mps - row.drift_mps))


@kernel
def _held(hold: float, value: float, most: float, keep: float) -> float:
    """Decayed peak, or the new value where that is higher."""
    return max(hold * keep, min(abs(value), most)) if np.isfinite(value) else hold * keep


@kernel
def _take_changes(
    rows: Records,
    t_s: float,
    solution: Any,  # noqa: ANN401 - numba record
    known: Float64s,
    out: Records,
) -> None:
    """Changes since the epoch before and rate residuals of an epoch, common modes removed."""
    common = np.empty((3, rows.size))
    counts = np.zeros(3, np.int64)
    for i in range(rows.size):
        row, past = rows[i], known[rows[i].satellite]
        age_s = t_s - past[_T]
        if 0.0 < age_s <= LONGEST_GAP_S and past[_SIGNAL] == row.signal:
            moved_m = row.pseudorange_m - past[_CODE]
            out[i].change_m = moved_m - 0.5 * (row.range_rate_mps + past[_RATE]) * age_s
            out[i].divergence_m = moved_m - (row.carrier_m - past[_CARRIER])
        out[i].rate_residual_mps = _rate_residual(row, solution)
        values = (out[i].change_m, out[i].divergence_m, out[i].rate_residual_mps)
        for kind in range(3):
            if np.isfinite(values[kind]):
                common[kind, counts[kind]] = values[kind]
                counts[kind] += 1
    change_m, divergence_m = _median(common[0], counts[0]), _median(common[1], counts[1])
    rate_mps = _median(common[2], counts[2])
    for i in range(rows.size):
        out[i].change_m -= change_m
        out[i].divergence_m -= divergence_m
        out[i].rate_residual_mps -= rate_mps


@kernel
def _take_strength(row: Any, past: Float64s, age_s: float, level: Float64s, found: Any) -> None:  # noqa: ANN401 - numba records
    """C/N0 against the receiver's profile and the satellite's own best; teaches both."""
    if not np.isfinite(row.strength_dbhz):
        return
    best = row.strength_dbhz
    if age_s < np.inf:
        best = max(past[_BEST] - BEST_DB_PER_S * age_s, best)
    past[_BEST] = best
    found.drop_db = best - row.strength_dbhz
    if not np.isfinite(row.elevation_rad):
        return
    reduced = row.strength_dbhz + PROFILE_DB * (1.0 - np.sin(row.elevation_rad))
    found.deficit_db = level[0] - reduced
    step = PROFILE_DB_PER_S * min(age_s, 1.0)
    moved = level[0] + step * (CLEAR_SHARE if reduced > level[0] else CLEAR_SHARE - 1.0)
    level[0] = min(max(moved, ZENITH_DBHZ - PROFILE_ROOM_DB), ZENITH_DBHZ + PROFILE_ROOM_DB)


@kernel
def _remember(
    row: Any,  # noqa: ANN401 - numba record
    t_s: float,
    known: Float64s,
    level: Float64s,
    found: Any,  # noqa: ANN401 - numba records
) -> None:
    """Fold an epoch's figures of one satellite into its holds."""
    past = known[row.satellite]
    age_s = t_s - past[_T]
    if not age_s > 0.0 or past[_SIGNAL] != row.signal:
        age_s = np.inf
        past[_CHANGE], past[_DIVERGENCE], past[_DOPPLER], past[_SLIP], past[_MEAN] = 0.0, 0.0, 0.0, 0.0, np.nan
    keep = np.exp(-age_s / HOLD_S)
    slipped = np.isfinite(row.carrier_m) and (
        int(row.lock_lost) % 2 == 1 or abs(found.change_m - found.divergence_m) > SLIP_M
    )
    past[_CHANGE] = _held(past[_CHANGE], found.change_m, MOST_CHANGE_M, keep)
    past[_DIVERGENCE] = _held(past[_DIVERGENCE], np.nan if slipped else found.divergence_m, MOST_CHANGE_M, keep)
    past[_DOPPLER] = _held(past[_DOPPLER], found.rate_residual_mps, MOST_RATE_MPS, keep)
    past[_SLIP] = 1.0 if slipped else past[_SLIP] * keep
    if np.isfinite(found.residual_m):
        weight = 1.0 - np.exp(-age_s / MEAN_S) if np.isfinite(past[_MEAN]) else 1.0
        past[_MEAN] = found.residual_m if weight == 1.0 else past[_MEAN] + weight * (found.residual_m - past[_MEAN])
    _take_strength(row, past, age_s, level, found)
    found.change_hold_m, found.divergence_hold_m = past[_CHANGE], past[_DIVERGENCE]
    found.rate_hold_mps, found.slip_hold, found.residual_mean_m = past[_DOPPLER], past[_SLIP], past[_MEAN]
    past[_T], past[_SIGNAL], past[_CODE] = t_s, row.signal, row.pseudorange_m
    past[_RATE], past[_CARRIER] = row.range_rate_mps, row.carrier_m


@kernel
def _gather(
    first_row: Ints,
    t_s: Float64s,
    rows: Records,
    residual_m: Float64s,
    solutions: Records,
    known: Float64s,
    level: Float64s,
    out: Records,
) -> None:
    for epoch in range(t_s.size):
        first, last = first_row[epoch], first_row[epoch + 1]
        if last == first or rows[first].rejection == _REFUSED:
            continue
        seen, found = rows[first:last], out[first:last]
        _take_changes(seen, t_s[epoch], solutions[epoch], known, found)
        for i in range(first, last):
            out[i].residual_m = residual_m[i]
            if rows[i].rejection != _MISSING:
                _remember(rows[i], t_s[epoch], known, level, out[i])


class EvidenceGatherer:
    """Gathers the evidence of one receiver, block after block; the division into blocks changes nothing."""

    def __init__(self) -> None:
        """Know no satellite and the nominal profile."""
        self._known = np.full((CODES, _KNOWN), np.nan)
        self._level_dbhz = np.array([ZENITH_DBHZ])

    def gather(
        self,
        first_row: Ints,
        t_s: Float64s,
        rows: Records,
        reference_residual_m: Float64s,
        reference: Records,
    ) -> Records:
        """Evidence (dtype EVIDENCE) of every row (dtype ROW, with directions), in their order.

        `reference_residual_m` and `reference` (dtype SOLUTION): residuals of the rows and solutions
        of the epochs by the best causal method at hand; NaN where it has none.
        """
        out = np.full((len(rows), len(EVIDENCE.names or ())), np.nan).view(EVIDENCE)[:, 0]
        _gather(
            first_row,
            t_s,
            rows,
            np.array(reference_residual_m, np.float64),
            reference,
            self._known,
            self._level_dbhz,
            out,
        )
        return out
