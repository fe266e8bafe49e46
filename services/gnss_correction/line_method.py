"""Method `line` over blocks of epochs, and fixes of the other methods placed on the line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from services.gnss_correction.antenna_height import raised
from services.gnss_correction.atmosphere import L1_HZ
from services.gnss_correction.line_estimate import LineEstimate
from services.gnss_correction.line_filter import NOWHERE, LineFilter
from services.gnss_correction.line_passages import undecided
from services.gnss_correction.rejection import Outcome
from services.gnss_correction.solver_arrays import ROW, RULES, SOLUTION, Bools, Float64s, Ints, Records
from services.gnss_correction.wheel_speed import WheelSpeeds
from services.line.line_file import LineGeometry
from services.line.projection import candidates
from services.numerics.geodesy import ecef_from_geodetic, enu_from_ecef_rotation, geodetic_from_ecef

_ON_LINE: Final = [(name, np.float64) for name in ("chainage_m", "chainage_bound_m", "speed_along_mps")]
LINE_SOLUTION: Final = np.dtype([*SOLUTION.descr, ("bound_m", np.float64), *_ON_LINE])
"""SOLUTION with a horizontal bound, and the place on the line: chainage [m], its bound [m], speed along it [m/s],
positive towards rising axis_m."""
BESIDE_M: Final = 5.0
"""How far the antenna may be beside the axis: its bend, the other track."""
PASSAGE_M: Final = 30.0
"""Passages of the line this near a fix may be the one it belongs to, whatever its own bound."""
FARTHEST_M: Final = 500.0
"""A fix further from the line has no chainage."""
EXPECTED_MPS: Final = 100.0
"""A train gets no further than this per second from its place before."""

RUNNING_MPS: Final = 1.0
"""From this speed on a fix tells the direction of running."""

_OUTCOME: Final = {"fix": Outcome.FIX, "predicted": Outcome.PREDICTED}


@dataclass(frozen=True, slots=True)
class Line:
    """A line to follow, and speed by the wheels where it is known."""

    geometry: LineGeometry
    wheels: WheelSpeeds | None = None
    antenna_above_m: float = 0.0
    """Height of the antenna above the rail, whose height is the line's."""


@dataclass(frozen=True, slots=True)
class LineInput:
    """A block of epochs for the filter."""

    first_row: Ints
    t_s: Float64s
    """Time of week of the table's week, for orbits and air."""
    gps_s: Float64s
    """Seconds of GPS time since 1980."""
    refused: Bools
    rows: Records
    """Dtype ROW; directions and rejections are completed."""
    free: Records
    """Solutions without the line."""


class LineMethod:
    """Solves blocks of epochs along a line."""

    def __init__(self, line: Line) -> None:
        """Know nothing yet but the line."""
        self._line = line
        self._axis = raised(line.geometry.axis, line.antenna_above_m)
        self._filter = LineFilter(self._axis)
        self._newest_s = -math.inf

    def solve(self, given: LineInput, rules: Any) -> tuple[Records, list[str]]:  # noqa: ANN401 - numpy record
        """Solutions (dtype LINE_SOLUTION) and what is to be said of each."""
        solutions = np.zeros(len(given.t_s), LINE_SOLUTION)
        for name in LINE_SOLUTION.names or ():
            if LINE_SOLUTION[name] == np.float64:
                solutions[name] = np.nan
        solutions["outcome"] = Outcome.TOO_FEW_SATELLITES
        reasons = [""] * len(solutions)
        places = _places(given.free)
        for i in np.flatnonzero(~given.refused).tolist():
            gps_s = float(given.gps_s[i])
            if gps_s <= self._newest_s:
                self._filter = LineFilter(self._axis)
            self._newest_s = gps_s
            wheels = self._line.wheels
            wheel_mps = wheels.at(gps_s) if wheels else math.nan
            rows = given.rows[given.first_row[i] : given.first_row[i + 1]]
            estimate = self._filter.epoch(gps_s, float(given.t_s[i]), rows, rules, places[i], wheel_mps)
            undecided_now = undecided(self._axis, estimate.axis_m, estimate.bound_m)
            reasons[i] = "; ".join(part for part in (estimate.reason, undecided_now) if part)
            self._fill(solutions[i], estimate)
        return solutions, reasons

    def _fill(self, solution: Any, estimate: LineEstimate) -> None:  # noqa: ANN401 - numpy record
        """Put an estimate into a solution."""
        nowhere = Outcome.OFF_LINE if estimate.used else Outcome.TOO_FEW_SATELLITES
        solution["outcome"] = _OUTCOME.get(estimate.status, nowhere)
        solution["used"], solution["needed"] = estimate.used, 0
        if estimate.status == "none":
            return
        axis, chainage = self._axis, self._line.geometry.chainage
        point, tangent = axis.at(estimate.axis_m), axis.tangent(estimate.axis_m)
        lat_rad, lon_rad, h_m = geodetic_from_ecef(*point)
        solution["lat_rad"], solution["lon_rad"], solution["h_m"] = lat_rad, lon_rad, h_m
        velocity = enu_from_ecef_rotation(lat_rad, lon_rad) @ tangent * estimate.speed_mps
        solution["ve_mps"], solution["vn_mps"], solution["vu_mps"] = velocity
        solution["sigma_horizontal_m"] = estimate.sigma_m
        solution["bound_m"] = math.hypot(estimate.bound_m, BESIDE_M)
        solution["chainage_m"] = float(chainage.at(estimate.axis_m))
        solution["chainage_bound_m"] = chainage.reach_m(estimate.axis_m, estimate.bound_m)
        solution["speed_along_mps"] = estimate.speed_mps


