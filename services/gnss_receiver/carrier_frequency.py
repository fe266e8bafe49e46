"""Carrier frequencies of every signal that receivers name.

Source: RINEX 3.05, tables 4 to 10; GLONASS ICD 5.1, 3.3.1.1.
"""

from __future__ import annotations

from typing import Final

_BANDS_HZ: Final = {
    "G": {"1": 1575.42e6, "2": 1227.60e6, "5": 1176.45e6},
    "E": {"1": 1575.42e6, "5": 1176.45e6, "6": 1278.75e6, "7": 1207.14e6, "8": 1191.795e6},
    "C": {"1": 1575.42e6, "2": 1561.098e6, "5": 1176.45e6, "6": 1268.52e6, "7": 1207.14e6, "8": 1191.795e6},
    "J": {"1": 1575.42e6, "2": 1227.60e6, "5": 1176.45e6, "6": 1278.75e6},
    "S": {"1": 1575.42e6, "5": 1176.45e6},
    "I": {"1": 1575.42e6, "5": 1176.45e6, "9": 2492.028e6},
}
_GLONASS_HZ: Final = {
    # by channel 0 and per channel
    "1": (1602.0e6, 0.5625e6),
    "2": (1246.0e6, 0.4375e6),
    "3": (1202.025e6, 0.0),
    "4": (1600.995e6, 0.0),
    "6": (1248.06e6, 0.0),
}


def signal_hz(system: str, signal: str, channel: int | None = None) -> float | None:
    """Carrier of a signal (RINEX 3 band and attribute); None where it is not known.

    GLONASS L1 and L2 need the satellite's frequency `channel`.

    >>> signal_hz("R", "1C", -7)
    1598062500.0
    """
    if system != "R":
        return _BANDS_HZ.get(system, {}).get(signal[:1])
    centre_hz, step_hz = _GLONASS_HZ.get(signal[:1], (None, 0.0))
    if centre_hz is None or (step_hz and channel is None):
        return None
    return centre_hz + step_hz * (channel or 0)
