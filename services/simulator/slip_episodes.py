"""Episodes of low adhesion as rows of numbers, for the kernel: drawn at random, or set by time or place."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.simulator.motion_settings import Adhesion, SlipKind

Floats = NDArray[np.float64]

KINDS: Final[tuple[SlipKind, ...]] = ("cycling", "controlled", "locked", "creeping", "micro", "breaking_away")
CYCLING: Final = 0
CONTROLLED: Final = 1
LOCKED: Final = 2
CREEPING: Final = 3
MICRO: Final = 4
BREAKING_AWAY: Final = 5
AT_RANDOM: Final = 0
AT_TIME: Final = 1
AT_PLACE: Final = 2
RANDOM_ROWS: Final = 509
"""Rows drawn at random; then they come round again."""
SHORTEST_S, LONGEST_S = 2.5, 15.0


class EpisodeRow(NamedTuple):
    """One row; every entry a float, as the kernel's table holds it."""

    trigger: float
    start: float
    """Gap since the last one [s], time [s] or place along the table [m]."""
    sign: float
    """-1 slide, +1 spin, 0 whichever effort there is."""
    kind: float
    duration_s: float
    adhesion: float
    slip: float
    ramp_in_s: float
    ramp_out_s: float
    share: float
    """Of the train's wheels that lack adhesion."""
    reach_mps2: float
    """Fastest that the wheel changes speed."""
    threshold: float
    """Slip at which slide protection steps in, as a share of speed."""
    build_up_s: float = 0.0
    micro_mps: float = 0.0
    """A wheel that breaks away: its micro-slip before that grows to so much in so long,"""
    rise_mps2: float = 0.0
    fall_mps2: float = 0.0
    """then the slip speed rises and falls by so much,"""
    swing: float = 0.0
    swing_hz: float = 0.0
    """in between it falls by this share of itself and recovers, again and again;"""
    tail_mps: float = 0.0
    tail_s: float = 0.0
    """what is left in the end fades out."""


UNLIKE: Final = (0.0,) * 8
"""The last entries of what does not break away."""


def _breakaway(rail: Adhesion, generator: np.random.Generator) -> tuple[float, ...]:
    """The entries from `build_up_s` on, of a wheel that breaks away."""
    return (
        float(generator.uniform(0.3, 2.5)) * rail.build_up,
        float(generator.uniform(0.05, 0.35)) * rail.build_up_speed,
        float(generator.uniform(0.5, 2.5)),
        float(generator.uniform(1.0, 2.5)),
        float(generator.uniform(0.25, 0.5)),
        float(generator.uniform(0.6, 0.9)),
        float(generator.uniform(0.05, 0.2)) * rail.build_up_speed,
        float(generator.uniform(0.3, 1.5)) * rail.build_up,
    )


def _drawn(
    kind: SlipKind,
    duration_s: float,
    adhesion: float,
    slip: float,
    rail: Adhesion,
    generator: np.random.Generator,
) -> tuple[float, ...]:
    """The entries from `kind` on."""
    slow = kind in ("controlled", "creeping", "micro")
    return (
        float(KINDS.index(kind)),
        duration_s,
        adhesion,
        slip,
        float(generator.uniform(0.6, 3.5) if slow else generator.uniform(0.1, 0.6)),
        float(generator.uniform(0.5, 2.5) if slow else generator.uniform(0.2, 1.0)),
        float(generator.uniform(0.2, 1.0)),
        float(generator.uniform(2.0, 12.0)),
        float(generator.uniform(0.06, 0.25)),
        *(_breakaway(rail, generator) if kind == "breaking_away" else UNLIKE),
    )


def random_rows(adhesion: Adhesion, generator: np.random.Generator) -> Floats:
    """Rows of random slips, shape (RANDOM_ROWS, entries of EpisodeRow); empty when none are wanted."""
    if adhesion.random_gap_s is None:
        return np.zeros((0, len(EpisodeRow._fields)))
    kinds = tuple(adhesion.weights)
    weights = np.array([adhesion.weights[kind] for kind in kinds])
    rows = []
    for _ in range(RANDOM_ROWS):
        gap = adhesion.shortest_gap_s + generator.exponential(max(adhesion.random_gap_s - adhesion.shortest_gap_s, 0.1))
        sign = -1.0 if generator.uniform() < adhesion.slide_share else 1.0
        kind = kinds[int(generator.choice(len(kinds), p=weights / weights.sum()))]
        usual = adhesion.duration_median_s * float(np.exp(adhesion.duration_sigma * generator.standard_normal()))
        duration = float(np.clip(usual, SHORTEST_S, LONGEST_S))
        low = float(generator.uniform(0.15, 0.5) if kind == "locked" else generator.uniform(0.3, 0.9))
        slip = {
            "creeping": float(generator.uniform(0.02, 0.12)),
            "micro": float(generator.uniform(0.006, 0.025)),
        }.get(kind, float(generator.uniform(0.05, 0.35)))
        if kind == "micro":
            duration *= 2.5
        rows.append((float(AT_RANDOM), gap, sign, *_drawn(kind, duration, low, slip, adhesion, generator)))
    return np.array(rows)


def set_rows(adhesion: Adhesion, place_of: dict[float, float], generator: np.random.Generator) -> Floats:
    """Rows of episodes by time or place, shape (k, entries); `place_of` gives the way along the table for each axis_m.

    An episode at a place that the train does not pass is left out.
    """
    rows: list[tuple[float, ...]] = []
    for one in adhesion.episodes:
        drawn = _drawn(one.kind, one.duration_s, one.adhesion, one.slip, adhesion, generator)
        if one.at_s is not None:
            rows.append((float(AT_TIME), one.at_s, 0.0, *drawn))
        elif one.at_axis_m is not None and one.at_axis_m in place_of:
            rows.append((float(AT_PLACE), place_of[one.at_axis_m], 0.0, *drawn))
    return np.array(rows).reshape(len(rows), len(EpisodeRow._fields))