def _places(solutions: Records) -> Float64s:
    """Earth-fixed places (n, 3) of fixes, NaN where there is none."""
    fixed = solutions["outcome"] == Outcome.FIX
    places = np.stack(ecef_from_geodetic(solutions["lat_rad"], solutions["lon_rad"], solutions["h_m"]), axis=-1)
    return np.asarray(np.where(fixed[:, None], places, NOWHERE))


def warm_up(line: Line) -> None:
    """Compile the kernels, or load them from their cache, on six satellites that stand still over the line."""
    axis = line.geometry.axis
    middle = axis.at(axis.length_m / 2.0)
    up = middle / np.linalg.norm(middle)
    rows = np.zeros(6, ROW)
    for row, offset in zip(rows, np.vstack([np.eye(3), -np.eye(3)]), strict=True):
        place = middle + 2.0e7 * (up + 0.5 * offset)
        row["x_m"], row["y_m"], row["z_m"] = place
        row["pseudorange_m"] = math.dist(place, middle)
        row["strength_dbhz"], row["range_rate_mps"], row["carrier_hz"] = 45.0, 0.0, L1_HZ
    rules = np.zeros(1, RULES)
    follower = LineFilter(axis)
    for t_s in (0.0, 0.2):
        follower.epoch(t_s, 0.0, rows.copy(), rules[0], NOWHERE)


def _velocity(solution: Any) -> Float64s:  # noqa: ANN401 - numpy record
    """Velocity (3,) of a solution, Earth-fixed; NaN where there is none."""
    rotation = enu_from_ecef_rotation(float(solution["lat_rad"]), float(solution["lon_rad"]))
    return np.asarray(rotation.T @ np.array([solution["ve_mps"], solution["vn_mps"], solution["vu_mps"]]))


class LinePlacing:
    """Places the fixes of another method on the line, each near the one before it."""

    def __init__(self, geometry: LineGeometry) -> None:
        """Know no place yet."""
        self._geometry = geometry
        self._axis_m = math.nan
        self._t_s = -math.inf

    def place(self, solutions: Records, gps_s: Float64s) -> Records:
        """The same solutions with the columns of _ON_LINE; NaN where there is no fix or it is far from the line.

        The bound is that of the fix, widened so that it covers every passage of the line that the fix
        may belong to; without a bound of the fix there is none.
        """
        placed = np.zeros(len(solutions), [*solutions.dtype.descr, *_ON_LINE])
        for name in solutions.dtype.names or ():
            placed[name] = solutions[name]
        for name, _ in _ON_LINE:
            placed[name] = np.nan
        names = solutions.dtype.names or ()
        axis, chainage = self._geometry.axis, self._geometry.chainage
        plane = axis.to_plane(np.degrees(placed["lat_rad"]), np.degrees(placed["lon_rad"]), placed["h_m"])
        for i in np.flatnonzero(np.isfinite(plane).all(axis=1)).tolist():
            bound_m = float(placed["bound_m"][i]) if "bound_m" in names else math.nan
            velocity_ecef = _velocity(placed[i])
            found = self._choose(plane[i], bound_m, float(gps_s[i]), velocity_ecef)
            if found is None:
                continue
            place_m, reach_m = found
            placed["chainage_m"][i] = float(chainage.at(place_m))
            if math.isfinite(bound_m):
                placed["chainage_bound_m"][i] = chainage.reach_m(place_m, max(bound_m, reach_m))
            placed["speed_along_mps"][i] = float(velocity_ecef @ axis.tangent(place_m))
        return placed

    def _choose(
        self, place: Float64s, bound_m: float, t_s: float, velocity_mps: Float64s
    ) -> tuple[float, float] | None:
        """The passage nearest to where the train was, and how far away another one is that it may be on.

        As long as nothing else tells passages apart, one that the train runs along towards rising axis_m is taken.
        """
        feet = candidates(self._geometry.axis, place, FARTHEST_M)
        if not feet:
            return None
        nearest_m = abs(feet[0].aside_m)
        slack_m = max(PASSAGE_M, bound_m if math.isfinite(bound_m) else 0.0)
        possible = [foot for foot in feet if abs(foot.aside_m) <= nearest_m + slack_m]
        along = [float(velocity_mps @ self._geometry.axis.tangent(foot.axis_m)) for foot in possible]
        rising = [foot for foot, speed in zip(possible, along, strict=True) if speed > RUNNING_MPS]
        chosen = (rising or possible)[0]
        if abs(t_s - self._t_s) <= 60.0:  # noqa: PLR2004 - after a minute anything may have happened
            reach_m = slack_m + EXPECTED_MPS * abs(t_s - self._t_s)
            near = [foot for foot in rising or possible if abs(foot.axis_m - self._axis_m) <= reach_m]
            chosen = near[0] if near else chosen
        self._axis_m, self._t_s = chosen.axis_m, t_s
        return chosen.axis_m, max(abs(foot.axis_m - chosen.axis_m) for foot in possible)
