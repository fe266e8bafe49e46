"""Weather along a line as a function of time and place: the same whenever it is asked for."""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from schemas.radio import Weather
from services.simulator.motion_settings import NotNegative, Part, Positive
from services.simulator.radio_draws import normals, stream, uniforms
from services.simulator.radio_faults import RadioFault

Floats = NDArray[np.float64]

DAY_S: Final = 86_400.0
YEAR_S: Final = 365.2425 * DAY_S
WARMEST_S: Final = 205 * DAY_S
"""Late July, from the beginning of the year 1970 on."""
WARMEST_HOUR_S: Final = 5 * 3600.0
"""Early afternoon at 9 hours east, in UTC."""
SPELL_S: Final = 6 * 3600.0
"""Rain and snow begin and end with these."""
SNOW_BELOW_C: Final = 1.0
SNOWING_C: Final = -2.0
REACH_M: Final = 2500.0
NS: Final = 10**9
SNOW_FAULT_MM_H: Final = 3.0
"""What a weather station says where the fault `radio_snow` is on."""


class WeatherSettings(Part, frozen=True, kw_only=True):
    """A climate."""

    seed: Annotated[int, Meta(ge=0)] = 1
    mean_c: float = 11.0
    season_c: NotNegative = 11.0
    """Of the mean day, up and down from the mean of the year."""
    day_c: NotNegative = 4.0
    spell_c: NotNegative = 3.0
    """Spread from one spell to the next."""
    wet_share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.15
    """Of the time with rain or snow."""
    wet_mm_per_h: Positive = 1.2
    """On average while there is any."""


class WeatherAlong:
    """The weather of a line."""

    def __init__(self, settings: WeatherSettings) -> None:
        """Know the climate."""
        self._settings = settings
        self._warmth = stream(settings.seed, "warmth")
        self._wet = stream(settings.seed, "wet")
        self._amount = stream(settings.seed, "amount")

    def temperature_c(self, t_s: Floats) -> Floats:
        """At Unix times."""
        settings = self._settings
        season = np.cos(2.0 * np.pi * (t_s - WARMEST_S) / YEAR_S)
        day = np.cos(2.0 * np.pi * (t_s - WARMEST_HOUR_S) / DAY_S)
        spell = t_s / SPELL_S
        first = np.floor(spell).astype(np.int64)
        share = spell - first
        unrest = (1.0 - share) * normals(self._warmth, first) + share * normals(self._warmth, first + 1)
        out = settings.mean_c + settings.season_c * season + settings.day_c * day + settings.spell_c * unrest
        return np.asarray(out)

    def wet_mm_per_h(self, t_s: Floats) -> Floats:
        """Rain, or snow as water."""
        spell = np.floor(t_s / SPELL_S).astype(np.int64)
        wet = uniforms(self._wet, spell) < self._settings.wet_share
        amount = -self._settings.wet_mm_per_h * np.log1p(-uniforms(self._amount, spell))
        return np.where(wet, amount, 0.0)

    def snow_mm_per_h(self, t_s: Floats) -> Floats:
        """Snow as water."""
        return np.where(self.temperature_c(t_s) < SNOW_BELOW_C, self.wet_mm_per_h(t_s), 0.0)

    def message(self, t_ns: int, axis_m: float, faults: tuple[RadioFault, ...] = ()) -> Weather:
        """What a station at a place says; where snow lies on the antennas (`radio_snow`) it snows."""
        t_s = np.array([t_ns / NS])
        temperature_c, wet = float(self.temperature_c(t_s)[0]), float(self.wet_mm_per_h(t_s)[0])
        snow = wet if temperature_c < SNOW_BELOW_C else 0.0
        rain = wet - snow
        if any(one.kind == "radio_snow" and one.on(t_s)[0] and bool(one.inside(axis_m)) for one in faults):
            temperature_c, rain, snow = min(temperature_c, SNOWING_C), 0.0, max(snow, SNOW_FAULT_MM_H)
        return Weather(
            t_ns=t_ns,
            axis_m=axis_m,
            reach_m=REACH_M,
            temperature_c=round(temperature_c, 1),
            rain_mm_per_h=round(rain, 2),
            snow_mm_per_h=round(snow, 2),
        )


def stations(length_m: float) -> list[float]:
    """Places of the weather stations of a line, each with what lies up to REACH_M away from it."""
    count = max(round(length_m / (2.0 * REACH_M)), 1)
    return [float(round((k + 0.5) * length_m / count)) for k in range(count)]
