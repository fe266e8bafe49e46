"""A live receiver: opened, read, watched, and opened again when it fails."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

from schemas.gnss import Epoch, OwnPosition
from services.byte_source.rate_watch import RateWatch
from services.byte_source.serial_stream import SerialLine
from services.byte_source.settings import SerialSource, TcpSource
from services.byte_source.source import READ_S, ByteSource, RetryPauses, SourceError
from services.byte_source.tcp_socket import TcpConnection
from services.gnss_receiver.heard import Heard
from services.gnss_receiver.ntrip_socket import NtripConnection
from services.gnss_receiver.raw_log_file import LoggedSource, RawLogFile
from services.gnss_receiver.receiver_stream import ReceiverStream
from services.gnss_receiver.reception import NtripSource, Reception, Source
from services.nmea_output.sentences import position_report
from services.runtime.clock import Clock
from services.runtime.node import Node

_UNINTELLIGIBLE: Final = 4096
"""So many bytes without a message: it is another protocol, or the wrong rate of a serial line."""
_CLOCK_SET_NS: Final = 1_577_836_800 * 10**9
"""2020-01-01: a clock before this has never been set."""
_FRAMES: Final = ("rtcm3_frames", "ubx_frames", "nmea_frames")


def connection(source: Source, clock: Clock) -> ByteSource:
    """Connection that a live source names. Raises TypeError for a recording."""
    match source:
        case SerialSource():
            return SerialLine(source.port, source.baud)
        case TcpSource():
            return TcpConnection(source.host, source.port)
        case NtripSource():
            place = source.position
            return NtripConnection(source, place and (lambda: position_report(clock.now_ns(), *place)))
        case _:
            msg = f"{type(source).__name__} is no live source"
            raise TypeError(msg)


async def follow(node: Node, config: Reception, source: ByteSource) -> AsyncIterator[Heard]:
    """What a live receiver says, until the service is to stop.

    A source that cannot be opened, breaks or falls silent is opened anew after a pause that grows
    from one second to half a minute; health says why, until something comes again.
    """
    log = RawLogFile(Path(config.raw_log), config.raw_log_bytes, config.raw_log_files) if config.raw_log else None
    link = _Link(node, config, LoggedSource(source, log) if log else source, log)
    pauses = RetryPauses()
    while not node.stopping:
        fault = await link.open()
        if not fault:
            async for heard in link.heard():
                pauses.reset()
                yield heard
            fault = link.fault
            for heard in link.stream.cut():
                yield heard
        if node.stopping:
            break
        pause_s = pauses.take()
        node.health.set("source", f"{source.name}: {fault}; trying again in {pause_s:.0f} s", "failed")
        await node.sleep(pause_s)


class _Link:
    """One source over all its connections."""

    def __init__(self, node: Node, config: Reception, source: ByteSource, log: RawLogFile | None) -> None:
        self._node = node
        self._config = config
        self._source = source
        self._log = log
        self._rate = RateWatch(config.rate_hz, node.clock.monotonic_s())
        self.stream = ReceiverStream(node.clock.now_ns())
        self.fault = ""

    async def open(self) -> str:
        """Connect; in words why not, or nothing."""
        try:
            await self._node.in_thread(self._source.open)
        except SourceError as error:
            self._node.health.count("failed_openings")
            return str(error)
        self._node.health.count("connections")
        self.stream.near(self._node.clock.now_ns())
        return ""

    async def heard(self) -> AsyncIterator[Heard]:
        """What comes until the connection ends; `fault` says why it did."""
        silent_s = 0.0
        understood = self._frames()
        unread = 0
        try:
            while await self._node.sleep(0.0):
                chunk = await self._node.in_thread(self._source.read)
                silent_s = 0.0 if chunk else silent_s + READ_S
                if silent_s >= self._config.silence_s:
                    self.fault = f"nothing came for {silent_s:.0f} s"
                    return
                self.stream.host_time(self._node.clock.now_ns())
                for one in self.stream.feed(chunk) if chunk else ():
                    self._count(one)
                    yield one
                unread = 0 if self._frames() > understood else unread + len(chunk)
                understood = self._frames()
                self._report(unread)
        except SourceError as error:
            self.fault = str(error)
        finally:
            await self._node.in_thread(self._source.close)

    def _frames(self) -> int:
        return sum(self.stream.counts[name] for name in _FRAMES)

    def _count(self, heard: Heard) -> None:
        self._node.health.clear("source")
        if isinstance(heard, Epoch | OwnPosition):
            self._rate.heard(self._node.clock.monotonic_s())

    def _report(self, unread: int) -> None:
        """Say in health what came, and what is wrong with it."""
        health = self._node.health
        health.counts.update(self.stream.counts)
        unintelligible = f"{unread} bytes came without a message: check the protocol and the rate of the line"
        unset = "the host's clock is not set: messages that do not name their week are dated wrong"
        faults = {
            "clock": unset if self._node.clock.now_ns() < _CLOCK_SET_NS else "",
            "unintelligible": unintelligible if unread >= _UNINTELLIGIBLE else "",
            "rate": self._rate.fault(self._node.clock.monotonic_s()),
            "raw_log": self._log.error if self._log else "",
        }
        for name, words in faults.items():
            if words:
                health.set(name, words)
            else:
                health.clear(name)
