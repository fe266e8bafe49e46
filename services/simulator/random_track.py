"""Tracks drawn at random: gradients with vertical curves, curves with transitions and cant, stops."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from services.simulator.motion_settings import NotNegative, Part, Positive
from services.simulator.track_table import GRAVITY_MPS2, STEP_M, TrackTable, roughened

Floats = NDArray[np.float64]
CONTACT_M = 1.132
"""Between the rails' centres of 1067 mm gauge."""


class TrackSettings(Part, frozen=True, kw_only=True):
    """What tracks are drawn from; ranges are uniform."""

    length_m: Annotated[float, Meta(ge=1_500.0, le=200_000.0)] = 30_000.0
    max_gradient_permille: NotNegative = 16.0
    gradient_every_m: tuple[float, float] = (250.0, 1200.0)
    vertical_radius_m: tuple[float, float] = (2500.0, 5000.0)
    radius_m: tuple[float, float] = (300.0, 800.0)
    curve_every_m: tuple[float, float] = (100.0, 900.0)
    """Straight between two curves."""
    arc_m: tuple[float, float] = (80.0, 450.0)
    transition_m: tuple[float, float] = (35.0, 90.0)
    stop_every_m: tuple[float, float] = (900.0, 2600.0)
    limit_mps: tuple[float, float] = (13.0, 29.0)
    irregularity: NotNegative = 1.0
    lateral_mps2: Positive = 0.7
    """Largest unbalanced lateral acceleration that curve speeds allow."""


def random_track(settings: TrackSettings, generator: np.random.Generator) -> TrackTable:
    """A track by the settings; the same generator state gives the same one."""
    count = round(settings.length_m / STEP_M) + 1
    way: Floats = np.asarray(np.arange(count) * STEP_M, np.float64)
    curvature, roll, curve_limit = _curves(settings, way, generator)
    slope = _slopes(settings, way, generator)
    limit = np.minimum(_limits(settings, way, generator), curve_limit)
    track = TrackTable(curvature, slope, roll, limit, _stops(settings, generator))
    return roughened(track, generator, settings.irregularity)


def _draw(between: tuple[float, float], generator: np.random.Generator) -> float:
    return float(generator.uniform(*between))


def _curves(s: TrackSettings, way: Floats, generator: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Curvature, roll and speed limit: trapezia, cant for three quarters of an equilibrium at a drawn speed."""
    knots, bends, rolls = [0.0], [0.0], [0.0]
    limit = np.full(len(way), np.inf)
    at_m = 150.0 + _draw(s.curve_every_m, generator)
    while at_m < way[-1]:
        radius_m, sign = _draw(s.radius_m, generator), generator.choice((-1.0, 1.0))
        ease_m, arc_m = _draw(s.transition_m, generator), _draw(s.arc_m, generator)
        design_mps = np.sqrt(radius_m * 0.9)
        cant_m = min(0.75 * CONTACT_M * design_mps**2 / (radius_m * GRAVITY_MPS2), 0.105)
        tilt_rad = -sign * float(np.arcsin(cant_m / CONTACT_M))
        end_m = at_m + 2 * ease_m + arc_m
        knots += [at_m, at_m + ease_m, end_m - ease_m, end_m]
        bends += [0.0, sign / radius_m, sign / radius_m, 0.0]
        rolls += [0.0, tilt_rad, tilt_rad, 0.0]
        inside = (way >= at_m) & (way <= end_m)
        limit[inside] = np.sqrt(radius_m * (s.lateral_mps2 + GRAVITY_MPS2 * cant_m / CONTACT_M))
        at_m = end_m + _draw(s.curve_every_m, generator)
    return np.interp(way, knots, bends), np.interp(way, knots, rolls), limit


def _slopes(s: TrackSettings, way: Floats, generator: np.random.Generator) -> Floats:
    """Gradients as long as drawn, each change spread over its vertical curve."""
    slope = np.zeros(len(way))
    at_m, here = _draw(s.gradient_every_m, generator), 0.0
    knots, values = [0.0], [0.0]
    while at_m < way[-1]:
        # As often near the steepest as anywhere: the mean of lines, not of hills, is level.
        there = s.max_gradient_permille / 1000.0 * float(np.clip(1.4 * generator.uniform(-1.0, 1.0), -1.0, 1.0))
        reach_m = abs(there - here) * _draw(s.vertical_radius_m, generator) / 2
        knots += [max(at_m - reach_m, knots[-1]), at_m + reach_m]
        values += [here, there]
        at_m, here = at_m + reach_m + _draw(s.gradient_every_m, generator), there
    slope[:] = np.interp(way, knots, values)
    return slope


def _limits(s: TrackSettings, way: Floats, generator: np.random.Generator) -> Floats:
    limit = np.empty(len(way))
    at = 0
    while at < len(way):
        end = at + round(generator.uniform(400.0, 2500.0) / STEP_M)
        limit[at:end] = _draw(s.limit_mps, generator)
        at = end
    return limit


def _stops(s: TrackSettings, generator: np.random.Generator) -> Floats:
    stops: list[float] = []
    at_m = 100.0 + _draw(s.stop_every_m, generator)
    while at_m < s.length_m - 200.0:
        stops.append(at_m)
        at_m += _draw(s.stop_every_m, generator)
    return np.array([*stops, s.length_m - 100.0])
