"""How much a pseudorange and a Doppler measurement are trusted: their variances."""

from __future__ import annotations

from typing import Any, Final, Literal

import numpy as np

from services.gnss_receiver.observations import SYSTEMS
from services.numerics.kernel import kernel

Weights = Literal["elevation", "cn0"]

MISSING_CN0_DBHZ: Final = 35.0
"""Stands in where a receiver gives no C/N0: a moderate signal."""
CORRECTED_FLOOR_M: Final = 0.6
"""What reflections at both places leave of a pseudorange under an open sky."""
CORRECTED_CHANNEL_M: Final = 2.0
CORRECTED_GEO_M: Final = 1.0
LAST_OLD_GEO: Final = 5
FIRST_NEW_GEO: Final = 59
"""Numbers of the geostationary satellites of BeiDou (BDS-SIS-ICD-B1I 3.0, table 4-1)."""
LOWEST_SINE: Final = 0.05
"""Sine of 3 degrees: below, the laws are not known to hold."""

_GLONASS, _BEIDOU = SYSTEMS.index("R"), SYSTEMS.index("C")


@kernel
def elevation_variance_m2(elevation_rad: Any) -> Any:  # noqa: ANN401 - float or array alike
    """Variance of a pseudorange [m²] by elevation alone: (0.3 m)² (1 + 1/sin² el).

    The usual law of single-point positioning under an open sky.
    """
    sine = max(np.sin(elevation_rad), LOWEST_SINE)
    return 0.09 * (1.0 + 1.0 / (sine * sine))


@kernel
def cn0_variance_m2(elevation_rad: Any, cn0_dbhz: Any) -> Any:  # noqa: ANN401 - float or array alike
    """Variance of a pseudorange [m²] by carrier-to-noise density S and elevation: (1 m)² 10^((40 - S)/10) / sin³ el.

    The sigma-epsilon law of Hartinger and Brunner 1999, in which the variance falls with the
    signal's power. Among buildings a weak signal is more often a reflected one, and a low one more
    often reflected at the same power: hence the elevation, steeper than the mapping of the air.
    """
    sine = max(np.sin(elevation_rad), LOWEST_SINE)
    density = cn0_dbhz if np.isfinite(cn0_dbhz) else MISSING_CN0_DBHZ
    return 10.0 ** ((40.0 - density) / 10.0) / (sine * sine * sine)


@kernel
def corrected_extra_m2(row: Any) -> Any:  # noqa: ANN401 - numba record
    """Variance [m²] that a correction brings in, and what it cannot take out of some satellites' pseudoranges.

    Reflections of a geostationary satellite stand still and average out at neither place; GLONASS
    channels are delayed differently by receivers of different make, and its code is coarser.
    """
    extra_m2 = row.correction_sigma_m * row.correction_sigma_m + CORRECTED_FLOOR_M * CORRECTED_FLOOR_M
    if row.system == _GLONASS:
        extra_m2 += CORRECTED_CHANNEL_M * CORRECTED_CHANNEL_M
    number = row.satellite % 100
    if row.system == _BEIDOU and (number <= LAST_OLD_GEO or number >= FIRST_NEW_GEO):
        extra_m2 += CORRECTED_GEO_M * CORRECTED_GEO_M
    return extra_m2


@kernel
def corrected_variance_m2(row: Any) -> Any:  # noqa: ANN401 - numba record
    """Variance of a corrected pseudorange [m²]: that of `cn0_variance_m2`, and what the correction leaves.

    The steep law stays: among buildings it stands for reflections, which no correction takes out.
    """
    return cn0_variance_m2(row.elevation_rad, row.strength_dbhz) + corrected_extra_m2(row)


@kernel
def doppler_variance_m2ps2(cn0_dbhz: Any) -> Any:  # noqa: ANN401 - float or array alike
    """Variance of a range rate from Doppler [m²/s²]: 0.25² + 0.25 · 10^(-(S - 35)/10)."""
    density = cn0_dbhz if np.isfinite(cn0_dbhz) else MISSING_CN0_DBHZ
    return 0.0625 + 0.25 * 10.0 ** (-(density - 35.0) / 10.0)
