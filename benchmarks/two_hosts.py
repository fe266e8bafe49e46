"""A train and a cloud as hosts of their own: network namespaces, and a link between them that can fail."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress

LINK = "link0"
NOWHERE = "02:00:00:00:00:99"
"""Ethernet address of nobody."""


class NoHostsError(RuntimeError):
    """This machine lets nobody make such hosts."""


class Hosts:
    """Two hosts and the link between them."""

    def __init__(self) -> None:
        """Name them after this process."""
        self.train, self.cloud = f"kirotei-bt{os.getpid()}", f"kirotei-bc{os.getpid()}"
        self.addresses = {self.train: "10.213.8.1", self.cloud: "10.213.8.2"}

    def make(self) -> None:
        """Make the link, of 100 Mbit/s. Raises CalledProcessError."""
        _tool("ip", "link", "add", LINK, "netns", self.train, "type", "veth", "peer", "name", LINK, "netns", self.cloud)
        for host, address in self.addresses.items():
            _tool("ip", "-n", host, "address", "add", f"{address}/24", "dev", LINK)
            _tool("ip", "-n", host, "link", "set", LINK, "up")
            _tool("ip", "-n", host, "link", "set", "lo", "up")
        self.limit("100mbit")

    def limit(self, rate: str) -> None:
        """Slow the link down, both ways."""
        for host in self.addresses:
            _tool(
                *("ip", "netns", "exec", host, "tc", "qdisc", "replace", "dev", LINK, "root"),
                *("tbf", "rate", rate, "burst", "32kb", "latency", "300ms"),
            )

    def cut(self) -> None:
        """Pull the plug: both ends see it."""
        _tool("ip", "-n", self.train, "link", "set", LINK, "down")

    def mend(self) -> None:
        """Put the plug in again."""
        _tool("ip", "-n", self.train, "link", "set", LINK, "up")

    def swallow(self) -> None:
        """Make a black hole of the link: everything sent is lost, and nobody is told."""
        for host in self.addresses:
            _tool(
                *("ip", "-n", host, "neighbour", "replace", self._peer(host)),
                *("lladdr", NOWHERE, "nud", "permanent", "dev", LINK),
            )

    def give_back(self) -> None:
        """Let the black hole be a link again."""
        for host in self.addresses:
            _tool("ip", "-n", host, "neighbour", "delete", self._peer(host), "dev", LINK)

    def _peer(self, host: str) -> str:
        return next(address for other, address in self.addresses.items() if other != host)


@contextmanager
def two_hosts() -> Iterator[Hosts]:
    """Two hosts, taken down whatever happens. Raises NoHostsError."""
    for name in ("ip", "tc"):
        if shutil.which(name) is None:
            msg = f"network namespaces need iproute2: there is no {name}"
            raise NoHostsError(msg)
    made = Hosts()
    try:
        try:
            for host in made.addresses:
                _tool("ip", "netns", "add", host)
            made.make()
        except subprocess.CalledProcessError as error:
            msg = f"network namespaces need privileges and a kernel with veth and tbf: {error.stderr.strip()}"
            raise NoHostsError(msg) from error
        yield made
    finally:
        for host in made.addresses:
            with suppress(subprocess.CalledProcessError):
                _tool("ip", "netns", "delete", host)


def _tool(*arguments: str) -> None:
    subprocess.run(arguments, check=True, capture_output=True, text=True, timeout=10)
