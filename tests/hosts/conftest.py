"""A train and a cloud as hosts of their own: network namespaces, and a link between them that can fail."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import suppress

import pytest

LINK = "link0"
NOWHERE = "02:00:00:00:00:99"
"""Ethernet address of nobody."""


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "hosts: needs network namespaces (iproute2, privileges)")


def tool(*arguments: str) -> str:
    done = subprocess.run(arguments, check=True, capture_output=True, text=True, timeout=10)
    return done.stdout


class Hosts:
    """Two hosts and the link between them."""

    def __init__(self) -> None:
        self.train, self.cloud = f"kirotei-bt{os.getpid()}", f"kirotei-bc{os.getpid()}"
        self.addresses = {self.train: "10.213.8.1", self.cloud: "10.213.8.2"}

    def make(self) -> None:
        tool("ip", "link", "add", LINK, "netns", self.train, "type", "veth", "peer", "name", LINK, "netns", self.cloud)
        for host, address in self.addresses.items():
            tool("ip", "-n", host, "address", "add", f"{address}/24", "dev", LINK)
            tool("ip", "-n", host, "link", "set", LINK, "up")
            tool("ip", "-n", host, "link", "set", "lo", "up")

    def limit(self, rate: str) -> None:
        """Slow the link down, both ways."""
        for host in self.addresses:
            tool(
                *("ip", "netns", "exec", host, "tc", "qdisc", "replace", "dev", LINK, "root"),
                *("tbf", "rate", rate, "burst", "32kb", "latency", "300ms"),
            )

    def cut(self) -> None:
        """Pull the plug: both ends see it."""
        tool("ip", "-n", self.train, "link", "set", LINK, "down")

    def mend(self) -> None:
        tool("ip", "-n", self.train, "link", "set", LINK, "up")

    def swallow(self) -> None:
        """A black hole: everything sent is lost, and nobody is told."""
        for host in self.addresses:
            tool(
                "ip",
                "-n",
                host,
                "neighbour",
                "replace",
                self._peer(host),
                "lladdr",
                NOWHERE,
                "nud",
                "permanent",
                "dev",
                LINK,
            )

    def give_back(self) -> None:
        for host in self.addresses:
            tool("ip", "-n", host, "neighbour", "delete", self._peer(host), "dev", LINK)

    def _peer(self, host: str) -> str:
        return next(address for other, address in self.addresses.items() if other != host)


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    """Two hosts, taken down whatever happens."""
    for name in ("ip", "tc"):
        if shutil.which(name) is None:
            pytest.skip(f"network namespaces need iproute2: there is no {name}")
    made = Hosts()
    try:
        for host in made.addresses:
            try:
                tool("ip", "netns", "add", host)
            except subprocess.CalledProcessError as error:
                pytest.skip(f"network namespaces need privileges: {error.stderr.strip()}")
        try:
            made.make()
            made.limit("100mbit")
        except subprocess.CalledProcessError as error:
            pytest.skip(f"this kernel makes no such link: {error.stderr.strip()}")
        yield made
    finally:
        for host in made.addresses:
            with suppress(subprocess.CalledProcessError):
                tool("ip", "netns", "delete", host)
