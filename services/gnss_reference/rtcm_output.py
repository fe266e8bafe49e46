"""A station's observations as RTCM 3, for receivers that correct themselves."""

from __future__ import annotations

from collections import Counter
from typing import Final, Literal

from schemas.gnss import Ephemeris, Epoch, StateVectorOrbit
from services.gnss_receiver.heard import StationPosition
from services.gnss_receiver.rtcm_ephemerides import write_ephemeris
from services.gnss_receiver.rtcm_messages import framed
from services.gnss_receiver.rtcm_msm_writing import MsmWriter
from services.gnss_receiver.rtcm_station import write_station

_POSITION_EVERY: Final = 10
"""Epochs from one message about the position to the next."""


class RtcmOutput:
    """Writes frames: positions, epochs, ephemerides. What a message cannot hold is counted and left out."""

    def __init__(self, station: int, kind: Literal[4, 7], counts: Counter[str]) -> None:
        """Speak as a station (0 to 4095) in MSM4 or MSM7."""
        self._station = station
        self._writer = MsmWriter(station, kind)
        self._channels: dict[str, int] = {}
        self._ephemerides: dict[str, bytes] = {}
        self._counts = counts
        self._epochs = 0

    def ephemeris(self, ephemeris: Ephemeris) -> bytes:
        """Frame of an ephemeris; it is kept for whoever connects later."""
        if isinstance(ephemeris.orbit, StateVectorOrbit):
            self._channels[ephemeris.satellite] = ephemeris.orbit.frequency_channel
        try:
            frame = framed(write_ephemeris(ephemeris))
        except ValueError:
            self._counts["rtcm_not_written"] += 1
            return b""
        self._ephemerides[ephemeris.satellite] = frame
        return frame

    def greeting(self, position_m: tuple[float, float, float]) -> bytes:
        """What a newcomer needs: the position and every ephemeris."""
        return self._position(position_m) + b"".join(self._ephemerides.values())

    def epoch(self, epoch: Epoch, position_m: tuple[float, float, float]) -> bytes:
        """Frames of an epoch, now and then with the position before them."""
        frames = self._position(position_m) if self._epochs % _POSITION_EVERY == 0 else b""
        self._epochs += 1
        try:
            return frames + b"".join(framed(message) for message in self._writer.messages(epoch, self._channels))
        except ValueError:
            self._counts["rtcm_not_written"] += 1
            return frames

    def _position(self, position_m: tuple[float, float, float]) -> bytes:
        return framed(write_station(StationPosition(self._station, position_m)))
