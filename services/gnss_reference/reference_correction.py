"""Corrections of pseudoranges from the observations of a receiver whose place is known.

    correction_i = |x_i - x| + Sagnac - c dt_i + c dt_k - P_i

with the satellite's place x_i and clock dt_i by the broadcast ephemeris, the station's place x and its
clock dt_k for each constellation k: the median, beyond the models of the air, of the satellites that
agree (RTCM 10402.3, message 1, has one clock for all). The models serve to find the clock and what
contradicts it; the correction itself holds the air above the station whole. Its rate comes from the
carrier phase (correction_rates.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Final

import msgspec
import numpy as np
from msgspec import Meta

from schemas.gnss import (
    Corrections,
    Ephemeris,
    Ionosphere,
    SatelliteCorrection,
    SatelliteRefusal,
    SignalDifference,
)
from schemas.gnss_time import WEEK_S, unix_ns_from_gps
from services.gnss_correction.carrier_smoothing import CarrierSmoother
from services.gnss_correction.ephemeris_store import EphemerisStore
from services.gnss_correction.ephemeris_table import CODES, EphemerisTable
from services.gnss_correction.epoch_order import EpochOrder
from services.gnss_correction.other_signals import Differences, SignalAverages, centred, signal_differences
from services.gnss_correction.preparation import SignalStrengths, prepare
from services.gnss_correction.rejection import REJECTION_WORDS, Rejection
from services.gnss_correction.solver_arrays import RULES, Float64s, Records
from services.gnss_correction.station_consistency import LARGEST_RESIDUAL, displaced, fit_station
from services.gnss_correction.station_sight import lines_enu, see_from, station_at
from services.gnss_receiver.observations import Observations, satellite_name
from services.gnss_reference.correction_rates import CorrectionRates
from services.gnss_reference.ephemeris_turns import EphemerisTurns

NOISE_M: Final = 0.3
"""Code noise and short reflections of a satellite overhead at 45 dB-Hz under an open sky, one sigma."""
SMALLEST_SIGMA_M: Final = 0.05
"""Of a correction, however long it was smoothed: what reflections leave."""
FEWEST_OF_SYSTEM: Final = 2
_USABLE = int(Rejection.USABLE)


class StationSettings(msgspec.Struct, frozen=True, kw_only=True):
    """How corrections are made."""

    systems: Annotated[str, Meta(pattern="^[GRECJ]{1,5}$")] = "GRECJ"
    """Constellations: G GPS, R GLONASS, E Galileo, C BeiDou, J QZSS."""
    elevation_mask_deg: Annotated[float, Meta(ge=0.0, le=90.0)] = 5.0
    """Lower satellites get no correction."""
    smooth_s: Annotated[float, Meta(ge=0.0, le=3_600.0)] = 100.0
    """Time constant with which the station's pseudoranges are smoothed by the carrier; 0 does not smooth."""


