"""How far pseudoranges and Dopplers among buildings may be off, and how much a deviation still counts.

Among buildings a signal is weak because its direct path is blocked or because reflections cancel
it: what is left of it is late. The loss against the strongest signals at the same receiver is
therefore the best single witness (Groves and Jiang 2013 rank signals by it too), better than the
elevation. The standard deviation doubles every HALVING_DB of loss; on receivers whose strongest
signals are weaker than usual the law shifts with them, so that a phone is not disbelieved as a
whole.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from services.gnss_correction.weighting import corrected_extra_m2
from services.gnss_receiver.observations import SYSTEMS
from services.numerics.kernel import inner_kernel, kernel

USUAL_STRONGEST_DBHZ: Final = 51.0
"""C/N0 of an unobstructed satellite high in the sky (IS-GPS-200, 3.3.1.6, by an antenna of 3 dB)."""
WEAKEST_REFERENCE_DBHZ: Final = 38.0
"""Below, even the strongest signals are reflected or attenuated, and nobody is believed for being the strongest."""
REFERENCE_LOSS_DB: Final = 9.0
"""Loss at which the laws have their reference values: that of a satellite at 15 degrees in the open."""
HALVING_DB: Final = 2.2
MOST_LOSS_DB: Final = 25.0
"""Weaker signals are believed no less; their deviations are hundreds of metres already."""
CODE_FLOOR_M: Final = 1.8
CODE_REFERENCE_M: Final = 4.0
CORRECTED_REFERENCE_M: Final = 2.0
CORRECTED_HALVING_DB: Final = 3.0
"""The same for corrected pseudoranges: what the air adds is gone, and who corrects wants the noise averaged over many
satellites rather than the two or three strongest; but not as flat as white noise (6 dB)."""
DOPPLER_FLOOR_MPS: Final = 0.05
DOPPLER_REFERENCE_MPS: Final = 0.2
SLOW_SHARE: Final = 0.3
"""Of the variance of a pseudorange, the share that grows with the slant of the path, 1/sin el."""
INTER_CHANNEL_M: Final = 4.0
"""GLONASS sends every satellite on a channel of its own, and receivers delay each differently by some metres
(Wanninger 2012)."""
LOWEST_SINE: Final = 0.1
FREEDOM: Final = 4.0
"""Degrees of freedom of Student's t by which deviations are weighed: tails far heavier than Gaussian."""
HUBER: Final = 1.5
"""Normalised residual from which on the convex cost grows linearly (Huber 1964)."""

_GLONASS = SYSTEMS.index("R")
_LOSS_UNKNOWN_DB: Final = 13.0


@inner_kernel
def _loss_db(strength_dbhz: float, strongest_dbhz: float) -> float:
    """Loss of a signal against the strongest ones."""
    reference_dbhz = min(max(strongest_dbhz, WEAKEST_REFERENCE_DBHZ), USUAL_STRONGEST_DBHZ)
    loss_db = reference_dbhz - strength_dbhz if np.isfinite(strength_dbhz) else _LOSS_UNKNOWN_DB
    return float(min(loss_db, MOST_LOSS_DB))


@inner_kernel
def _doublings(strength_dbhz: float, strongest_dbhz: float) -> float:
    """Factor of a standard deviation by the loss of a signal; 1 at the reference loss."""
    return float(2.0 ** ((_loss_db(strength_dbhz, strongest_dbhz) - REFERENCE_LOSS_DB) / HALVING_DB))


@kernel
def urban_code_variance_m2(row: Any, strongest_dbhz: float) -> float:  # noqa: ANN401 - numba record
    """Variance of a pseudorange [m²]."""
    if row.correction_sigma_m > 0.0:
        # What the floor and the slant allow for the air is gone; what reflections do is not.
        loss_db = _loss_db(row.strength_dbhz, strongest_dbhz)
        sigma_m = CORRECTED_REFERENCE_M * 2.0 ** ((loss_db - REFERENCE_LOSS_DB) / CORRECTED_HALVING_DB)
        return float(sigma_m * sigma_m + corrected_extra_m2(row))
    sigma_m = CODE_FLOOR_M + CODE_REFERENCE_M * _doublings(row.strength_dbhz, strongest_dbhz)
    sine = max(np.sin(row.elevation_rad), LOWEST_SINE)
    channel_m = INTER_CHANNEL_M if row.system == _GLONASS else 0.0
    return float(sigma_m * sigma_m * (1.0 + SLOW_SHARE * (1.0 / sine - 1.0)) + channel_m * channel_m)


@kernel
def urban_doppler_variance_m2ps2(strength_dbhz: float, strongest_dbhz: float) -> float:
    """Variance of a range rate [m²/s²]."""
    sigma_mps = DOPPLER_FLOOR_MPS + DOPPLER_REFERENCE_MPS * _doublings(strength_dbhz, strongest_dbhz)
    return float(sigma_mps * sigma_mps)


@kernel
def measurement_weight(square: float, robust: bool) -> float:  # noqa: FBT001 - kernels take no keywords
    """Weight of a measurement by its squared normalised residual z².

    Robust: (ν + 1)/(ν + z²), Student's t (Lange et al. 1989); else min(1, HUBER/|z|) (Huber 1964).
    """
    if robust:
        return (FREEDOM + 1.0) / (FREEDOM + square)
    return float(min(1.0, HUBER / np.sqrt(max(square, 1e-12))))
