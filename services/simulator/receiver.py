"""A receiver: from the paths that reach its antenna to what it measures, with loops that remember."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.gnss_correction.atmosphere import L1_HZ, LIGHT_MPS
from services.simulator.correlator import Composite, composite
from services.simulator.paths import DIRECT, Paths
from services.simulator.scenario import Receiver
from services.simulator.sky import Arrivals

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.int64]

CHIP_RATE_HZ = 1.023e6
"""C/A code (IS-GPS-200, 3.2.1.3); Galileo E1's sub-carrier is left out."""
CHIP_M = LIGHT_MPS / CHIP_RATE_HZ
WAVELENGTH_M = LIGHT_MPS / L1_HZ
NOISES = 4
"""Normal draws per satellite and epoch: code, carrier, Doppler, C/N0."""
NONE = -2
"""Stands where no path is tracked."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What is measured of some satellites; row j belongs to satellite `satellite[j]`."""

    satellite: Indices
    pseudorange_m: Floats
    carrier_phase_cycles: Floats
    doppler_hz: Floats
    cn0_dbhz: Floats
    lock_lost: NDArray[np.uint8]
    code_error_m: Floats
    """Share of the receiver and its surroundings in the pseudorange: paths and noise."""


def code_noise_m(cn0_dbhz: Floats, spacing_chips: float, bandwidth_hz: float, integration_s: float) -> Floats:
    """Thermal jitter of a code loop, one standard deviation [m].

    Kaplan and Hegarty 2017, 8.9 (non-coherent early-late power, wide front end): in chips
    sqrt(B s / (2 c) (1 + 2 / ((2 - s) T c))), c being C/N0 as a ratio.
    """
    ratio = 10.0 ** (cn0_dbhz / 10)
    squaring = 1 + 2 / ((2 - spacing_chips) * integration_s * ratio)
    return np.asarray(CHIP_M * np.sqrt(bandwidth_hz * spacing_chips / (2 * ratio) * squaring))


def carrier_noise_cycles(cn0_dbhz: Floats, bandwidth_hz: float, integration_s: float) -> Floats:
    """Thermal jitter of a carrier loop, one standard deviation (Kaplan and Hegarty 2017, 8.9)."""
    ratio = 10.0 ** (cn0_dbhz / 10)
    return np.asarray(np.sqrt(bandwidth_hz / ratio * (1 + 1 / (2 * integration_s * ratio))) / (2 * np.pi))


def doppler_noise_hz(cn0_dbhz: Floats, bandwidth_hz: float, integration_s: float) -> Floats:
    """Thermal jitter of a frequency loop, one standard deviation (Kaplan and Hegarty 2017, 8.9)."""
    ratio = 10.0 ** (cn0_dbhz / 10)
    squaring = 1 + 1 / (integration_s * ratio)
    return np.asarray(np.sqrt(4 * bandwidth_hz / ratio * squaring) / (2 * np.pi * integration_s))


