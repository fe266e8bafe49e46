"""Delays of ionosphere and troposphere by the models that need no outside correction.

Angles in radians, delays in metres. The formulas take floats or arrays alike (and are
compiled as they stand by the kernels). Below the horizon, and at heights where no antenna
of a train can be, a delay is zero.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

LIGHT_MPS: Final = 299_792_458.0
"""Speed of light (IS-GPS-200, 20.3.4.3)."""
L1_HZ: Final = 1_575.42e6
LOWEST_HEIGHT_M: Final = -1_000.0
HIGHEST_HEIGHT_M: Final = 10_000.0
"""The standard atmosphere below the tropopause holds between these heights."""
RELATIVE_HUMIDITY: Final = 0.5


def klobuchar_delay_m(
    alpha: Any,  # noqa: ANN401 - tuple or array of four
    beta: Any,  # noqa: ANN401 - tuple or array of four
    lat_rad: Any,  # noqa: ANN401 - float or array alike
    lon_rad: Any,  # noqa: ANN401 - float or array alike
    elevation_rad: Any,  # noqa: ANN401 - float or array alike
    azimuth_rad: Any,  # noqa: ANN401 - float or array alike
    tow_s: Any,  # noqa: ANN401 - float or array alike
    carrier_hz: Any,  # noqa: ANN401 - float or array alike
) -> Any:  # noqa: ANN401 - float or array alike
    """Ionospheric delay of the pseudorange [m] on a carrier [Hz], zero below the horizon.

    IS-GPS-200 figure 20-4: coefficients `alpha`, `beta` as broadcast (semicircles), GPS
    time of week. The delay goes with the inverse square of the carrier frequency.
    """
    above = elevation_rad > 0.0
    elevation_sc = np.maximum(elevation_rad, 0.0) / np.pi
    centre_sc = 0.0137 / (elevation_sc + 0.11) - 0.022
    pierce_lat_sc = lat_rad / np.pi + centre_sc * np.cos(azimuth_rad)
    pierce_lat_sc = np.minimum(np.maximum(pierce_lat_sc, -0.416), 0.416)
    pierce_lon_sc = lon_rad / np.pi + centre_sc * np.sin(azimuth_rad) / np.cos(pierce_lat_sc * np.pi)
    phi = pierce_lat_sc + 0.064 * np.cos((pierce_lon_sc - 1.617) * np.pi)
    local_s = (43_200.0 * pierce_lon_sc + tow_s) % 86_400.0
    amplitude_s = np.maximum(alpha[0] + phi * (alpha[1] + phi * (alpha[2] + phi * alpha[3])), 0.0)
    period_s = np.maximum(beta[0] + phi * (beta[1] + phi * (beta[2] + phi * beta[3])), 72_000.0)
    x = 2.0 * np.pi * (local_s - 50_400.0) / period_s
    bell = (np.abs(x) < 1.57) * (1.0 - x * x / 2.0 + x**4 / 24.0)  # noqa: PLR2004 - the limit as the standard gives it
    slant = 1.0 + 16.0 * (0.53 - elevation_sc) ** 3
    return above * slant * (5e-9 + amplitude_s * bell) * LIGHT_MPS * (L1_HZ / carrier_hz) ** 2


def saastamoinen_delay_m(lat_rad: Any, h_m: Any, elevation_rad: Any) -> Any:  # noqa: ANN401 - float or array alike
    """Tropospheric delay of the pseudorange [m]; zero below the horizon or at absurd heights.

    Zenith delay after Saastamoinen 1972 (gravity term after Davis et al. 1985) in the ICAO
    standard atmosphere with half-saturated air, mapped down by Black and Eisner 1984 (as in
    RTCA DO-229, A.4.2.4), which stays finite at the horizon. `h_m` stands for the height
    above the sea; the geoid's 100 m change the delay by one per cent.
    """
    holds = (elevation_rad > 0.0) * (h_m > LOWEST_HEIGHT_M) * (h_m < HIGHEST_HEIGHT_M)
    height_m = np.minimum(np.maximum(h_m, LOWEST_HEIGHT_M), HIGHEST_HEIGHT_M)
    pressure_hpa = 1_013.25 * (1.0 - 2.2557e-5 * height_m) ** 5.2568
    temperature_k = 288.15 - 6.5e-3 * height_m
    vapour_hpa = 6.108 * RELATIVE_HUMIDITY * np.exp((17.15 * temperature_k - 4_684.0) / (temperature_k - 38.45))
    gravity = 1.0 - 0.00266 * np.cos(2.0 * lat_rad) - 0.00028e-3 * height_m
    dry_m = 0.0022768 * pressure_hpa / gravity
    wet_m = 0.002277 * (1_255.0 / temperature_k + 0.05) * vapour_hpa
    sine = np.sin(np.maximum(elevation_rad, 0.0))
    return holds * (dry_m + wet_m) * 1.001 / np.sqrt(0.002001 + sine * sine)
