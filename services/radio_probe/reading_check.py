"""What of a device's reports can be used, and why not."""

from __future__ import annotations

from collections import OrderedDict
from math import isfinite
from typing import Final

import msgspec

from schemas.radio import RadioMeasurement, Weather
from services.radio_probe.settings import Stamps

NS: Final = 10**9
LIMITS: Final[dict[str, tuple[float, float]]] = {
    "channel_power_dbm": (-180.0, 40.0),
    "decoded_power_dbm": (-180.0, 40.0),
    "received_ratio": (0.0, 1.0),
    "corrected_bits": (0.0, 1e6),
    "snr_db": (-60.0, 120.0),
    "rsrq_db": (-60.0, 40.0),
    "frequency_offset_hz": (-1e6, 1e6),
    "temperature_c": (-80.0, 150.0),
    "tx_power_dbm": (-80.0, 80.0),
    "chainage_m": (-1e7, 1e7),
    "axis_m": (-1e7, 1e7),
    "place_bound_m": (0.0, 1e7),
    "speed_mps": (-200.0, 200.0),
}
"""Beyond these a device is not measuring but broken."""
WEATHER_LIMITS: Final[dict[str, tuple[float, float]]] = {
    "axis_m": (-1e7, 1e7),
    "reach_m": (1e-3, 1e6),
    "temperature_c": (-80.0, 70.0),
    "rain_mm_per_h": (0.0, 500.0),
    "snow_mm_per_h": (0.0, 100.0),
    "snow_depth_cm": (0.0, 2000.0),
}
MEASURED: Final = ("channel_power_dbm", "decoded_power_dbm", "received_ratio")
REMEMBERED: Final = 4096
"""Reports among which a second one of the same is noticed."""


class ReadingCheck:
    """Judges reports of all devices of a place; counts what it refuses, by reason."""

    def __init__(self, largest_clock_error_s: float) -> None:
        """Begin with nothing seen."""
        self._largest_ns = round(largest_clock_error_s * NS)
        self._seen: OrderedDict[tuple[str, str, str, str, int], None] = OrderedDict()
        self.counts: dict[str, int] = {}
        self.reason = ""
        """Of the last refusal or correction, in words."""

    def reading(self, device: str, message: RadioMeasurement, now_ns: int, stamps: Stamps) -> RadioMeasurement | None:
        """The report as it can be used, with the host's time where its own is impossible; None for a refused one."""
        fault = _absurd(message, LIMITS)
        if fault:
            self._refuse("absurd", f"{device}: {fault}")
            return None
        if all(getattr(message, name) is None for name in MEASURED):
            self._refuse("nothing_measured", f"{device}: neither a power nor a reception")
            return None
        if message.t_ns and not self._first(device, message):
            self._refuse("doubled", f"{device}: {message.radio} on {message.channel} twice at one time")
            return None
        return msgspec.structs.replace(message, t_ns=self._time_ns(device, message.t_ns, now_ns, stamps))

    def _first(self, device: str, message: RadioMeasurement) -> bool:
        """Whether the device has not said so before."""
        key = (device, message.radio, message.channel, message.train, message.t_ns)
        if key in self._seen:
            return False
        self._seen[key] = None
        if len(self._seen) > REMEMBERED:
            self._seen.popitem(last=False)
        return True

    def weather(self, device: str, message: Weather, now_ns: int, stamps: Stamps) -> Weather | None:
        """The same of the weather."""
        fault = _absurd(message, WEATHER_LIMITS)
        if fault:
            self._refuse("absurd", f"{device}: {fault}")
            return None
        return msgspec.structs.replace(message, t_ns=self._time_ns(device, message.t_ns, now_ns, stamps))

    def _time_ns(self, device: str, t_ns: int, now_ns: int, stamps: Stamps) -> int:
        """Time of a report; 0 stands for a device that gives none."""
        if t_ns == 0 or stamps == "arrival":
            return now_ns
        if stamps == "checked" and abs(t_ns - now_ns) > self._largest_ns:
            off_s = (t_ns - now_ns) / NS
            self._count("clock_off", f"{device}: its clock is off by {off_s:.0f} s; the host's time is taken")
            return now_ns
        return t_ns

    def _refuse(self, name: str, reason: str) -> None:
        self._count(name, f"{reason}; refused")

    def _count(self, name: str, reason: str) -> None:
        self.counts[name] = self.counts.get(name, 0) + 1
        self.reason = reason


def _absurd(message: msgspec.Struct, limits: dict[str, tuple[float, float]]) -> str:
    """Which field cannot be, in words; empty when all can."""
    for name, (low, high) in limits.items():
        value = getattr(message, name)
        if value is not None and not (isfinite(value) and low <= value <= high):
            return f"{name} {value:g} is not between {low:g} and {high:g}"
    return ""
