"""What every message has in common."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray


class Part(msgspec.Struct, frozen=True, kw_only=True):
    """Something that travels only inside a message."""


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """A message on the bus.

    `t_ns` is the time of measurement, UTC in Unix nanoseconds (leap seconds: schemas/gnss_time.py).
    Units stand in field names. New fields have defaults, so that old bytes still decode;
    unknown fields are ignored, so that a newer sender is understood.
    """

    t_ns: int


def require_columns(count: int, dtype: type[np.generic], **columns: NDArray[np.generic]) -> None:
    """Raise ValueError unless every column has shape (count,) and the dtype."""
    for name, column in columns.items():
        if column.shape != (count,) or column.dtype != np.dtype(dtype):
            msg = f"{name} must be {count} values of {np.dtype(dtype).name}, not shape {column.shape} of {column.dtype}"
            raise ValueError(msg)