class ReceiverChannels:
    """Tracking channels of one receiver, one per satellite of the constellation."""

    def __init__(self, receiver: Receiver, satellites: int, generator: np.random.Generator) -> None:
        """Draw how strong each satellite is."""
        self._receiver = receiver
        self._power_db = receiver.cn0_satellite_sigma_db * generator.standard_normal(satellites)
        self._present_since_s = np.full(satellites, np.nan)
        self._facade = np.full(satellites, NONE)
        self._rate_hz = np.zeros(satellites)
        self._code_error_m = np.zeros(satellites)
        self._ambiguity = np.zeros(satellites)
        self._started = False

    def visible(self, elevation_rad: Floats) -> Indices:
        """Satellites above the mask."""
        return np.flatnonzero(elevation_rad >= np.deg2rad(self._receiver.elevation_mask_deg))

    def open_cn0_dbhz(self, satellite: Indices, elevation_rad: Floats) -> Floats:
        """C/N0 of satellites with a free view, before noise: antenna gain by elevation, then each one's power.

        Linear in the sine of the elevation between horizon and zenith.
        """
        r = self._receiver
        gain = r.cn0_horizon_dbhz + (r.cn0_zenith_dbhz - r.cn0_horizon_dbhz) * np.sin(elevation_rad)
        return np.asarray(gain + self._power_db[satellite])

    def measure(
        self,
        now_s: float,
        satellite: Indices,
        arrivals: Arrivals,
        paths: Paths,
        clock: tuple[float, float],
        generator: np.random.Generator,
    ) -> Measured:
        """Measure the visible satellites `satellite` (k,), whose paths are the rows of `paths`.

        `clock` is the receiver clock's bias [s] and drift. Every satellite draws its noise whether
        visible or not, so that one satellite's fate does not change another's noise.
        """
        r = self._receiver
        noise = generator.standard_normal((len(self._facade), NOISES))[satellite]
        ambiguity = generator.integers(-1_000_000, 1_000_000, len(self._facade))[satellite]
        # A reflection turns the carrier by half a cycle.
        half = np.where(paths.facade == DIRECT, 0.0, 0.5)
        heard = composite(
            paths.amplitude,
            paths.excess_m / CHIP_M,
            paths.excess_m / WAVELENGTH_M + half,
            paths.excess_rate_mps / WAVELENGTH_M,
            spacing_chips=r.correlator_spacing_chips,
            averaging_s=r.multipath_averaging_s,
        )
        loss_db = 20 * np.log10(np.maximum(heard.amplitude, 1e-6))
        cn0 = self.open_cn0_dbhz(satellite, arrivals.elevation_rad[satellite]) + loss_db
        present = (paths.amplitude > 0).any(axis=1) & (cn0 >= r.tracking_threshold_dbhz)
        facade = np.take_along_axis(paths.facade, paths.amplitude.argmax(axis=1)[:, None], axis=1)[:, 0]
        other = self._facade[satellite] != facade
        # A frequency loop pulls in half the inverse of its integration time (Kaplan and Hegarty 2017, 8.3).
        jumped = np.abs(heard.path_rate_hz - self._rate_hz[satellite]) > 0.5 / r.integration_s
        torn = other & jumped & (self._facade[satellite] != NONE)
        tracked = self._present_long_enough(now_s, satellite, present, torn)
        fresh = tracked & ((self._facade[satellite] == NONE) | torn)
        cut = tracked & other
        self._ambiguity[satellite[cut]] = ambiguity[cut]
        self._follow_code(satellite, heard, cn0, noise[:, 0], fresh)
        self._facade[:] = NONE
        self._facade[satellite[tracked]] = facade[tracked]
        self._rate_hz[satellite] = heard.path_rate_hz
        who = satellite[tracked]
        carrier = heard.carrier_excess_cycles + self._ambiguity[satellite]
        carrier += r.noise_scale * noise[:, 1] * carrier_noise_cycles(cn0, r.carrier_loop_bandwidth_hz, r.integration_s)
        jitter = r.noise_scale * noise[:, 2] * doppler_noise_hz(cn0, r.frequency_loop_bandwidth_hz, r.integration_s)
        bias_s, drift = clock
        rate = (arrivals.rate_mps[who] + LIGHT_MPS * drift) / WAVELENGTH_M
        return Measured(
            satellite=who,
            pseudorange_m=arrivals.code_m[who] + LIGHT_MPS * bias_s + self._code_error_m[who],
            carrier_phase_cycles=(arrivals.carrier_m[who] + LIGHT_MPS * bias_s) / WAVELENGTH_M + carrier[tracked],
            doppler_hz=-rate - heard.carrier_rate_hz[tracked] + jitter[tracked],
            cn0_dbhz=(cn0 + r.noise_scale * r.cn0_noise_db * noise[:, 3])[tracked],
            lock_lost=cut[tracked].astype(np.uint8),
            code_error_m=self._code_error_m[who],
        )

    def _present_long_enough(self, now_s: float, satellite: Indices, present: Bools, torn: Bools) -> Bools:
        """Who has been there, on a path that could be followed, for the reacquisition time.

        Everyone who is there at the very first epoch is tracked at once.
        """
        since = np.full(len(self._facade), np.nan)
        came = self._present_since_s[satellite]
        began_s = now_s if self._started else -np.inf
        since[satellite] = np.where(present, np.where(np.isnan(came) | torn, began_s, came), np.nan)
        self._present_since_s, self._started = since, True
        return np.asarray(present & (now_s - since[satellite] >= self._receiver.reacquisition_s))

    def _follow_code(self, satellite: Indices, heard: Composite, cn0: Floats, normal: Floats, fresh: Bools) -> None:
        """One step of the code loops, aided by the carrier.

        How fast the tracked path grows is followed at once; towards the rest the loop goes with the
        time constant 1 / (4 B). The noise that drives it gives it a jitter of `code_noise_m`.
        """
        r = self._receiver
        target_m = heard.code_error_chips * CHIP_M
        gain = 1 - np.exp(-4 * r.code_loop_bandwidth_hz * r.interval_s)
        sigma = code_noise_m(cn0, r.correlator_spacing_chips, r.code_loop_bandwidth_hz, r.integration_s)
        noise = r.noise_scale * sigma * normal
        aided = self._code_error_m[satellite] + heard.path_rate_hz * WAVELENGTH_M * r.interval_s
        driven = aided + gain * (target_m - aided) + np.sqrt(gain * (2 - gain)) * noise
        self._code_error_m[satellite] = np.where(fresh, target_m + noise, driven)
