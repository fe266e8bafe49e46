"""What a service tells whoever started it: ready, alive, stopping (systemd's sd_notify protocol).

A datagram of `NAME=value` lines to the socket named by NOTIFY_SOCKET (sd_notify(3)).
Telling is a courtesy: it never raises and never waits.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping


class Notifier:
    """Speaks to NOTIFY_SOCKET, or to nobody when there is none."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        """Take address and watchdog time from the environment; malformed ones count as absent."""
        address = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        self.watchdog_s = _watchdog_s(environment)
        """Signs of life are expected at least this often [s]; None when nobody asks."""
        if self._address:
            try:
                self._socket = socket.socket(
                    socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK
                )
            except OSError:
                self._socket = None

    def ready(self) -> None:
        """Start-up is over."""
        self._tell("READY=1")

    def status(self, text: str) -> None:
        """One line for `systemctl status`."""
        self._tell(f"STATUS={' '.join(text.split())}")

    def watchdog(self) -> None:
        """A sign of life."""
        self._tell("WATCHDOG=1")

    def stopping(self) -> None:
        """The service is ending on purpose."""
        self._tell("STOPPING=1")

    def failed(self, error: int) -> None:
        """The service is about to end because of this (errno.EINVAL: its configuration)."""
        self._tell(f"ERRNO={error}")

    def close(self) -> None:
        """Say nothing any more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _tell(self, line: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(line.encode(), self._address)
        except (OSError, ValueError):
            return  # nobody listens, or the listener's queue is full: nothing that the service could do


def _watchdog_s(environment: Mapping[str, str]) -> float | None:
    """Watchdog time [s] if one is asked of this process."""
    pid = environment.get("WATCHDOG_PID", "")
    if pid and pid != str(os.getpid()):
        return None
    try:
        microseconds = int(environment.get("WATCHDOG_USEC", ""))
    except ValueError:
        return None
    return microseconds / 1e6 if microseconds > 0 else None
