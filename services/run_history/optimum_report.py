"""An optimum with what people ask about it: over drivers, over running times, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from schemas.line import Station
from services.line.alignment import Alignment
from services.run_history.driving_advice import advice_lines, advice_of
from services.run_history.optimum import Optimum, OptimumError, driven, fastest_run, optimum, section_between
from services.run_history.vehicle import Vehicle

DRIVERS: Final = (("gentle", 0.75), ("as stated", 1.0), ("brisk", 1.15))
"""Shares of the stated acceleration and brakes: the optimum depends on the driver, so it is given as a range."""
OFFSETS_S: Final = (-20.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0)


@dataclass(frozen=True, slots=True)
class OptimumReport:
    """The profile of the vehicle as stated, and what surrounds it."""

    start: Station
    end: Station
    wanted_s: float
    profile: Optimum
    fastest_s: float
    drivers: tuple[tuple[str, float | None], ...]
    """Energy [kWh] by driver; None where that driver cannot be so fast."""
    curve: tuple[tuple[float, float | None], ...]
    """Energy [kWh] by running time [s]."""

    def summary(self) -> dict[str, Any]:
        """Figures for machines."""
        return {
            "from": self.start.name,
            "to": self.end.name,
            "running_time_s": self.profile.running_time_s,
            "traction_kwh": self.profile.traction_kwh,
            "price_kwh_per_s": self.price_kwh_per_s,
            "fastest_s": self.fastest_s,
            "drivers": dict(self.drivers),
            "curve": [{"running_time_s": time, "traction_kwh": energy} for time, energy in self.curve],
            "advice": [
                {
                    "what": one.what,
                    "from_axis_m": one.from_axis_m,
                    "until_axis_m": one.until_axis_m,
                    "from_kmh": one.from_kmh,
                    "until_kmh": one.until_kmh,
                    "from_s": one.from_s,
                    "until_s": one.until_s,
                }
                for one in advice_of(self.profile)
            ],
        }

    @property
    def price_kwh_per_s(self) -> float:
        """What a second less costs, from the curve about the wanted time; the price itself at its ends."""
        known = [(time, energy) for time, energy in self.curve if energy is not None]
        near = sorted(known, key=lambda one: abs(one[0] - self.wanted_s))[:3]
        times, energies = zip(*sorted(near), strict=True)
        if len(near) < 2:  # noqa: PLR2004 - a slope needs two
            return self.profile.price_w / 3.6e6
        return float((energies[0] - energies[-1]) / (times[-1] - times[0]))


def report_of(way: Alignment, vehicle: Vehicle, start: Station, end: Station, running_time_s: float) -> OptimumReport:
    """Optimum between two stations. Raises OptimumError."""
    section = section_between(way, vehicle, start.axis_m, end.axis_m)
    fastest = fastest_run(section, vehicle)
    profile = optimum(section, vehicle, running_time_s)

    def energy(train: Vehicle, time_s: float) -> float | None:
        try:
            return optimum(section, train, time_s).traction_kwh
        except OptimumError:
            return None

    drivers = tuple((name, energy(driven(vehicle, share), running_time_s)) for name, share in DRIVERS)
    curve = tuple((running_time_s + offset, energy(vehicle, running_time_s + offset)) for offset in OFFSETS_S)
    return OptimumReport(start, end, running_time_s, profile, fastest.running_time_s, drivers, curve)


def report_lines(report: OptimumReport) -> list[str]:
    """The report as text."""
    profile = report.profile
    drivers = ", ".join(f"{name} {'-' if kwh is None else f'{kwh:.2f}'}" for name, kwh in report.drivers)
    run = f"{report.start.name} -> {report.end.name}: {profile.traction_kwh:.2f} kWh in {profile.running_time_s:.1f} s"
    return [
        f"{run} (fastest {report.fastest_s:.1f} s)",
        f"kWh by driver: {drivers}",
        f"one second less costs about {1000.0 * report.price_kwh_per_s:.0f} Wh",
        "seconds   kWh",
        *(f"{time:7.0f}  {'too fast' if kwh is None else f'{kwh:6.2f}'}" for time, kwh in report.curve),
        *advice_lines(profile),
        "An estimate that supports people; it is no driving order and no certified speed supervision.",
    ]
