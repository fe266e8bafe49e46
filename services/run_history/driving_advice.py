"""A profile in words: where to accelerate to, hold, coast, brake."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

import numpy as np

from services.run_history.optimum import Optimum
from services.run_history.optimum_values import BRAKE, COAST, FULL, HOLD

What = Literal["accelerate", "hold", "coast", "brake"]
SHORT_M: Final = 60.0
"""Stretches shorter than this are told with their neighbours …"""
BRAKED_MPS: Final = 2.0 / 3.6
"""… but for brakings that take off this much: a driver must know of them, however short they are."""
STEADY_MPS2: Final = 0.05
"""A limit that is followed more steadily than this is held."""
KMH: Final = 3.6
WORDS: Final[dict[int, What]] = {FULL: "accelerate", HOLD: "hold", COAST: "coast", BRAKE: "brake"}


@dataclass(frozen=True, slots=True)
class Advice:
    """One stretch of a profile."""

    what: What
    from_axis_m: float
    until_axis_m: float
    from_kmh: float
    until_kmh: float
    from_s: float
    """Since departure."""
    until_s: float

    @property
    def length_m(self) -> float:
        """Of the stretch."""
        return abs(self.until_axis_m - self.from_axis_m)


def advice_of(profile: Optimum) -> list[Advice]:
    """Stretches of one control each, in order of running."""
    told = _told(profile)
    edges = [0, *(k for k in range(1, len(told)) if told[k] != told[k - 1]), len(told)]
    merged: list[tuple[int, int, int]] = []
    for first, past in pairwise(edges):
        if merged and (merged[-1][2] == told[first] or _slight(profile, first, past, told[first])):
            merged[-1] = (merged[-1][0], past, merged[-1][2])
        else:
            merged.append((first, past, told[first]))
    return [
        Advice(
            WORDS[control],
            float(profile.axis_m[first]),
            float(profile.axis_m[past]),
            KMH * float(profile.speed_mps[first]),
            KMH * float(profile.speed_mps[past]),
            float(profile.time_s[first]),
            float(profile.time_s[past]),
        )
        for first, past, control in merged
    ]


def _told(profile: Optimum) -> list[int]:
    """Control of each step as a driver sees it: a limit that is followed is held, accelerated or braked to."""
    step_m = abs(float(profile.axis_m[1] - profile.axis_m[0]))
    change = np.diff(profile.speed_mps**2) / (2.0 * step_m)
    seen = np.where(change > STEADY_MPS2, FULL, np.where(change < -STEADY_MPS2, BRAKE, HOLD))
    control = profile.control[:-1]
    return [int(one) for one in np.where(np.isin(control, list(WORDS)), control, seen)]


def _slight(profile: Optimum, first: int, past: int, control: int) -> bool:
    """Whether a stretch is told with the one before."""
    if control == BRAKE and profile.speed_mps[first] - profile.speed_mps[past] >= BRAKED_MPS:
        return False
    return abs(float(profile.axis_m[past] - profile.axis_m[first])) < SHORT_M


def advice_lines(profile: Optimum) -> list[str]:
    """The same as text, one line a stretch."""
    return [
        f"{one.from_axis_m / 1000:8.3f} km {one.from_s:5.0f} s  {one.what:<11}"
        f"{one.from_kmh:5.0f} -> {one.until_kmh:3.0f} km/h over {one.length_m:5.0f} m"
        for one in advice_of(profile)
    ]
