"""Radios along a line, and what a train's device measures of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from schemas.line import RadioSite, Surroundings
from services.simulator.radio_device import Incoming, Reading, read_power
from services.simulator.radio_draws import normals, stream
from services.simulator.radio_faults import DAY_S, RadioFault, loss_db, silent
from services.simulator.radio_link import FrameCode, frame_code
from services.simulator.radio_propagation import STEP_M, antenna_db, clutter_db, distance_loss_db, noise_dbm
from services.simulator.radio_settings import RadioSettings
from services.simulator.radio_shadowing import passing, shadow
from services.simulator.weather_along import WARMEST_S, YEAR_S, WeatherAlong

Floats = NDArray[np.float64]

INTERFERER_ASIDE_M: Final = 30.0
DEEPEST_SNOW_DB: Final = 6.0


@dataclass(frozen=True, slots=True)
class RadioLine:
    """Where the radios stand."""

    length_m: float
    sites: tuple[RadioSite, ...]
    surroundings: tuple[Surroundings, ...] = ()


class Link(NamedTuple):
    """One radio on one of its channels."""

    site: int
    channel: str


@dataclass(frozen=True, slots=True, eq=False)
class Journey:
    """Where a train is at the ends of measuring periods; all of shape (n,), in one direction."""

    number: int
    """Of the pass: what differs from pass to pass belongs to it."""
    rises: bool
    t_s: Floats
    """Unix time."""
    axis_m: Floats
    speed_mps: Floats

    def part(self, rows: NDArray[np.intp]) -> Journey:
        """Some of the rows."""
        return Journey(self.number, self.rises, self.t_s[rows], self.axis_m[rows], self.speed_mps[rows])


class RadioWorld:
    """The radios of one line, with the shadows that belong to it."""

    def __init__(self, line: RadioLine, settings: RadioSettings, weather: WeatherAlong) -> None:
        """Lay out shadows along the line for every radio and both directions."""
        self.line, self.settings, self.weather = line, settings, weather
        self.code: FrameCode = frame_code(settings.frame_bits, settings.correctable_bits)
        self.noise_mw = 10.0 ** (noise_dbm(settings) / 10.0)
        self.links = tuple(Link(i, name) for i, one in enumerate(line.sites) for name in one.channels or ("1",))
        self._places = np.arange(0.0, line.length_m + STEP_M, STEP_M)
        self._means = {
            (i, rises): self._mean_dbm(i, rises=rises) for i in range(len(line.sites)) for rises in (True, False)
        }
        self._daily = stream(settings.seed, "daily")

    def measure(self, journey: Journey, faults: tuple[RadioFault, ...] = ()) -> Iterator[tuple[Link, Reading]]:
        """What the device says of every radio within reach, radio by radio; nothing of it while it is dead."""
        awake = ~silent(faults, journey.t_s)
        for link in self.links:
            site = self.line.sites[link.site]
            near = np.abs(journey.axis_m - site.axis_m) <= self.settings.reach_m
            rows = np.flatnonzero(near & awake)
            if len(rows):
                part = journey.part(rows)
                yield link, read_power(self._incoming(link, part, faults), part, rows, self.settings, self.code)

    def _mean_dbm(self, number: int, *, rises: bool) -> Floats:
        """Power of a site at the places of the grid, without all that changes."""
        settings, site = self.settings, self.line.sites[number]
        along_m = self._places - site.axis_m
        height_m = settings.site_height_m - settings.train_height_m
        distance_m = np.sqrt(along_m**2 + site.aside_m**2 + height_m**2)
        distance_m = np.maximum(distance_m, 1.0)
        strongest = settings.tx_power_dbm + settings.site_gain_dbi + settings.train_gain_dbi
        out = (
            strongest + antenna_db(along_m, distance_m, settings, rises=rises) - distance_loss_db(distance_m, settings)
        )
        out = out - clutter_db(self.line.surroundings, site.axis_m, self._places, settings)
        common = self._shadow(site.id, "shadow") * settings.shadowing_db
        own = self._shadow(site.id, "up" if rises else "down") * settings.direction_db
        return np.asarray(out + common + own)

    def _shadow(self, radio: str, what: str) -> Floats:
        of = stream(self.settings.seed, radio, what)
        return shadow(of, len(self._places), STEP_M, self.settings.shadowing_m)

    def _power_dbm(self, link: Link, journey: Journey, faults: tuple[RadioFault, ...]) -> Floats:
        """Power of a site as it comes in, before fast fading."""
        settings, site = self.settings, self.line.sites[link.site]
        mean = np.interp(journey.axis_m, self._places, self._means[link.site, journey.rises])
        day = np.floor(journey.t_s / DAY_S).astype(np.int64)
        changing = settings.daily_db * normals(self._daily, day)
        of_pass = stream(settings.seed, site.id, "pass", journey.number)
        changing = changing + settings.pass_db * passing(of_pass, journey.axis_m)
        summer = 0.5 * (1.0 + np.cos(2.0 * np.pi * (journey.t_s - WARMEST_S) / YEAR_S))
        leaves = np.clip(passing(stream(settings.seed, site.id, "leaves"), journey.axis_m), 0.0, 1.0)
        snow = settings.snow_db_per_mm_h * self.weather.snow_mm_per_h(journey.t_s)
        taken = settings.season_db * summer * leaves + np.minimum(snow, DEEPEST_SNOW_DB)
        taken = taken + loss_db(faults, site, link.channel, journey.t_s, journey.axis_m)
        return np.asarray(mean + changing - taken)

    def _incoming(self, link: Link, journey: Journey, faults: tuple[RadioFault, ...]) -> Incoming:
        """Signal, and what disturbs it: noise, other sites on the channel, interferers."""
        site = self.line.sites[link.site]
        other_mw = np.full(len(journey.t_s), self.noise_mw)
        for another in self.links:
            if another.channel == link.channel and another.site != link.site:
                other_mw += 10.0 ** (self._power_dbm(another, journey, faults) / 10.0)
        for fault in faults:
            if fault.kind == "radio_interference" and fault.where.channel in ("", link.channel):
                other_mw += self._interferer_mw(fault, journey)
        signal = self._power_dbm(link, journey, faults)
        ambient_c = self.weather.temperature_c(journey.t_s)
        ageing = tuple(one for one in faults if one.kind == "radio_degradation")
        weaker_db = loss_db(ageing, site, link.channel, journey.t_s, journey.axis_m)
        return Incoming(site, link.channel, 10.0 ** (signal / 10.0), other_mw, self.noise_mw, ambient_c, weaker_db)

    def _interferer_mw(self, fault: RadioFault, journey: Journey) -> Floats:
        """A sender of `magnitude` dBm (EIRP) that stands beside the track."""
        settings = self.settings
        place_m = fault.place_m(self.line.length_m)
        distance_m = np.hypot(journey.axis_m - place_m, INTERFERER_ASIDE_M)
        shaded = np.interp(journey.axis_m, self._places, self._shadow(f"interferer {place_m:.0f}", "shadow"))
        dbm = fault.magnitude + settings.train_gain_dbi - distance_loss_db(distance_m, settings)
        dbm = dbm + settings.shadowing_db * shaded
        return np.where(fault.on(journey.t_s), 10.0 ** (dbm / 10.0), 0.0)
