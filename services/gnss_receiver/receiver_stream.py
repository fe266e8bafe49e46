"""Everything that a receiver's bytes say, whatever protocols they mix."""

from __future__ import annotations

from collections.abc import Iterable

from schemas.gnss import Epoch, OwnPosition
from services.gnss_receiver.heard import Heard
from services.gnss_receiver.nmea_stream import NmeaStream
from services.gnss_receiver.rtcm_stream import RtcmStream
from services.gnss_receiver.stream_frames import Framer, Protocol
from services.gnss_receiver.ubx_stream import UbxStream


class ReceiverStream:
    """Turns bytes into what they say, in their order; nothing in them makes it fail.

    A receiver may speak several protocols at once. Its epochs are taken from the first one that
    gives any, so that none comes twice; its own position from UBX, as soon as that gives one.
    """

    def __init__(self, near_ns: int) -> None:
        """Start near a time (UTC); see `near`."""
        self._framer = Framer()
        self.counts = self._framer.counts
        """What came and what was refused, by reason."""
        self._rtcm = RtcmStream(self.counts, near_ns)
        self._ubx = UbxStream(self.counts, near_ns)
        self._nmea = NmeaStream(self.counts, near_ns)
        self._measuring: Protocol | None = None
        self._ubx_positions = False

    def near(self, t_ns: int) -> None:
        """Take weeks and days that messages do not name from around a time (UTC), within three days.

        Messages that do name them come first, and each one moves the time on.
        """
        for stream in (self._rtcm, self._ubx, self._nmea):
            stream.near(t_ns)

    def host_time(self, t_ns: int) -> None:
        """Tell what the host's clock (UTC) says while a live stream runs: it may have been set in between."""
        self._rtcm.host_time(t_ns)

    def feed(self, chunk: bytes) -> list[Heard]:
        """What the messages completed by `chunk` say."""
        heard: list[Heard] = []
        for frame in self._framer.feed(chunk):
            match frame.protocol:
                case "rtcm3":
                    heard += self._chosen("rtcm3", self._rtcm.add(frame.content))
                case "ubx":
                    heard += self._chosen("ubx", self._ubx.add(frame.content))
                case "nmea":
                    heard += self._chosen("nmea", self._nmea.add(frame.content))
        return heard

    def cut(self) -> list[Heard]:
        """What is there of unfinished messages: the connection ended, what comes next does not continue them."""
        self._framer.cut()
        return [*self._chosen("rtcm3", self._rtcm.cut()), *self._chosen("nmea", self._nmea.cut())]

    def _chosen(self, protocol: Protocol, heard: Iterable[Heard]) -> list[Heard]:
        kept: list[Heard] = []
        for one in heard:
            if isinstance(one, Epoch):
                self._measuring = self._measuring or protocol
                if self._measuring != protocol:
                    self.counts["epochs_twice"] += 1
                    continue
                self.counts["epochs"] += 1
            elif isinstance(one, OwnPosition):
                self._ubx_positions |= protocol == "ubx"
                if self._ubx_positions and protocol != "ubx":
                    self.counts["positions_twice"] += 1
                    continue
                self.counts["own_positions"] += 1
            kept.append(one)
        return kept
