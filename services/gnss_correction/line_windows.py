"""Where on the line the train may be: probability in cells of one metre, kept only where there is some.

A window is a stretch of cells that moves with the train, so that probability is not smeared by
being put from cell to cell; every hypothesis (another passage of the line nearby, another direction
of running) is a window of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.gnss_correction.line_likelihood import COVARIANCE, SPEED, VAR_CLOCK, VAR_DRIFT, VAR_SPEED, no_states
from services.gnss_correction.solver_arrays import Float64s
from services.numerics.kernel import kernel

CELL_M: Final = 1.0
LEAST_MASS: Final = 1e-10
"""Cells with less probability than this share of the best cell's are let go."""
WIDEST_GAP: Final = 25
"""So many empty cells part a window into two."""
LONGEST_WINDOW: Final = 400
"""A longer one is cut, because its cells may move differently."""
MOST_WINDOWS: Final = 400
SAME_SPEED_MPS: Final = 2.0
"""Overlapping windows whose speeds differ by less are one."""
OVERHANG_M: Final = 30.0
"""The axis goes on straight this far beyond its ends."""


@dataclass(slots=True)
class Window:
    """Consecutive cells; cell i stands at `start_m + i` along the axis."""

    start_m: float
    mass: Float64s
    """Shape (n,): probability of each cell."""
    states: Float64s
    """Shape (n, STATES)."""

    @property
    def places_m(self) -> Float64s:
        """Places of the cells along the axis."""
        return np.asarray(self.start_m + CELL_M * np.arange(len(self.mass)))

    @property
    def total(self) -> float:
        """Probability of the whole window."""
        return float(self.mass.sum())

    @property
    def speed_mps(self) -> float:
        """Mean speed along the axis."""
        return float(self.mass @ self.states[:, SPEED]) / max(self.total, 1e-300)


@kernel
def _carry(
    mass: Float64s, states: Float64s, shift: Float64s, pad: int, mass_out: Float64s, states_out: Float64s
) -> None:
    """Carry every cell `shift` cells on into zeroed arrays that are `pad` cells longer at both ends."""
    for i in range(mass.size):
        to = i + pad + shift[i]
        first = int(np.floor(to))
        share = to - first
        for k in range(2):
            j = min(max(first + k, 0), mass_out.size - 1)
            part = (mass[i] + 1e-200) * (share if k == 1 else 1.0 - share)
            mass_out[j] += part
            states_out[j] += part * states[i]
    for j in range(mass_out.size):
        if mass_out[j] > 0.0:
            states_out[j] /= mass_out[j]


@kernel
def _fill(mass: Float64s, states: Float64s) -> None:
    """Give cells that were reached by none the state of the nearest before them, or of the first after."""
    first = 0
    while first < mass.size - 1 and not mass[first] > 0.0:
        first += 1
    for j in range(first):
        states[j] = states[first]
    for j in range(first + 1, mass.size):
        if not mass[j] > 0.0:
            states[j] = states[j - 1]


def _spread(mass: Float64s, variance: float) -> Float64s:
    """Probability diffused by a variance in cells², exactly so for small ones."""
    if variance <= 0.5:  # noqa: PLR2004 - three points can hold no more
        weights = np.array([variance / 2.0, 1.0 - variance, variance / 2.0])
    else:
        reach = math.ceil(4.0 * math.sqrt(variance))
        weights = np.exp(-0.5 * np.arange(-reach, reach + 1) ** 2 / variance)
        weights /= weights.sum()
    return np.convolve(mass, weights, mode="same") if len(mass) >= len(weights) else mass


def move(window: Window, dt_s: float, acceleration_mps: float, drift_step_mps: float, clock_step_m: float) -> Window:
    """Window after `dt_s`: every cell goes on at its speed, and everything becomes less certain.

    `acceleration_mps` is by how much the speed may have changed (one standard deviation),
    likewise the receiver's clock drift and, beyond it, its clocks.
    """
    speeds = window.states[:, SPEED]
    middle = window.speed_mps
    sigma2 = float(window.mass @ window.states[:, VAR_SPEED]) / max(window.total, 1e-300)
    variance = (sigma2 * dt_s * max(dt_s, 1.0) + (0.5 * acceleration_mps * dt_s) ** 2 + 0.0025 * dt_s) / CELL_M**2
    shift = np.clip((speeds - middle) * dt_s / CELL_M, -100.0, 100.0)
    pad = math.ceil(4.0 * math.sqrt(variance) + float(np.abs(shift).max())) + 1
    mass, states = np.zeros(len(speeds) + 2 * pad), np.zeros((len(speeds) + 2 * pad, window.states.shape[1]))
    _carry(window.mass, window.states, shift, pad, mass, states)
    _fill(mass, states)
    drifts = states[:, 1].copy()
    states[:, 5:VAR_CLOCK] += drifts[:, None] * dt_s
    states[:, VAR_CLOCK:] += (states[:, VAR_DRIFT] * dt_s * dt_s)[:, None] + clock_step_m**2 + max(variance - 1.0, 0.0)
    states[:, VAR_SPEED] += acceleration_mps**2
    states[:, VAR_DRIFT] += drift_step_mps**2
    return Window(window.start_m + middle * dt_s - pad * CELL_M, _spread(mass, variance), states)