class ReferenceStation:
    """Turns the epochs of a receiver at a known place into corrections, in the order in which they come."""

    def __init__(
        self,
        name: str,
        position_deg: tuple[float, float, float],
        settings: StationSettings,
        *,
        in_turns: bool = False,
    ) -> None:
        """Stand at `position_deg`: latitude, longitude [deg], ellipsoidal height [m] (WGS 84).

        With `in_turns`, for live listeners, satellites that have two ephemerides in use are corrected for both of them
        in turns (ephemeris_turns.py); blocks are then single epochs.
        """
        self._name, self._position_deg, self._settings = name, position_deg, settings
        self._station = station_at(*position_deg)
        self._store, self._order = EphemerisStore(), EpochOrder()
        self._strengths = SignalStrengths(1.0)
        self._smoother = CarrierSmoother(settings.smooth_s) if settings.smooth_s > 0.0 else None
        self._smoothed_since_s = np.full(CODES, np.nan)
        self._rates = CorrectionRates()
        self._signals = SignalAverages(settings.smooth_s)
        self._rules = np.zeros(1, RULES)
        self._turns = EphemerisTurns(self._station, settings.systems) if in_turns else None
        self._latest_s = -math.inf

    def add(self, broadcast: Ephemeris | Ionosphere) -> None:
        """Take in what a satellite broadcast."""
        if isinstance(broadcast, Ephemeris):
            self._store.add(broadcast)
            if self._turns is not None:
                self._turns.add(broadcast, self._latest_s)
        else:
            self._rules["alpha"], self._rules["beta"] = broadcast.alpha, broadcast.beta

    def block(self, observations: Observations) -> Iterator[Corrections]:
        """Corrections of every epoch that follows the one before; repeated and late epochs give none."""
        times = zip(observations.gps_week.tolist(), observations.tow_s.tolist(), strict=True)
        refused = np.array([bool(self._order.refusal(week, tow_s)) for week, tow_s in times], bool)
        table = self._store.table()
        prepared = prepare(observations, refused, table, self._settings.systems, self._strengths)
        for epoch in np.flatnonzero(~refused).tolist():
            rows = prepared.rows[prepared.first_row[epoch] : prepared.first_row[epoch + 1]]
            t_s = float(prepared.t_s[epoch])
            smoothed_s = self._smooth(rows, t_s)
            others = self._signals.take(t_s, centred(signal_differences(observations, epoch, rows)))
            corrections = self._correct(rows, t_s, smoothed_s, observations.signals, table, others)
            self._latest_s = corrections.gps_week * WEEK_S + corrections.tow_s
            yield corrections if self._turns is None else self._turns.spoken(corrections, observations)

    def _smooth(self, rows: Records, t_s: float) -> Float64s:
        """Smooth the pseudoranges of one epoch; gives over what time each has been smoothed."""
        if self._smoother is None:
            return np.zeros(rows.size)
        raw_m = rows["pseudorange_m"].copy()
        self._smoother.smooth(np.array([0, rows.size], np.int64), np.array([t_s]), rows)
        codes = rows["satellite"]
        # The first pseudorange after a slip is left as it is.
        self._smoothed_since_s[codes[rows["pseudorange_m"] == raw_m]] = t_s
        return np.asarray(np.minimum(t_s - self._smoothed_since_s[codes], self._settings.smooth_s))

    def _correct(
        self,
        rows: Records,
        t_s: float,
        smoothed_s: Float64s,
        signals: tuple[str, ...],
        table: EphemerisTable,
        others: Differences,
    ) -> Corrections:
        """Corrections of one epoch."""
        refused = {
            int(code): REJECTION_WORDS[Rejection(int(rejection))]
            for code, rejection in zip(rows["satellite"], rows["rejection"], strict=True)
            if rejection != _USABLE
        }
        usable = rows["rejection"] == _USABLE
        rows, smoothed_s = rows[usable], smoothed_s[usable]
        air_m = see_from(self._station, rows, t_s, self._rules[0])
        high = rows["elevation_rad"] >= np.radians(self._settings.elevation_mask_deg)
        refused |= {int(code): "below the elevation mask" for code in rows["satellite"][~high]}
        rows, air_m, smoothed_s = rows[high], air_m[high], smoothed_s[high]
        rates_mps = self._rates.take(t_s, rows, table.rows["toe_s"][rows["ephemeris"]])
        difference_m = rows["pseudorange_m"] - rows["modelled_m"] - air_m
        said, clock_m = self._screen(rows, difference_m)
        refused |= {int(code): words for code, words in zip(rows["satellite"], said, strict=True) if words}
        correction_m = rows["modelled_m"] - rows["pseudorange_m"] + clock_m
        sigma_m = _sigma_m(rows, smoothed_s)
        satellites = tuple(
            SatelliteCorrection(
                satellite=satellite_name(int(rows["satellite"][i])),
                signal=signals[int(rows["signal"][i])],
                issue=int(table.rows["issue"][rows["ephemeris"][i]]),
                toe_week=table.gps_week + int(table.rows["toe_s"][rows["ephemeris"][i]] // WEEK_S),
                toe_s=float(table.rows["toe_s"][rows["ephemeris"][i]] % WEEK_S),
                correction_m=float(correction_m[i]),
                rate_mps=float(rates_mps[i]),
                sigma_m=float(sigma_m[i]),
                elevation_rad=float(rows["elevation_rad"][i]),
                smoothed_s=float(smoothed_s[i]),
                others=_of(others, int(rows["satellite"][i])),
            )
            for i in range(rows.size)
            if not said[i]
        )
        return self._message(t_s + table.gps_week * WEEK_S, satellites, refused)

    def _screen(self, rows: Records, difference_m: Float64s) -> tuple[list[str], Float64s]:
        """What is wrong with each row (empty for nothing), and the station's clock for it."""
        said = [""] * rows.size
        clock_m = np.zeros(rows.size)
        if not rows.size:
            return said, clock_m
        fit = fit_station(lines_enu(self._station, rows), rows["system"], rows["elevation_rad"], difference_m)
        off = displaced(fit)
        if off or not np.isfinite(fit.east_north_up_m).all():
            return [off or "too few satellites to check the station"] * rows.size, clock_m
        for i in np.flatnonzero(np.abs(fit.residual_m) > LARGEST_RESIDUAL * fit.sigma_m).tolist():
            said[i] = f"contradicts the other satellites by {abs(fit.residual_m[i]):.0f} m"
        good = np.array([not words for words in said])
        for system in np.unique(rows["system"]):
            own = (rows["system"] == system) & good
            if own.sum() < FEWEST_OF_SYSTEM:
                for i in np.flatnonzero(own).tolist():
                    said[i] = REJECTION_WORDS[Rejection.ALONE_IN_SYSTEM]
                continue
            clock_m[rows["system"] == system] = np.median(difference_m[own])
        return said, clock_m

    def _message(
        self, gps_s: float, satellites: tuple[SatelliteCorrection, ...], refused: dict[int, str]
    ) -> Corrections:
        week, tow_s = divmod(gps_s, WEEK_S)
        lat_deg, lon_deg, h_m = self._position_deg
        return Corrections(
            t_ns=unix_ns_from_gps(int(week), tow_s),
            station=self._name,
            gps_week=int(week),
            tow_s=tow_s,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            h_m=h_m,
            satellites=satellites,
            refused=tuple(
                SatelliteRefusal(satellite=satellite_name(code), reason=words)
                for code, words in sorted(refused.items())
            ),
        )


def _of(others: Differences, code: int) -> tuple[SignalDifference, ...]:
    """What the further signals of one satellite are to be corrected by besides."""
    own = sorted((signal, value_m) for (one, signal), value_m in others.items() if one == code)
    return tuple(SignalDifference(signal=signal, difference_m=-value_m) for signal, value_m in own)


def _sigma_m(rows: Records, smoothed_s: Float64s) -> Float64s:
    """Standard deviations of corrections: code noise by C/N0 and elevation, less what smoothing took out of it."""
    strength_dbhz = np.where(np.isfinite(rows["strength_dbhz"]), rows["strength_dbhz"], 35.0)
    noise_m = NOISE_M * 10.0 ** ((45.0 - strength_dbhz) / 20.0) / np.maximum(np.sin(rows["elevation_rad"]), 0.1)
    # A Hatch filter over T averages 2 T independent pseudoranges of 1 Hz (Hatch 1982).
    return np.asarray(np.maximum(noise_m / np.sqrt(1.0 + 2.0 * smoothed_s), SMALLEST_SIGMA_M))
