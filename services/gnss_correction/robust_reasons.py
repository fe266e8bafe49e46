"""In words what is special about an epoch of the robust filter."""

from __future__ import annotations

import numpy as np

from services.gnss_correction.rejection import Outcome
from services.gnss_correction.solver_arrays import Records


def robust_reason(epoch: np.void, left_out: str) -> str:
    """Reason of one epoch (dtype ROBUST_SOLUTION) that has a place; empty when all is well.

    `left_out` says what was wrong with its satellites.
    """
    reasons = []
    undetermined_s = float(epoch["undetermined_s"])
    if epoch["outcome"] == Outcome.PREDICTED:
        why = f" ({left_out})" if left_out else ""
        reasons.append(f"predicted: {int(epoch['used'])} usable satellites, too few for {undetermined_s:.1f} s{why}")
    elif undetermined_s > 0.0:
        reasons.append(f"{int(epoch['used'])} satellites and the motion of {undetermined_s:.1f} s before")
    if epoch["moved_m"] > 0.0:
        reasons.append(f"common offset: all pseudoranges moved by {epoch['moved_m']:.0f} m against Doppler")
    if epoch["clock_step_m"] != 0.0:
        reasons.append(f"common offset: receiver clock stepped by {epoch['clock_step_m']:+.0f} m, no whole millisecond")
    return "; ".join(reasons)


def remarkable(epochs: Records) -> list[int]:
    """Epochs with a place of which something is to be said."""
    placed = np.isfinite(epochs["lat_rad"])
    special = (epochs["outcome"] != Outcome.FIX) | (epochs["undetermined_s"] > 0.0)
    special |= (epochs["moved_m"] > 0.0) | (epochs["clock_step_m"] != 0.0)
    found: list[int] = np.flatnonzero(placed & special).tolist()
    return found
