"""Files that people write or keep and whose form is a contract, by the name under which `kirotei schema` shows them."""

from __future__ import annotations

from typing import Any, Final

import msgspec

from schemas.line import LandmarkDatabase, Line
from schemas.thresholds import Thresholds
from schemas.track_circuit import CoefficientStore

FILES: Final[dict[str, type[msgspec.Struct]]] = {
    "landmarks": LandmarkDatabase,
    "line": Line,
    "thresholds": Thresholds,
    "track_circuit_coefficients": CoefficientStore,
}


def file_schema(name: str) -> dict[str, Any] | None:
    """JSON schema of a kind of file; None when there is no such kind."""
    return msgspec.json.schema(FILES[name]) if name in FILES else None
