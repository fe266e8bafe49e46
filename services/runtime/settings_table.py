"""The table of one service in a TOML file, for commands that work on files."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from services.runtime.told_command import UsageError


def settings_table(path: Path, service: str) -> dict[str, Any]:
    """What stands in the table of a service; empty where there is none. Raises UsageError, OSError."""
    try:
        table = tomllib.loads(path.read_text("utf-8")).get(service, {})
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        msg = f"{path}: {error}"
        raise UsageError(msg) from error
    if not isinstance(table, dict):
        msg = f"{path}: {service}: expected a table [{service}]"
        raise UsageError(msg)
    return table
