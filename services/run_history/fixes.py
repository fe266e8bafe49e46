"""Fixes of one run, as whatever log gave them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RunLog:
    """One run. All arrays have shape (n,), times rise."""

    run_id: str
    t_unix_s: Floats
    lat_deg: Floats
    lon_deg: Floats
    speed_mps: Floats
    """NaN where the log has none."""
    left_out: int = 0
    """Rows that could not be used: not finite, out of range, out of order, repeated."""


def run_log(run_id: str, t_unix_s: Floats, lat_deg: Floats, lon_deg: Floats, speed_mps: Floats) -> RunLog:
    """A run of rows in order of time; rows without time, rows that do not rise and impossible places are left out."""
    usable = np.isfinite(t_unix_s) & (np.abs(lat_deg) <= 90.0) & (np.abs(lon_deg) <= 360.0)  # noqa: PLR2004 - degrees
    order = np.flatnonzero(usable)
    order = order[np.argsort(t_unix_s[order], kind="stable")]
    t = t_unix_s[order]
    rising = np.concatenate((np.ones(min(1, len(t)), bool), np.diff(t) > 0.0))
    order = order[rising]
    t, lat, lon, speed = (np.ascontiguousarray(one[order]) for one in (t_unix_s, lat_deg, lon_deg, speed_mps))
    return RunLog(run_id, t, lat, lon, speed, len(t_unix_s) - len(order))
