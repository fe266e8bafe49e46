"""A vehicle as energy sees it: mass, resistance, tractive effort, brakes, efficiency, and the source of each value."""

from __future__ import annotations

from typing import Annotated, Final, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
GRAVITY_MPS2: Final = 9.80665
CURVE_N_M_PER_T: Final = 7845.0
"""Curve resistance of narrow gauge: 800/R kgf/t (R in metres) in newton metres per tonne."""
Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class Resistance(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Running resistance on straight level track of the whole train [N], V in m/s: a + b V + c V²."""

    a_n: NotNegative
    b_n_per_mps: NotNegative = 0.0
    c_n_per_mps2: NotNegative = 0.0


class Vehicle(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """vehicle.toml."""

    name: Annotated[str, Meta(min_length=1, max_length=64)]
    series: str = ""
    """Group in statistics; the name when left out."""
    formation: str = ""
    drive: Literal["vvvf", "resistor", "chopper", "diesel", "battery"] = "vvvf"
    mass_t: Annotated[float, Meta(gt=0.0, le=20_000.0)]
    """Empty train."""
    load_t: NotNegative = 0.0
    """Passengers at a load factor of 1."""
    load_factor: Annotated[float, Meta(ge=0.0, le=3.0)] = 0.3
    rotating_mass_share: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.06
    """Of the empty train's mass."""
    length_m: Positive = 80.0
    cars: Annotated[int, Meta(ge=1, le=100)] = 4
    resistance: Resistance | Literal["jis_emu"] = "jis_emu"
    """`jis_emu`: 1.32 + 0.0164 V kgf/t and (0.028 + 0.0078 (n − 1)) V² kgf for n cars, V in km/h."""
    curve_n_m_per_t: NotNegative = CURVE_N_M_PER_T
    """Curve resistance: this over the radius, per tonne."""
    max_tractive_kn: Positive = 200.0
    max_power_kw: Positive = 1500.0
    """At the wheel."""
    max_acceleration_mps2: Positive = 0.9
    service_brake_mps2: Positive = 0.8
    max_speed_mps: Positive = 33.3
    efficiency: Annotated[float, Meta(gt=0.0, le=1.0)] | None = None
    """From the line to the wheel; by drive type when left out (vvvf 0.85, chopper 0.80, resistor 0.78, …)."""
    regeneration_efficiency: Share | None = None
    """From the wheel to the line, over all braking; by drive type when left out. Reported apart."""
    auxiliaries_kw: NotNegative | None = None
    """Heating, light, compressors on average; AUXILIARIES_KW_PER_CAR when left out. Reported apart."""
    calibration: Positive = 1.0
    """Factor from a metered run, on the traction energy."""
    acceleration_mps2: Positive = 0.48
    """Assumed below V_stop when a departure is completed."""
    deceleration_mps2: Positive = 0.60
    """The same for arrivals."""
    sources: dict[str, str] = {}
    """By field: where the value comes from; what is not named is assumed."""

    @property
    def group(self) -> str:
        """Series, or the name."""
        return self.series or self.name

    @property
    def running_mass_kg(self) -> float:
        """Train with its load."""
        return 1000.0 * (self.mass_t + self.load_t * self.load_factor)

    @property
    def inertial_mass_kg(self) -> float:
        """Running mass and what rotates."""
        return self.running_mass_kg + 1000.0 * self.mass_t * self.rotating_mass_share

    @property
    def line_to_wheel(self) -> float:
        """Efficiency, stated or by drive type."""
        return EFFICIENCY[self.drive] if self.efficiency is None else self.efficiency

    @property
    def wheel_to_line(self) -> float:
        """Share of braking that comes back to the line, stated or by drive type."""
        return REGENERATION[self.drive] if self.regeneration_efficiency is None else self.regeneration_efficiency

    @property
    def auxiliaries(self) -> float:
        """Power beside traction [kW], stated or assumed."""
        return AUXILIARIES_KW_PER_CAR * self.cars if self.auxiliaries_kw is None else self.auxiliaries_kw

    def assumed(self) -> tuple[str, ...]:
        """Fields whose source is not stated."""
        return tuple(name for name in self.__struct_fields__ if name not in {"name", "sources", *self.sources})

    def coefficients(self) -> tuple[float, float, float]:
        """Resistance a + b V + c V² [N; V in m/s] of the loaded train."""
        if isinstance(self.resistance, Resistance):
            return self.resistance.a_n, self.resistance.b_n_per_mps, self.resistance.c_n_per_mps2
        tonnes = self.running_mass_kg / 1000.0
        per_kmh = 3.6 * GRAVITY_MPS2
        shape = 0.028 + 0.0078 * (self.cars - 1)
        return 1.32 * tonnes * GRAVITY_MPS2, 0.0164 * tonnes * per_kmh, shape * 3.6 * per_kmh

    def resistance_n(self, speed_mps: ArrayLike) -> Floats:
        """Running resistance on straight level track [N]."""
        a, b, c = self.coefficients()
        speed = np.asarray(speed_mps, float)
        return np.asarray(a + b * speed + c * speed * speed)

    def track_force_n(self, gradient_permille: ArrayLike, curvature_per_m: ArrayLike) -> Floats:
        """Force of gradient (positive uphill) and of curves, against the motion [N]."""
        tonnes = self.running_mass_kg / 1000.0
        climb = self.running_mass_kg * GRAVITY_MPS2 * np.asarray(gradient_permille, float) / 1000.0
        return np.asarray(climb + tonnes * self.curve_n_m_per_t * np.abs(np.asarray(curvature_per_m, float)))


EFFICIENCY: Final[dict[str, float]] = {
    "vvvf": 0.85,
    "chopper": 0.80,
    "resistor": 0.78,
    "diesel": 0.30,
    "battery": 0.85,
}
REGENERATION: Final[dict[str, float]] = {"vvvf": 0.5, "chopper": 0.4, "resistor": 0.0, "diesel": 0.0, "battery": 0.5}
"""Assumed: the drive's efficiency backwards, of what brakes take above walking pace while the line accepts it."""
AUXILIARIES_KW_PER_CAR: Final = 10.0
"""Assumed."""
