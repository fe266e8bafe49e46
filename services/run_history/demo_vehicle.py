"""The simulator's train as a vehicle file, for the demo line and for trials before a vehicle file is there.

What the simulator states over mass is taken times a mass that is assumed. Its efforts move the running mass alone, so
nothing rotates; efficiency, regeneration and auxiliaries are assumed.
"""

from __future__ import annotations

import tomllib
from typing import Final

import msgspec

from services.run_history.vehicle import Vehicle
from services.simulator.motion_settings import CONVENTIONAL
from services.simulator.motion_settings import Vehicle as SimulatedVehicle

DEMO: Final = "demo"
"""Name that stands for it where a vehicle file is asked for."""
MASS_T: Final = 105.0
CURVE_N_M_PER_T: Final = 5884.0
"""The simulator's 600/R kgf/t."""
_TEXT: Final = """\
# The simulator's train with an assumed mass: all it states is over mass. Replace what you know and name its source.
name = "Demo EMU"
series = "demo"
formation = "3 cars"
cars = 3
drive = "vvvf"
length_m = {length_m:g}
mass_t = {mass_t:g}
load_t = 0.0
rotating_mass_share = 0.0
max_tractive_kn = {tractive_kn:g}
max_power_kw = {power_kw:g}
max_acceleration_mps2 = {acceleration_mps2:g}
service_brake_mps2 = {brake_mps2:g}
max_speed_mps = {speed_mps:g}
curve_n_m_per_t = {curve_n_m_per_t:g}

[resistance]
a_n = {a_n:g}
b_n_per_mps = {b:g}
c_n_per_mps2 = {c:g}

[sources]
length_m = "simulator"
rotating_mass_share = "simulator"
resistance = "simulator, times mass"
curve_n_m_per_t = "simulator"
max_tractive_kn = "simulator, times mass"
max_power_kw = "simulator, times mass"
max_acceleration_mps2 = "simulator"
service_brake_mps2 = "simulator"
max_speed_mps = "simulator"
"""


def vehicle_text(simulated: SimulatedVehicle = CONVENTIONAL) -> str:
    """vehicle.toml of a simulated train."""
    return _TEXT.format(
        length_m=simulated.length_m,
        mass_t=MASS_T,
        tractive_kn=simulated.max_traction_mps2 * MASS_T,
        power_kw=simulated.power_w_per_kg * MASS_T,
        acceleration_mps2=simulated.max_traction_mps2,
        brake_mps2=simulated.service_brake_mps2,
        speed_mps=simulated.max_speed_mps,
        curve_n_m_per_t=CURVE_N_M_PER_T,
        a_n=simulated.davis_a_mps2 * MASS_T * 1000.0,
        b=simulated.davis_b_per_s * MASS_T * 1000.0,
        c=simulated.davis_c_per_m * MASS_T * 1000.0,
    )


def demo_vehicle() -> Vehicle:
    """The conventional train of the simulator."""
    return msgspec.convert(tomllib.loads(vehicle_text()), Vehicle)
