"""A router on a free port, and nodes on it that are closed whatever a test does."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Iterator

import pytest

from services.runtime.host_config import RouterConfig
from services.runtime.router import Router, open_router
from tests.wire.ports import free_port
from tests.wire.stage import Stage


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def router(endpoint: str) -> Iterator[Router]:
    with open_router(RouterConfig(listen=(endpoint,))) as running:
        yield running


@pytest.fixture
async def stage(endpoint: str) -> AsyncIterator[Stage]:
    before = set(threading.enumerate())
    stage = Stage(endpoint)
    try:
        yield stage
    finally:
        await stage.close()
    await asyncio.get_running_loop().shutdown_default_executor()
    for thread in set(threading.enumerate()) - before:
        # A session that closes on a stuck link takes Zenoh's five seconds.
        thread.join(8.0)
        assert not thread.is_alive(), f"thread left behind: {thread.name}"
