"""Frames of a CAN bus, through python-can (SocketCAN on Linux, and whatever else it supports)."""

from __future__ import annotations

from typing import Final

import can

from services.byte_source.source import READ_S, SourceError

_MOST: Final = 256
"""Frames taken at once."""
_REFUSALS: Final = (can.CanError, OSError, ValueError, ImportError, NameError, TypeError)
"""What python-can's interfaces raise without a device, its library, or settings that they need beyond a channel."""


class CanConnection:
    """A CAN bus that is listened to."""

    def __init__(self, interface: str, channel: str) -> None:
        """Know the bus; `open` opens it."""
        self._interface = interface
        self._channel = channel
        self._bus: can.BusABC | None = None

    @property
    def name(self) -> str:
        """Interface and channel."""
        return f"CAN {self._interface}:{self._channel}"

    def open(self) -> None:
        """Open the bus. Raises SourceError."""
        self.close()
        try:
            self._bus = can.Bus(interface=self._interface, channel=self._channel)
        except _REFUSALS as error:
            up = f" (is the interface up? `ip link set {self._channel} up type can bitrate …`)"
            msg = f"it cannot be opened: {error}{up if self._interface == 'socketcan' else ''}"
            raise SourceError(msg) from error

    def read(self) -> list[tuple[int, bytes]]:
        """Identifier and content of frames that have come, none within READ_S. Raises SourceError."""
        if self._bus is None:
            msg = "the bus is not open"
            raise SourceError(msg)
        frames: list[tuple[int, bytes]] = []
        try:
            message = self._bus.recv(READ_S)
            while message is not None and len(frames) < _MOST:
                if not (message.is_error_frame or message.is_remote_frame):
                    frames.append((message.arbitration_id, bytes(message.data)))
                message = self._bus.recv(0.0)
        except (can.CanError, OSError) as error:
            msg = f"it broke: {error}"
            raise SourceError(msg) from error
        return frames

    def close(self) -> None:
        """Close the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None
