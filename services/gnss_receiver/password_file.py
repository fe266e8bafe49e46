"""Passwords: from a file or from the environment, never from a configuration."""

from __future__ import annotations

import os
from pathlib import Path


def read_password(file: str, variable: str) -> str:
    """Password in a file, or in a variable of the environment; empty when neither is named.

    Raises OSError or ValueError, which name the place but never what stands there.
    """
    if file:
        return Path(file).read_text("utf-8").strip()
    if not variable:
        return ""
    if variable not in os.environ:
        msg = f"the variable {variable} of the environment, which should hold the password, is not set"
        raise ValueError(msg)
    return os.environ[variable]
