"""A train and a cloud as hosts of their own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from benchmarks.two_hosts import Hosts, NoHostsError, two_hosts


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "hosts: needs network namespaces (iproute2, privileges)")


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    """Two hosts, taken down whatever happens."""
    with ExitStack() as stack:
        try:
            made = stack.enter_context(two_hosts())
        except NoHostsError as error:
            pytest.skip(str(error))
        yield made
