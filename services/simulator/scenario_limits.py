"""What trains, rails and sensors can be: a scenario beyond is a slip of the pen, most often of the unit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import msgspec

Range = tuple[float, float, str]

LIMITS: Final[dict[str, dict[str, Range]]] = {
    "TrainScenario": {
        "duration_s": (0.1, 2.6e6, "s"),
        "max_gradient_permille": (0.1, 150.0, "‰"),
        "balise_reader_behind_front_m": (-2000.0, 2000.0, "m"),
    },
    "Journey": {"irregularity": (0.0, 100.0, "times that of a maintained line")},
    "Vehicle": {
        "length_m": (1.0, 2000.0, "m"),
        "bogie_base_m": (0.5, 50.0, "m"),
        "max_traction_mps2": (0.02, 10.0, "m/s²"),
        "power_w_per_kg": (0.1, 500.0, "W/kg"),
        "service_brake_mps2": (0.05, 10.0, "m/s²"),
        "max_speed_mps": (0.5, 150.0, "m/s"),
        "jerk_mps3": (0.02, 50.0, "m/s³"),
        "davis_a_mps2": (0.0, 0.5, "m/s²"),
        "davis_b_per_s": (0.0, 0.05, "1/s"),
        "davis_c_per_m": (0.0, 0.01, "1/m"),
        "traction_load": (0.0, 50.0, "times the train's mean"),
        "brake_load": (0.0, 50.0, "times the train's mean"),
        "rotating_mass_share": (1e-3, 10.0, "of the mass carried"),
        "pitch_per_mps2": (-0.1, 0.1, "rad per m/s²"),
        "roll_flexibility": (0.0, 5.0, "of the cant deficiency"),
    },
    "Driving": {
        "margin_mps": (0.0, 50.0, "m/s"),
        "band_mps": (0.0, 50.0, "m/s"),
        "brake_mps2": (0.05, 10.0, "m/s²"),
        "power_share": (0.01, 1.0, "of the full effort"),
        "dwell_s": (0.0, 86_400.0, "s"),
    },
    "Adhesion": {
        "random_gap_s": (0.1, 1e6, "s"),
        "shortest_gap_s": (0.0, 1e6, "s"),
        "duration_median_s": (0.1, 600.0, "s"),
        "duration_sigma": (0.0, 3.0, "(natural logarithm)"),
        "micro_slip": (0.0, 100.0, "times the usual"),
        "build_up": (0.0, 100.0, "times the usual"),
        "build_up_speed": (0.0, 100.0, "times the usual"),
        "dry_mps2": (0.01, 20.0, "m/s²"),
    },
    "Episode": {"duration_s": (0.01, 3600.0, "s"), "slip": (1e-4, 5.0, "of the speed")},
    "Imu": {
        "behind_front_m": (-2000.0, 2000.0, "m"),
        "noise": (0.0, 1000.0, "times the grade's"),
        "gyro_bias_dps": (0.0, 100.0, "°/s"),
        "accelerometer_bias_mps2": (0.0, 50.0, "m/s²"),
        "temperature_change_c": (-200.0, 200.0, "K"),
        "warm_up_s": (0.1, 1e6, "s"),
        "vibration": (0.0, 1000.0, "times the usual"),
        "mounting_deg": (-180.0, 180.0, "°"),
        "mounting_sigma_deg": (0.0, 90.0, "°"),
        "distortion": (0.0, 100.0, "times the grade's"),
    },
    "Tacho": {"wheel_scale_sigma": (0.0, 0.1, "of the diameter")},
    "Gnss": {"antenna_behind_front_m": (-2000.0, 2000.0, "m"), "antenna_above_rail_m": (0.1, 50.0, "m")},
    "TrackSettings": {
        "max_gradient_permille": (0.0, 150.0, "‰"),
        "gradient_every_m": (20.0, 2e5, "m"),
        "vertical_radius_m": (100.0, 1e6, "m"),
        "radius_m": (30.0, 1e6, "m"),
        "curve_every_m": (0.0, 2e5, "m"),
        "arc_m": (1.0, 2e5, "m"),
        "transition_m": (1.0, 5000.0, "m"),
        "stop_every_m": (100.0, 2e5, "m"),
        "limit_mps": (0.5, 150.0, "m/s"),
        "irregularity": (0.0, 100.0, "times that of a maintained line"),
        "lateral_mps2": (0.05, 10.0, "m/s²"),
    },
}
"""By table: smallest and largest value of a field with its unit; of a range, of both its ends."""


def beyond_limits(part: msgspec.Struct, path: str = "$") -> Iterator[str]:
    """Every value of a scenario that is beyond its limits, in words with its path."""
    limits = LIMITS.get(type(part).__name__, {})
    for name in part.__struct_fields__:
        value = getattr(part, name)
        where = f"{path}.{name}"
        if name in limits and value is not None:
            low, high, unit = limits[name]
            for one in value if isinstance(value, tuple) else (value,):
                if not low <= one <= high:
                    yield f"{one:g} is beyond all trains: {low:g} to {high:g} {unit} is wanted - at `{where}`"
        elif isinstance(value, msgspec.Struct):
            yield from beyond_limits(value, where)
        elif isinstance(value, tuple):
            for number, one in enumerate(value):
                if isinstance(one, msgspec.Struct):
                    yield from beyond_limits(one, f"{where}[{number}]")
