"""Messages of RTCM 3 about the station itself: 1005 and 1006 its position, 1013 the date.

Source: RTCM 10403.3, 3.5.2 and 3.5.6.
"""

from __future__ import annotations

from typing import Final

from services.gnss_receiver.bit_fields import BitReader
from services.gnss_receiver.heard import StationPosition
from services.gnss_receiver.rtcm_messages import read_fields, write_fields
from services.gnss_receiver.rtcm_time import gps_ms_of_day

POSITION, POSITION_AND_HEIGHT, SYSTEM_PARAMETERS = 1005, 1006, 1013
_DIGITS: Final = 4
"""Coordinates are whole tenths of a millimetre."""
_DATE_BITS: Final = 24
_DAY_BITS, _SECOND_BITS = 16, 17


def read_station(number: int, message: bytes) -> StationPosition:
    """Position in a message 1005 or 1006. Raises ValueError when it is cut short."""
    fields = read_fields(message)
    x_m, y_m, z_m = (round(fields[name], _DIGITS) for name in ("DF025", "DF026", "DF027"))
    height_m = round(fields["DF028"], _DIGITS) if number == POSITION_AND_HEIGHT else None
    return StationPosition(int(fields["DF003"]), (x_m, y_m, z_m), height_m)


def write_station(position: StationPosition, systems: str = "GRE") -> bytes:
    """Message 1005, or 1006 where the antenna's height is known, of a real station that serves `systems`.

    Raises ValueError for what a field cannot hold.
    """
    x_m, y_m, z_m = position.position_m
    served = {"DF022": "G" in systems, "DF023": "R" in systems, "DF024": "E" in systems}
    values = {"DF003": position.station, "DF025": x_m, "DF026": y_m, "DF027": z_m} | served
    if position.antenna_height_m is None:
        return write_fields(POSITION, values)
    return write_fields(POSITION_AND_HEIGHT, values | {"DF028": position.antenna_height_m})


def read_date(message: bytes) -> int:
    """GPS time [ms] at which a message 1013 was sent. Raises ValueError when it is cut short."""
    reader = BitReader(message)
    reader.uint(_DATE_BITS)
    return gps_ms_of_day(reader.uint(_DAY_BITS), reader.uint(_SECOND_BITS))