def leap(window: Window, distance_m: float, speed_mps: float, speed_m2ps2: float, variance_m2: float) -> Window:
    """Window after a time without measurements, moved by a distance that has a variance of its own."""
    variance = variance_m2 / CELL_M**2
    pad = math.ceil(4.0 * math.sqrt(variance)) + 1
    mass = _spread(np.pad(window.mass, pad), variance)
    states = np.pad(window.states, ((pad, pad), (0, 0)), mode="edge")
    states[:, SPEED], states[:, VAR_SPEED], states[:, COVARIANCE] = speed_mps, speed_m2ps2, 0.0
    states[:, VAR_DRIFT:] = no_states(1)[0, VAR_DRIFT:]
    return Window(window.start_m + distance_m - pad * CELL_M, mass, states)


def tidy(windows: Iterable[Window], length_m: float) -> list[Window]:
    """Windows without cells that no longer matter, parted at gaps, joined where they are one, summing to 1."""
    present = sorted((one for one in windows if len(one.mass)), key=lambda one: one.start_m)
    best = max((float(one.mass.max()) for one in present), default=0.0)
    if not best > 0.0:
        return []
    parts = [part for one in present for part in _parted(one, LEAST_MASS * best, length_m)]
    joined: list[Window] = []
    for part in sorted(parts, key=lambda one: one.start_m):
        if joined and _are_one(joined[-1], part):
            joined[-1] = _join(joined[-1], part)
        else:
            joined.append(part)
    if len(joined) > MOST_WINDOWS:
        joined = sorted(joined, key=lambda one: -one.total)[:MOST_WINDOWS]
    whole = sum(one.total for one in joined)
    for one in joined:
        one.mass /= whole
    return joined


def _parted(window: Window, least: float, length_m: float) -> list[Window]:
    places = window.places_m
    kept = np.flatnonzero((window.mass >= least) & (places > -OVERHANG_M) & (places < length_m + OVERHANG_M))
    if not len(kept):
        return []
    cuts = np.flatnonzero(np.diff(kept) > WIDEST_GAP)
    firsts, lasts = [int(kept[0]), *kept[cuts + 1].tolist()], [*kept[cuts].tolist(), int(kept[-1])]
    return [
        Window(window.start_m + i * CELL_M, window.mass[i:j].copy(), window.states[i:j].copy())
        for first, last in zip(firsts, lasts, strict=True)
        for i, j in _pieces(first, last + 1)
    ]


def _pieces(first: int, last: int) -> list[tuple[int, int]]:
    """A stretch of cells cut into pieces that are not too long."""
    count = -(-(last - first) // LONGEST_WINDOW)
    edges = np.linspace(first, last, count + 1).astype(int).tolist()
    return list(pairwise(edges))


def _are_one(one: Window, other: Window) -> bool:
    overlap = one.start_m + CELL_M * len(one.mass) - other.start_m
    together = CELL_M * len(other.mass) + other.start_m - one.start_m
    return (
        overlap > CELL_M
        and together < CELL_M * LONGEST_WINDOW
        and abs(one.speed_mps - other.speed_mps) < SAME_SPEED_MPS
    )


def _join(one: Window, other: Window) -> Window:
    """Two overlapping windows as one, on the cells of the likelier."""
    main, minor = (one, other) if one.total >= other.total else (other, one)
    offset = round((minor.start_m - main.start_m) / CELL_M)
    first, last = min(0, offset), max(len(main.mass), offset + len(minor.mass))
    mass = np.zeros(last - first)
    states = no_states(last - first)
    mass[offset - first : offset - first + len(minor.mass)] += minor.mass
    states[offset - first : offset - first + len(minor.mass)] = minor.states
    mass[-first : len(main.mass) - first] += main.mass
    states[-first : len(main.mass) - first] = main.states
    return Window(main.start_m + first * CELL_M, mass, states)


def tail_bound_m(windows: Iterable[Window], place_m: float, risk: float) -> float:
    """Smallest distance from a place beyond which there is less probability than `risk`."""
    distance = np.concatenate([np.abs(one.places_m - place_m) for one in windows])
    mass = np.concatenate([one.mass for one in windows])
    order = np.argsort(distance)
    inside = np.cumsum(mass[order])
    beyond = inside[-1] - inside
    return float(distance[order][min(int(np.searchsorted(-beyond, -risk)), len(order) - 1)])


def even(start_m: float, cells: int) -> Window:
    """A window that knows nothing: all cells alike."""
    return Window(start_m, np.ones(cells), no_states(cells))


def cells_at(table: NDArray[np.float64], places_m: Float64s) -> tuple[Float64s, Float64s]:
    """Points and tangents (n, 3) of places, out of a table of both (m, 6) for every metre from -OVERHANG_M on."""
    position = np.clip(places_m + OVERHANG_M, 0.0, len(table) - 1.001)
    before = position.astype(np.int64)
    share = (position - before)[:, None]
    rows = table[before] * (1.0 - share) + table[before + 1] * share
    return np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3:])
