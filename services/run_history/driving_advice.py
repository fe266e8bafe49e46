"""A profile in words: where to accelerate to, hold, coast, brake."""

from __future__ import annotations

from dataclasses import dataclass

from services.run_history.optimum import Optimum
from services.run_history.optimum_values import CONTROLS

SHORT_M = 60.0
"""Stretches shorter than this are told with their neighbours."""
KMH = 3.6


@dataclass(frozen=True, slots=True)
class Advice:
    """One stretch of a profile."""

    what: str
    from_axis_m: float
    until_axis_m: float
    from_kmh: float
    until_kmh: float


def advice_of(profile: Optimum) -> list[Advice]:
    """Stretches of one control each, in order of running."""
    n = len(profile.axis_m)
    edges = [0, *(k for k in range(1, n - 1) if profile.control[k] != profile.control[k - 1]), n - 1]
    length = abs(float(profile.axis_m[1] - profile.axis_m[0]))
    parts = [(edges[i], edges[i + 1]) for i in range(len(edges) - 1)]
    merged: list[tuple[int, int, int]] = []
    for first, past in parts:
        control = int(profile.control[first])
        if merged and (merged[-1][2] == control or (past - first) * length < SHORT_M):
            merged[-1] = (merged[-1][0], past, merged[-1][2])
        else:
            merged.append((first, past, control))
    return [
        Advice(
            _word(profile, first, past, control),
            float(profile.axis_m[first]),
            float(profile.axis_m[past]),
            KMH * float(profile.speed_mps[first]),
            KMH * float(profile.speed_mps[past]),
        )
        for first, past, control in merged
    ]


def _word(profile: Optimum, first: int, past: int, control: int) -> str:
    """The control's name; a limit that is followed downwards is braking, one that is kept is holding."""
    if CONTROLS[control] != "follow the limit":
        return CONTROLS[control]
    change = float(profile.speed_mps[past] - profile.speed_mps[first])
    return "hold" if abs(change) < 1.0 else ("accelerate" if change > 0.0 else "brake")


def advice_lines(profile: Optimum, chainage_m: dict[float, float] | None = None) -> list[str]:
    """The same as text, one line a stretch."""
    shown = chainage_m or {}
    return [
        f"{shown.get(one.from_axis_m, one.from_axis_m) / 1000:8.3f} km  {one.what:<11}"
        f"{one.from_kmh:5.0f} -> {one.until_kmh:3.0f} km/h over {abs(one.until_axis_m - one.from_axis_m):5.0f} m"
        for one in advice_of(profile)
    ]
