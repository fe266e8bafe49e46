"""Loss between a wayside radio and a train: distance, antennas, what stands beside the line."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schemas.line import Surroundings
from services.simulator.radio_settings import RadioSettings

Floats = NDArray[np.float64]

LIGHT_MPS: Final = 299_792_458.0
THERMAL_DBM_HZ: Final = -173.975
"""Thermal noise at 290 K: 10 log10(k T / 1 mW)."""
BEAM_DEG: Final = 70.0
"""Width of an antenna's beam between its half-power points (3GPP TR 36.814, table A.2.1.1-2)."""
SITE_WEAKEST_DB: Final = 20.0
"""Abeam of a site's panels."""
STEP_M: Final = 5.0


def free_space_loss_db(distance_m: ArrayLike, frequency_hz: float) -> Floats:
    """Basic transmission loss in free space (ITU-R P.525): 20 log10(4 π d f / c).

    >>> round(float(free_space_loss_db(1000.0, 2.4e9)), 2)
    100.05
    """
    return np.asarray(20.0 * np.log10(4.0 * np.pi * np.asarray(distance_m, float) * frequency_hz / LIGHT_MPS))


def breakpoint_m(settings: RadioSettings) -> float:
    """Where the ground's reflection begins to cancel: 4 h1 h2 / λ (ITU-R P.1411)."""
    return 4.0 * settings.site_height_m * settings.train_height_m * settings.frequency_hz / LIGHT_MPS


def distance_loss_db(distance_m: Floats, settings: RadioSettings) -> Floats:
    """Loss with distance as the settings have it."""
    loss = free_space_loss_db(distance_m, settings.frequency_hz)
    if settings.loss == "free_space":
        return loss
    return np.asarray(loss + 20.0 * np.log10(np.maximum(distance_m / breakpoint_m(settings), 1.0)))


def antenna_db(along_m: Floats, distance_m: Floats, settings: RadioSettings, *, rises: bool) -> Floats:
    """Both antennas against their best direction, with the train at `along_m` from the site towards rising axis_m.

    Patterns fall with the square of the angle, down to a floor (3GPP TR 36.814): the site's panels look both ways along
    the track, the train's antenna forward.
    """
    if settings.antennas == "isotropic":
        return np.zeros_like(along_m)
    site_deg = np.degrees(np.arccos(np.minimum(np.abs(along_m) / distance_m, 1.0)))
    ahead = -along_m if rises else along_m
    train_deg = np.degrees(np.arccos(np.clip(ahead / distance_m, -1.0, 1.0)))
    site = np.minimum(12.0 * (site_deg / BEAM_DEG) ** 2, SITE_WEAKEST_DB)
    train = np.minimum(12.0 * (train_deg / BEAM_DEG) ** 2, settings.front_back_db)
    return np.asarray(-site - train)


def clutter_db(
    surroundings: tuple[Surroundings, ...], site_axis_m: float, axis_m: Floats, settings: RadioSettings
) -> Floats:
    """What cuttings, woods and tunnels between site and train take."""
    rates = {
        "cutting": settings.cutting_db_per_km,
        "forest": settings.forest_db_per_km,
        "tunnel": settings.tunnel_db_per_km,
    }
    low, high = np.minimum(axis_m, site_axis_m), np.maximum(axis_m, site_axis_m)
    loss = np.zeros_like(axis_m)
    for one in surroundings:
        between_m = np.minimum(high, one.end_axis_m) - np.maximum(low, one.start_axis_m)
        loss += rates.get(one.kind, 0.0) * np.maximum(between_m, 0.0) / 1000.0
    return loss


def noise_dbm(settings: RadioSettings) -> float:
    """Noise in the channel, the receiver's own included.

    >>> round(noise_dbm(RadioSettings(bandwidth_hz=2e6, noise_figure_db=6.0)), 1)
    -105.0
    """
    return float(THERMAL_DBM_HZ + 10.0 * np.log10(settings.bandwidth_hz) + settings.noise_figure_db)
