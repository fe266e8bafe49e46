"""A vehicle for the demo line and for trials before a vehicle file is there: a stopping train, wholly assumed."""

from __future__ import annotations

import tomllib
from typing import Final

import msgspec

from services.run_history.vehicle import Vehicle

DEMO: Final = "demo"
"""Name that stands for it where a vehicle file is asked for."""
DEMO_TOML: Final = """\
# A stopping train of four cars; every value is assumed. Replace what you know and name its source.
name = "Demo EMU"
series = "demo"
formation = "2M2T"
drive = "vvvf"
mass_t = 132.0
load_t = 36.0
load_factor = 0.3
rotating_mass_share = 0.06
length_m = 80.0
cars = 4
resistance = "jis_emu"
max_tractive_kn = 130.0
max_power_kw = 1600.0
max_acceleration_mps2 = 0.9
service_brake_mps2 = 0.8
max_speed_mps = 30.0
"""


def demo_vehicle() -> Vehicle:
    """The vehicle of the text above."""
    return msgspec.convert(tomllib.loads(DEMO_TOML), Vehicle)
