"""Folders in memory where the system has them: every step of these tests waits for the disk."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.unit.lte_bridge.records import QUICK_DISK


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(dir=QUICK_DISK) as name:
        yield Path(name)
