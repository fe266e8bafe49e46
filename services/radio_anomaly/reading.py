"""One measurement as the analysis takes it, from a file's row or from the bus, and why it may be refused."""

from __future__ import annotations

import math
from typing import Final

import msgspec

from schemas.radio import Direction, RadioMeasurement

EARLIEST_NS: Final = 946_684_800_000_000_000
"""2000-01-01: a clock that has lost its battery begins at 1970 or 1980."""
LATEST_NS: Final = 2_051_222_400_000_000_000
"""2035-01-01: one that runs over lands in 2036 or 2038."""
LEAST_DBM: Final = -180.0
"""Thermal noise in 1 Hz is -174 dBm."""
MOST_DBM: Final = 60.0
FARTHEST_M: Final = 2.0e6
"""No railway's kilometrage reaches farther."""
BOUNDS: Final[dict[str, tuple[float, float]]] = {
    "power_dbm": (LEAST_DBM, MOST_DBM),
    "decoded_power_dbm": (LEAST_DBM, MOST_DBM),
    "received_ratio": (0.0, 1.0),
    "corrected_bits": (0.0, 1.0e9),
    "frequency_offset_hz": (-1.0e7, 1.0e7),
    "temperature_c": (-80.0, 150.0),
    "tx_power_dbm": (-100.0, MOST_DBM),
}
"""What each column can be at all."""


class Reading(msgspec.Struct, frozen=True, gc=False, kw_only=True):
    """A measurement with its place; without `chainage_m` and `direction` that of a site."""

    t_ns: int
    pass_id: str
    radio: str
    channel: str
    direction: Direction | None = None
    chainage_m: float | None = None
    cell: str = ""
    power_dbm: float | None = None
    """Channel power."""
    decoded_power_dbm: float | None = None
    received_ratio: float | None = None
    corrected_bits: float | None = None
    frequency_offset_hz: float | None = None
    temperature_c: float | None = None
    tx_power_dbm: float | None = None


def reading_of(message: RadioMeasurement) -> Reading:
    """A message of the bus as a reading. A place without a direction, or the reverse, counts as none.

    On board a measurement without a place (`lacks_place`) is of no use here; elsewhere it is that of a site.
    """
    placed = message.chainage_m is not None and message.direction is not None
    return Reading(
        t_ns=message.t_ns,
        pass_id=message.pass_id,
        radio=message.radio,
        channel=message.channel,
        direction=message.direction if placed else None,
        chainage_m=message.chainage_m if placed else None,
        cell=message.cell,
        power_dbm=message.channel_power_dbm,
        decoded_power_dbm=message.decoded_power_dbm,
        received_ratio=message.received_ratio,
        corrected_bits=message.corrected_bits,
        frequency_offset_hz=message.frequency_offset_hz,
        temperature_c=message.temperature_c,
        tx_power_dbm=message.tx_power_dbm,
    )


def lacks_place(message: RadioMeasurement) -> bool:
    """Whether the place of a measurement made on board is not known: it is neither of the line nor of a site."""
    return message.side == "onboard" and (message.chainage_m is None or message.direction is None)


def refusal_of(reading: Reading) -> str | None:
    """Why a reading cannot be used; None for one that can.

    >>> refusal_of(Reading(t_ns=1_700_000_000_000_000_000, pass_id="p", radio="r", channel="c", power_dbm=float("nan")))
    'power_dbm nan is no power between -180 and 60'
    """
    if not EARLIEST_NS <= reading.t_ns < LATEST_NS:
        return "the time is before 2000 or after 2034: the clock was reset"
    if reading.chainage_m is not None and not abs(reading.chainage_m) <= FARTHEST_M:
        return f"chainage_m {reading.chainage_m:g} is off every line"
    for name, (least, most) in BOUNDS.items():
        value = getattr(reading, name)
        if value is not None and not (math.isfinite(value) and least <= value <= most):
            noun = "power" if name.endswith("_dbm") else "value"
            return f"{name} {value:g} is no {noun} between {least:g} and {most:g}"
    if reading.power_dbm is None and reading.decoded_power_dbm is None and reading.received_ratio is None:
        return "neither a power nor a reception ratio"
    return None
