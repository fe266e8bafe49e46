"""When a stream of messages was recorded, as far as it says so itself."""

from __future__ import annotations

from collections import Counter
from typing import Final

from schemas.gnss import Epoch, OwnPosition
from schemas.gnss_time import NS
from services.gnss_receiver.nmea_stream import NmeaStream
from services.gnss_receiver.rtcm_ephemerides import EPHEMERIDES, GLONASS, read_ephemeris
from services.gnss_receiver.rtcm_messages import number_of
from services.gnss_receiver.rtcm_station import SYSTEM_PARAMETERS, read_date
from services.gnss_receiver.rtcm_time import unix_ns_from_gps_ms
from services.gnss_receiver.stream_frames import Frame, Framer
from services.gnss_receiver.ubx_stream import UbxStream

_CHUNK: Final = 65_536
_SEARCHED: Final = 262_144
"""A date beyond doubt stands within so many bytes, or nowhere; then the week of an ephemeris must do."""
_EARLIEST_NS: Final = 400 * 86_400 * NS
"""What is dated before 1971 has no date."""


def date_of(content: bytes, now_ns: int) -> int | None:
    """A time (UTC) within some days of a recording; None where it names none.

    Ephemerides of RTCM count weeks modulo 1024: of the possible weeks that nearest to `now_ns` is
    taken. Message 1013, UBX and NMEA name the day itself and are preferred.
    """
    framer, nmea, ubx = Framer(), NmeaStream(Counter(), 0), UbxStream(Counter(), 0)
    doubtful: int | None = None
    for at in range(0, len(content), _CHUNK):
        if doubtful is not None and at >= _SEARCHED:
            break
        for frame in framer.feed(content[at : at + _CHUNK]):
            certain = _certain(frame, nmea, ubx)
            if certain is not None:
                return certain
            if doubtful is None:
                doubtful = _doubtful(frame, now_ns)
    return doubtful


def _certain(frame: Frame, nmea: NmeaStream, ubx: UbxStream) -> int | None:
    """Time that a frame names beyond doubt."""
    if frame.protocol == "rtcm3":
        try:
            is_date = number_of(frame.content) == SYSTEM_PARAMETERS
            return unix_ns_from_gps_ms(read_date(frame.content)) if is_date else None
        except ValueError:
            return None
    heard = nmea.add(frame.content) if frame.protocol == "nmea" else ubx.add(frame.content)
    # A time of day without a date was laid on the first day of all.
    times = (one.t_ns for one in heard if isinstance(one, Epoch | OwnPosition))
    return next((t_ns for t_ns in times if t_ns > _EARLIEST_NS), None)


def _doubtful(frame: Frame, now_ns: int) -> int | None:
    """Time in an ephemeris that counts weeks but not GLONASS, which counts days only."""
    number = number_of(frame.content) if frame.protocol == "rtcm3" else 0
    if number not in EPHEMERIDES or number == GLONASS:
        return None
    try:
        return read_ephemeris(number, frame.content, now_ns).t_ns
    except ValueError:
        return None
