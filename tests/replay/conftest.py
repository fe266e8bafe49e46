"""What several replays stand on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from services.runtime.manual_loop import manual_loop
from tests.replay.bridge_world import World


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    """A train's bus and a cloud's, joined by an uplink."""
    with manual_loop() as loop:
        yield World(loop, tmp_path)
