"""Way of a wheel's rim from a pulse counter that may wrap, begin anew, or run backwards."""

from __future__ import annotations

from typing import Final

import numpy as np

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import Counts, Floats
from services.odometry_fusion.tick_layout import Records

FASTEST_MPS: Final = 130.0
"""No rim turns faster, spinning included."""
HARDEST_MPS2: Final = 15.0
"""A locking wheel does not lose speed faster; more is no motion."""
SMOOTHING_S: Final = 0.3

COUNTER: Final = np.dtype([
    ("started", np.int64),
    ("raw", np.int64),
    ("t_ns", np.int64),
    ("resets", np.int64),
    ("way_m", np.float64),
    ("speed_mps", np.float64),
])  # fmt: skip
"""What is remembered of the last count: its value and time, the way so far, the smoothed speed."""


@kernel
def _is_motion(move_m: float, dt_s: float, speed_mps: float, pulse_m: float) -> bool:
    """Whether a change of way can be a motion: not too fast, and not backwards out of full run."""
    rate_mps = move_m / dt_s
    if abs(rate_mps) > FASTEST_MPS:
        return False
    return move_m >= 0.0 or rate_mps >= speed_mps - HARDEST_MPS2 * dt_s - 3.0 * pulse_m / dt_s - 1.0


@kernel
def _unwrapped(step: int, dt_s: float, speed_mps: float, pulse_m: float) -> int:
    """The step across a counter's end of 16, 24 or 32 bits, or 0 where none is at hand."""
    for bits in (16, 24, 32):
        candidate = step + (1 << bits) if step < 0 else step - (1 << bits)
        if abs(candidate * pulse_m / dt_s - speed_mps) <= 5.0 + 3.0 * dt_s:
            return candidate
    return 0


@kernel
def count_way(t_ns: Counts, pulses: Counts, pulse_m: float, counter: Records, way_m: Floats, doubt_m: Floats) -> None:
    """Way at each count, and in `doubt_m` by how much it may be wrong because the counter began anew there.

    Times rise. Over a step that is no motion the last speed is kept, and half a second more of doubt is stated
    than the motion could have changed it.
    """
    now = counter[0]
    for k in range(len(t_ns)):
        doubt_m[k] = 0.0
        if now.started == 0:
            now.started = 1
        else:
            dt_s = (t_ns[k] - now.t_ns) * 1e-9
            step = pulses[k] - now.raw
            move_m = step * pulse_m
            if not _is_motion(move_m, dt_s, now.speed_mps, pulse_m):
                move_m = _unwrapped(step, dt_s, now.speed_mps, pulse_m) * pulse_m
                if move_m == 0.0:
                    move_m = now.speed_mps * dt_s
                    now.resets += 1
                    doubt_m[k] = 0.5 * 1.5 * (dt_s + 0.5) ** 2 + 2.0 * pulse_m
            now.way_m += move_m
            now.speed_mps += (move_m / dt_s - now.speed_mps) * min(1.0, dt_s / SMOOTHING_S)
        now.raw, now.t_ns = pulses[k], t_ns[k]
        way_m[k] = now.way_m
