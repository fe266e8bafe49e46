"""What is said of the train's place on the line, and how far it is vouched for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from schemas.gnss import FixStatus
from services.gnss_correction.line_likelihood import SPEED, VAR_SPEED
from services.gnss_correction.line_windows import Window, tail_bound_m
from services.gnss_correction.solver_arrays import Records

MODE_REACH_M: Final = 40.0
"""The place is the mean of the cells this near to the likeliest."""
BOUND_FLOOR_M: Final = 5.0
"""No bound is smaller: what orbits, air and the axis itself leave."""
RISK: Final = 1e-3
"""Probability beyond the tail from which the bound is made."""
PASSAGE_RISK: Final = 1e-8
"""The same for being on another passage of the line altogether."""
PASSAGE_M: Final = 190.0
"""Cells further away belong to another passage."""
TAIL_FACTOR: Final = 2.6
"""From the tail to a bound: errors of satellites last, and the probabilities know it only in part."""
DOUBTFUL_LEVEL: Final = 0.33
"""Share of disagreement above which the place itself is doubted."""
DOUBT_STEP: Final = 0.1
"""Every so much more disagreement adds the tail to the bound once more."""
PLENTY: Final = 6
"""With fewer satellites than this to spare they cannot check each other, and the bound grows."""


@dataclass(frozen=True, slots=True)
class LineEstimate:
    """Where the train is on the line at one epoch, or why that is not known."""

    status: FixStatus
    reason: str
    axis_m: float = math.nan
    bound_m: float = math.nan
    """Error along the axis that is vouched for."""
    speed_mps: float = math.nan
    """Towards rising axis_m."""
    used: int = 0
    """Satellites."""
    level: float = math.nan
    """Disagreement of the satellites: 0 all agree, 1 none does."""
    sigma_m: float = math.nan


class Mode(NamedTuple):
    """The likeliest place of a window and what is around it."""

    cell: int
    axis_m: float
    sigma_m: float
    speed_mps: float
    speed_m2ps2: float


def mode_of(window: Window) -> Mode:
    """Mean near the likeliest cell, its standard deviation, and the speed there."""
    cell = int(np.argmax(window.mass))
    near = slice(max(cell - int(MODE_REACH_M), 0), cell + int(MODE_REACH_M) + 1)
    share = window.mass[near] / window.mass[near].sum()
    places, states = window.places_m[near], window.states[near]
    axis_m = float(share @ places)
    sigma_m = math.sqrt(max(float(share @ (places - axis_m) ** 2), 0.0))
    return Mode(cell, axis_m, sigma_m, float(share @ states[:, SPEED]), float(share @ states[:, VAR_SPEED]))


def bound_of(windows: Sequence[Window], axis_m: float, level: float, sights: Records) -> float:
    """Error along the axis that is vouched for at `axis_m`.

    The tail of the probability, widened where satellites disagree (`level`) or are few, and as far as
    other passages of the line as long as the train may be on one.
    """
    spare = len(sights) - len(np.unique(sights["system"])) - 1
    disagreement = max(0.0, level - DOUBTFUL_LEVEL) / DOUBT_STEP
    scarcity = max(1.0, PLENTY / max(spare, 1))
    tail_m = TAIL_FACTOR * (1.0 + disagreement) * scarcity * tail_bound_m(windows, axis_m, RISK)
    passage_m = tail_bound_m(windows, axis_m, PASSAGE_RISK)
    return BOUND_FLOOR_M + (max(tail_m, passage_m) if passage_m > PASSAGE_M else tail_m)
