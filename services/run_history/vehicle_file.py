"""vehicle.toml, with clear words for what is wrong in it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import msgspec

from services.run_history.vehicle import Vehicle


class VehicleFileError(ValueError):
    """A vehicle file that cannot be used: path and why."""


def read_vehicle(path: Path) -> Vehicle:
    """Vehicle of a file. Raises VehicleFileError, OSError."""
    try:
        table = tomllib.loads(path.read_text("utf-8"))
        return msgspec.convert(table, Vehicle)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, msgspec.ValidationError) as error:
        msg = f"{path}: {error}"
        raise VehicleFileError(msg) from error
