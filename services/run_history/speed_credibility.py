"""Speeds that cannot be: held zeros after a departure, zeros in full run, frozen values, spikes.

Phones hold the speed at zero for ten seconds and more after a departure, and then jump to the true one; they
drop to zero in mid-run; some receivers repeat one value for minutes. Such speeds are left out (NaN), with the
reason counted, and the smoother bridges them by places and by what was measured around them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.run_history.middle import median_of

Floats = NDArray[np.float64]
ZERO_MPS: Final = 0.1
STRONGEST_MPS2: Final = 1.5
"""No train starts harder; a jump from zero beyond this was a zero that was held."""
HARDEST_MPS2: Final = 2.5
"""Nor brakes harder; a drop to zero beyond this is no stop."""
JUMP_MPS: Final = 1.8
DROP_MPS: Final = 5.5
"""Slower, many receivers fall to zero at once as the train stops."""
REGAINED_SHARE: Final = 0.7
SLOPE_S: Final = 5.0
"""After a jump the acceleration is taken from so long."""
MOST_HELD_S: Final = 30.0
FROZEN_S: Final = 8.0
"""The same speed to the last digit for so long while moving is no measurement, unless places go on just so."""
STEADY_M: Final = 6.0
STEADY_SHARE: Final = 0.01
"""Places may leave a steady advance by this, and by this share of the way: speeds are told in steps."""
SPIKE_MPS: Final = 3.0


@dataclass(frozen=True, slots=True)
class Credible:
    """Speeds without what cannot be."""

    speed_mps: Floats
    """NaN where a speed was left out; shape (n,)."""
    held: int
    dropped: int
    frozen: int
    spikes: int


def credible_speeds(t_s: Floats, speed_mps: Floats, fastest_mps: float, place_m: Floats | None = None) -> Credible:
    """Speeds that can be, without sign; `fastest_mps` is what the train cannot exceed. Times rise. Shapes (n,).

    `place_m`, where known, tells a speed that is held steady from one that is frozen.
    """
    speed = np.where((speed_mps >= 0.0) & (speed_mps <= fastest_mps), speed_mps, np.nan)
    spikes = int(np.sum(np.isfinite(speed_mps) & ~np.isfinite(speed)))
    frozen = _leave_out_frozen(t_s, speed, place_m)
    dropped = _leave_out_drops(t_s, speed)
    held = _leave_out_held(t_s, speed)
    spikes += _leave_out_spikes(t_s, speed)
    return Credible(speed, held, dropped, frozen, spikes)


def _leave_out_frozen(t_s: Floats, speed: Floats, place_m: Floats | None) -> int:
    changed = np.concatenate(([True], speed[1:] != speed[:-1], [True]))
    edges = np.flatnonzero(changed)
    first, past = edges[:-1], edges[1:]
    # Two that are alike are a repetition and no run of them.
    alike = (past - first > 2) & (speed[first] > ZERO_MPS) & (t_s[past - 1] - t_s[first] >= FROZEN_S)  # noqa: PLR2004
    count = 0
    for k in np.flatnonzero(alike):
        part = slice(first[k], past[k])
        if place_m is None or not _advances(t_s[part], place_m[part], float(speed[first[k]])):
            speed[first[k] + 1 : past[k]] = np.nan
            count += int(past[k] - first[k] - 1)
    return count


def _advances(t_s: Floats, place_m: Floats, speed_mps: float) -> bool:
    """Whether places go on at a steady speed from the first to the last fix: a driver or a control holds it."""
    known = np.isfinite(place_m)
    if known.sum() < 3:  # noqa: PLR2004 - two ends and something between
        return False
    t, place = t_s[known], place_m[known]
    onward = np.sign(place[-1] - place[0])
    off_m = onward * place - speed_mps * t
    allowed_m = STEADY_M + STEADY_SHARE * speed_mps * (t[-1] - t[0])
    return bool(np.percentile(np.abs(off_m - median_of(off_m)), 90.0) <= allowed_m)


def _leave_out_drops(t_s: Floats, speed: Floats) -> int:
    """What follows a fall to zero that no brake can do, until most of the speed is back."""
    known = np.flatnonzero(np.isfinite(speed))
    if not np.any((speed[known[1:]] <= ZERO_MPS) & (speed[known[:-1]] > DROP_MPS)):
        return 0
    dropped = []
    last_s = last_mps = lost = 0.0
    begun = False
    for i, (now_s, now_mps) in enumerate(zip(t_s.tolist(), speed.tolist(), strict=True)):
        if now_mps != now_mps:  # noqa: PLR0124 - NaN; the quickest way to ask in a long loop
            continue
        if lost > 0.0 and (now_mps > REGAINED_SHARE * lost or now_s - last_s > MOST_HELD_S):
            lost = 0.0
        if lost == 0.0 and begun and now_mps <= ZERO_MPS and last_mps > DROP_MPS:
            lost = last_mps if last_mps > HARDEST_MPS2 * (now_s - last_s) else 0.0
        if lost > 0.0:
            dropped.append(i)
        else:
            last_s, last_mps, begun = now_s, now_mps, True
    speed[dropped] = np.nan
    return len(dropped)


def _leave_out_held(t_s: Floats, speed: Floats) -> int:
    """Zeros that were held after a departure, found by the jump that ends them."""
    known = np.flatnonzero(np.isfinite(speed))
    before, after = known[:-1], known[1:]
    least = np.maximum(JUMP_MPS, STRONGEST_MPS2 * (t_s[after] - t_s[before]))
    count = 0
    for jumped in after[(speed[before] <= ZERO_MPS) & (speed[after] >= least)]:
        jump = speed[jumped]
        window = (t_s >= t_s[jumped]) & (t_s <= t_s[jumped] + SLOPE_S) & np.isfinite(speed)
        if window.sum() < 3:  # noqa: PLR2004 - a slope needs three
            continue
        slope = float(np.polyfit(t_s[window] - t_s[jumped], speed[window], 1)[0])
        began_s = t_s[jumped] - min(jump / float(np.clip(slope, 0.15, STRONGEST_MPS2)), MOST_HELD_S)
        held = (t_s > began_s) & (t_s < t_s[jumped]) & (speed <= ZERO_MPS)
        speed[held] = np.nan
        count += int(held.sum())
    return count


def _leave_out_spikes(t_s: Floats, speed: Floats) -> int:
    """Single values far from both neighbours, which agree with each other."""
    known = np.flatnonzero(np.isfinite(speed))
    if len(known) < 3:  # noqa: PLR2004 - a neighbour on either side
        return 0
    v, t = speed[known], t_s[known]
    expected = v[:-2] + (v[2:] - v[:-2]) * (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    off = np.abs(v[1:-1] - expected) > SPIKE_MPS + STRONGEST_MPS2 * (t[2:] - t[:-2]) / 2.0
    wild = known[1:-1][off]
    speed[wild] = np.nan
    return len(wild)
