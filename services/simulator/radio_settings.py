"""Settings of the simulated radios of a line: a table of a scenario. The defaults are the harder of its two worlds."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from services.simulator.motion_settings import NotNegative, Part, Positive

Decibels = Annotated[float, Meta(ge=0.0, le=60.0)]


class RadioSettings(Part, frozen=True, kw_only=True):
    """What the radios are, and what lies between them. Shadows belong to the line and `seed`: every pass meets them."""

    seed: Annotated[int, Meta(ge=0)] = 1
    frequency_hz: Annotated[float, Meta(ge=50e6, le=80e9)] = 2.4e9
    bandwidth_hz: Positive = 2e6
    noise_figure_db: Decibels = 6.0
    tx_power_dbm: float = 20.0
    site_gain_dbi: float = 6.0
    train_gain_dbi: float = 2.0
    site_height_m: Positive = 8.0
    train_height_m: Positive = 4.0
    reach_m: Positive = 2500.0
    """A train reports the radios that are so near."""
    period_s: Annotated[float, Meta(ge=0.1, le=60.0)] = 0.5
    """Of the measurements."""
    frames: Annotated[int, Meta(ge=1, le=1000)] = 10
    """Expected of every radio in a period."""
    frame_bits: Annotated[int, Meta(ge=8, le=100_000)] = 1024
    correctable_bits: Annotated[int, Meta(ge=0, le=10_000)] = 24
    """Of a frame, by its error-correcting code."""
    loss: Literal["free_space", "two_slopes"] = "two_slopes"
    """`two_slopes`: falls with the fourth power of distance beyond the breakpoint (ITU-R P.1411, line of sight)."""
    antennas: Literal["isotropic", "panels"] = "panels"
    """`panels`: back to back along the track at a site; one that looks forward on the train."""
    front_back_db: Decibels = 8.0
    """Of the train's antenna."""
    shadowing_db: Decibels = 5.0
    shadowing_m: Positive = 75.0
    """Distance over which shadows of one place and another are alike by 1/e (Gudmundson 1991)."""
    direction_db: Decibels = 1.5
    """Share of the shadows that differs with the direction of travel."""
    pass_db: Decibels = 1.0
    """That differs from pass to pass, alike over about 100 m."""
    daily_db: Decibels = 1.0
    """The same over the whole line for a day."""
    season_db: Decibels = 1.5
    """Leaves in summer take up to so much, where there are any."""
    fading: Literal["rice", "none"] = "rice"
    rician_k_db: Annotated[float, Meta(ge=-60.0, le=60.0)] = 6.0
    """Power of the steady over that of the scattered part."""
    cutting_db_per_km: NotNegative = 3.0
    forest_db_per_km: NotNegative = 6.0
    tunnel_db_per_km: NotNegative = 12.0
    """What such surroundings between train and site take besides."""
    reading_db: Decibels = 0.5
    """Spread of a power reading, by the device."""
    samples: Annotated[int, Meta(ge=1)] = 200
    """Independent samples of signal and noise in a power reading."""
    decoded_power: Literal["above_noise", "total"] = "above_noise"
    """How the device finds the power of decoded frames: from their ratio to the noise it hears, which it takes for its
    usual noise (so interference lowers it, as in the ORBIT recordings), or as what came in with them."""
    crystal_ppm: NotNegative = 0.5
    """Spread of the radios' oscillators."""
    self_heating_c: NotNegative = 12.0
    snow_db_per_mm_h: Decibels = 0.5
    """Snow on the antennas while it snows."""
