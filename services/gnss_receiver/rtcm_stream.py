"""What a stream of RTCM 3 messages says: epochs, ephemerides, the station's position."""

from __future__ import annotations

from collections import Counter
from typing import Final

from schemas.gnss import Ephemeris, Epoch, StateVectorOrbit
from services.gnss_receiver.heard import Heard
from services.gnss_receiver.rtcm_ephemerides import EPHEMERIDES, GALILEO_F, GALILEO_I, read_ephemeris
from services.gnss_receiver.rtcm_epochs import EpochAssembler
from services.gnss_receiver.rtcm_messages import number_of
from services.gnss_receiver.rtcm_msm import msm_kind, read_msm
from services.gnss_receiver.rtcm_station import (
    POSITION,
    POSITION_AND_HEIGHT,
    SYSTEM_PARAMETERS,
    read_date,
    read_station,
)
from services.gnss_receiver.rtcm_time import epoch_gps_ms, gps_ms_from_unix_ns, unix_ns_from_gps_ms

_ASTRAY_MS: Final = 3_600_000
"""A live stream is not an hour old; the clock must have been set."""
_KEPT: Final = 1000
"""Messages remembered to know repetitions: some times what all satellites of all systems send."""


class RtcmStream:
    """Turns messages into what they say, in their order; keeps what is needed to do so.

    `near_gps_ms`, a time that lies within three days of the messages, resolves their weeks; message
    1013 sets it right, and each epoch moves it on.
    """

    def __init__(self, counts: Counter[str], near_ns: int) -> None:
        """Start near a time (UTC); what is noticed is counted in `counts`."""
        self._counts = counts
        self._near_gps_ms = gps_ms_from_unix_ns(near_ns)
        self._dated = False
        self._assembler = EpochAssembler(counts)
        self._channels: dict[str, int] = {}
        self._seen: dict[bytes, None] = {}
        self._with_inav: set[str] = set()

    def near(self, t_ns: int) -> None:
        """Resolve weeks around another time (UTC)."""
        self._near_gps_ms = gps_ms_from_unix_ns(t_ns)
        self._dated = False

    def host_time(self, t_ns: int) -> None:
        """Resolve weeks around the host's clock (UTC) where that has been set since, unless a message names the day."""
        host_gps_ms = gps_ms_from_unix_ns(t_ns)
        if not self._dated and abs(host_gps_ms - self._near_gps_ms) > _ASTRAY_MS:
            self._near_gps_ms = host_gps_ms

    def add(self, message: bytes) -> list[Heard]:
        """What a message says, together with those before. What cannot be read is counted by its reason."""
        number = number_of(message)
        try:
            if msm_kind(number):
                return list(self._epochs(message))
            if number in EPHEMERIDES:
                return list(self._ephemeris(number, message))
            if number in (POSITION, POSITION_AND_HEIGHT):
                return [read_station(number, message)]
            if number == SYSTEM_PARAMETERS:
                self._near_gps_ms = read_date(message)
                self._dated = True
            else:
                self._counts[f"not_read_rtcm_{number}"] += 1
        except ValueError:
            self._counts[f"bad_rtcm_{number}"] += 1
        return []

    def cut(self) -> list[Heard]:
        """What is there of an unfinished epoch: the connection ended."""
        return list(self._assembler.cut())

    def _epochs(self, message: bytes) -> list[Epoch]:
        cells = read_msm(message)
        gps_ms = epoch_gps_ms(cells.system, cells.epoch, self._near_gps_ms)
        self._near_gps_ms = gps_ms
        self._channels |= cells.channels
        return self._assembler.add(cells, gps_ms, self._channels)

    def _ephemeris(self, number: int, message: bytes) -> list[Ephemeris]:
        """Ephemeris of a message, unless it says what has been said."""
        if message in self._seen:
            self._counts["ephemerides_repeated"] += 1
            return []
        ephemeris = read_ephemeris(number, message, unix_ns_from_gps_ms(self._near_gps_ms))
        self._seen[message] = None
        if len(self._seen) > _KEPT:
            del self._seen[next(iter(self._seen))]
        if isinstance(ephemeris.orbit, StateVectorOrbit):
            self._channels[ephemeris.satellite] = ephemeris.orbit.frequency_channel
        if number == GALILEO_I:
            self._with_inav.add(ephemeris.satellite)
        elif number == GALILEO_F and ephemeris.satellite in self._with_inav:
            # Its clock is meant for E5a.
            self._counts["fnav_left_out"] += 1
            return []
        return [ephemeris]
