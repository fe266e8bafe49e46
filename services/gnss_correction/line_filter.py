"""Method `line`: where on a known line the train is, by a point-mass filter over places of the axis.

A Bayes filter in one dimension (Bucy and Senne 1971: probability on a grid), with a small Kalman
filter for speed, clock drift and clocks in every cell (line_likelihood.py). It is causal. The
probability moves with the speed that Doppler gives along the axis, or that the wheels give; the
pseudoranges then weigh the cells. Several passages of the line near one place stay hypotheses until
the measurements decide between them.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from services.gnss_correction.line_belonging import Belonging
from services.gnss_correction.line_coasting import Coasting
from services.gnss_correction.line_estimate import DOUBTFUL_LEVEL, LineEstimate, bound_of, mode_of
from services.gnss_correction.line_likelihood import (
    CLOCK,
    SIGHT,
    SPEED,
    VAR_CLOCK,
    VAR_DRIFT,
    VAR_SPEED,
    common_jump_m,
    level_of,
    rate_level_of,
    take_sights,
    weigh_cells,
)
from services.gnss_correction.line_wheels import DIRECTION_KNOWN_MPS, NO_WHEEL, Wheels
from services.gnss_correction.line_windows import (
    OVERHANG_M,
    Window,
    cells_at,
    even,
    leap,
    move,
    tidy,
)
from services.gnss_correction.solver_arrays import Float64s, Records
from services.line.axis import Axis

ACCELERATION_MPS: Final = 1.0
"""How much the speed may change unseen in one second (one standard deviation)."""
WHEEL_ACCELERATION_MPS: Final = 0.1
"""The same when the wheels tell how it changes."""
DRIFT_STEP_MPS: Final = 0.3
CLOCK_STEP_M: Final = 0.3
"""Random walk of the receiver's clock drift, and of its clocks beyond the drift, in one second."""
RENEWAL_S: Final = 8.0
RENEWAL_M: Final = 10.0
"""After this time, or this way, a satellite's error is another one: reflections live as long."""
RATE_RENEWAL_S: Final = 0.7
"""The same for the errors of Doppler."""
FEWEST_SIGHTS: Final = 3
"""A place needs two satellites and their clock; the third is for their errors."""
FEWEST_TO_START: Final = 4
COARSE_M: Final = 8.0
"""Steps in which the whole line is searched at first."""
COARSE_CELLS: Final = 8
"""The same in cells."""
WORST_SEED: Final = 40.0
"""Cost above the best at which a coarse place is no candidate any more."""
SEARCH_AGAIN_S: Final = 1.0
AWAY_SEARCH_S: Final = 10.0
"""While the train is not on the line, the whole line is searched again after this time."""
LONGEST_STEP_S: Final = 3.0
"""A longer time without measurements is bridged in one piece."""
LOST_M: Final = 150.0
"""When the place is less certain than this (one standard deviation), the line is searched anew."""
FALLING_ODDS: Final = math.exp(-8.0)
"""Of two hypotheses on the same ground in opposite directions the one that runs towards rising axis_m is named,
until this is outweighed; the bound covers both all the same."""
STAYING_ODDS: Final = math.exp(6.0)
"""A passage once named is left only for one that is so much likelier."""
BOUND_SIGMAS: Final = 5.0
"""Of the way since the last measurement, in the bound of a prediction."""
WORST_RATE_LEVEL: Final = 0.8
"""With so much disagreement of the Dopplers speed and drift are sought anew."""
LOST_SPEED_M2PS2: Final = 4.0
LOST_DRIFT_M2PS2: Final = 1e6
JUMP_M2: Final = 1e4
"""How uncertain a clock is after a jump that all satellites tell [m²]."""
LEVEL_S: Final = 3.0
DOUBT_AGAIN_S: Final = 2.0
DOUBT_REACH_M: Final = 150.0
DOUBT_MASS: Final = 1e-4
DOUBT_SPEED_MPS: Final = 2.0
"""A doubted place: how often and how far around it others get a little probability, and how far speed may be off."""
NOWHERE: Final = np.full(3, np.nan)


class LineFilter:
    """Follows one receiver along one line."""

    def __init__(self, axis: Axis) -> None:
        """Know nothing yet but the line."""
        self.axis = axis
        self.wheels = Wheels()
        places = np.arange(-OVERHANG_M, axis.length_m + OVERHANG_M + 2.0)
        inside = np.clip(places, 0.0, axis.length_m)
        tangents = axis.tangent(places)
        self._table = np.hstack([axis.at(places) + (places - inside)[:, None] * tangents, tangents])
        self._windows: list[Window] = []
        self._coasting = Coasting(0.0, 0.0)
        self._t_s = -math.inf
        self._searched_s = -math.inf
        self._sights = np.zeros(64, SIGHT)
        self._fresh_rate = 1.0
        self._free_m = NOWHERE
        self._level = 0.0
        self._belonging = Belonging()
        self._doubted_s = -math.inf
        self._best = LineEstimate("none", "no epoch yet")

    def epoch(
        self,
        t_s: float,
        tow_s: float,
        rows: Records,
        rules: Any,  # noqa: ANN401 - numpy record
        free_m: Float64s = NOWHERE,
        wheel_mps: float = math.nan,
    ) -> LineEstimate:
        """Estimate at one epoch.

        `rows` (dtype ROW) are those of the epoch; directions and rejections are completed. `t_s`,
        in any one count, must rise; `tow_s` is the time of week for the air; `free_m` (3,) is the fix
        without the line, Earth-fixed, NaN where there is none;
        `wheel_mps` is the speed by the wheels without a sign, NaN where there is none.
        """
        self._free_m = free_m
        dt_s = t_s - self._t_s if self._windows else 0.0
        self._t_s = t_s
        self._fresh_rate = min(1.0, dt_s / RATE_RENEWAL_S) if self._windows else 1.0
        if self._windows:
            self._coasting.go(dt_s, ACCELERATION_MPS)
            if math.isfinite(wheel_mps):
                self._coasting.roll(self.wheels.rolled_mps(wheel_mps), self.wheels.scale.sigma, dt_s)
        sights = self._take(rows, tow_s, rules)
        if len(sights) < (FEWEST_SIGHTS if self._windows else FEWEST_TO_START):
            return self._predicted(f"{len(sights)} usable of {len(rows)} satellites")
        if not self._windows or self._coasting.sigma_m > LOST_M:
            return self._search(sights)
        return self._follow(sights, wheel_mps)

    def _take(self, rows: Records, tow_s: float, rules: Any) -> Records:  # noqa: ANN401 - numpy record
        """The satellites of an epoch as cells see them, from about where the train is."""
        if len(rows) > len(self._sights):
            self._sights = np.zeros(2 * len(rows), SIGHT)
        around_m = self._best.axis_m if self._windows else self.axis.length_m / 2.0
        count = take_sights(rows, self.axis.at(around_m), tow_s, rules, self._sights)
        return self._sights[:count]

    def _predicted(self, reason: str) -> LineEstimate:
        """Where the train should be by now."""
        if not self._windows:
            return LineEstimate("none", reason)
        past, coasting = self._best, self._coasting
        bound_m = past.bound_m + BOUND_SIGMAS * coasting.sigma_m
        return LineEstimate(
            "predicted",
            f"{reason}; predicted for {coasting.time_s:.1f} s",
            min(max(past.axis_m + coasting.distance_m, 0.0), self.axis.length_m),
            min(bound_m, self.axis.length_m),
            coasting.speed_mps,
        )

    def _search(self, sights: Records) -> LineEstimate:
        """Begin with the whole line: coarse places first, then cells around those that are good enough."""
        if self._t_s - self._searched_s < SEARCH_AGAIN_S:
            return self._predicted(self._best.reason)
        self._searched_s = self._t_s
        coarse = np.arange(0.0, self.axis.length_m + COARSE_M, COARSE_M)
        cost = self._weighed(coarse, even(0.0, len(coarse)).states, sights, 1.0, NO_WHEEL)
        if self._windows:
            expected_m = self._best.axis_m + self._coasting.distance_m
            cost += np.minimum(((coarse - expected_m) / self._coasting.sigma_m) ** 2, WORST_SEED)
        good = coarse[cost < cost.min() + WORST_SEED]
        cells = np.unique((good[:, None] + np.arange(-COARSE_M, COARSE_M)).astype(np.int64))
        breaks = np.flatnonzero(np.diff(cells) > 1) + 1
        self._windows = [even(float(part[0]), len(part)) for part in np.split(cells, breaks)]
        self._update(sights, 1.0, NO_WHEEL)
        return self._answer(sights)

    def _follow(self, sights: Records, wheel_mps: float) -> LineEstimate:
        """Carry the windows to the present and weigh them."""
        coasting = self._coasting
        dt_s = coasting.time_s
        change_mps = self.wheels.change_mps(wheel_mps, dt_s)
        if dt_s > LONGEST_STEP_S:
            main_mps = self._best.speed_mps
            self._windows = [
                leap(
                    one,
                    math.copysign(1.0, one.speed_mps * main_mps) * coasting.distance_m,
                    math.copysign(1.0, one.speed_mps * main_mps) * coasting.speed_mps,
                    coasting.speed_m2ps2,
                    coasting.sigma_m**2,
                )
                for one in self._windows
            ]
            self._update(sights, 1.0, NO_WHEEL)
            return self._answer(sights)
        self._windows = [_moved(one, dt_s, change_mps) for one in self._windows]
        before = [one.speed_mps for one in self._windows]
        way_m = abs(self._best.speed_mps) * dt_s
        fresh = min(1.0, dt_s / RENEWAL_S + way_m / RENEWAL_M)
        self._update(sights, fresh, self.wheels.measurement(wheel_mps, dt_s, self._best.speed_mps))
        for one, speed_mps in zip(self._windows, before, strict=True):
            one.start_m += 0.5 * (one.speed_mps - speed_mps) * dt_s
        answer = self._answer(sights)
        if math.isfinite(wheel_mps):
            self.wheels.scale.learn(abs(answer.speed_mps), wheel_mps, dt_s)
        return answer

    def _weighed(
        self, places_m: Float64s, states: Float64s, sights: Records, fresh: float, wheel: Float64s
    ) -> Float64s:
        cost = np.zeros(len(places_m))
        points, tangents = cells_at(self._table, places_m)
        weigh_cells(points, tangents, states, sights, fresh, self._fresh_rate, wheel, cost)
        return cost

    def _update(self, sights: Records, fresh: float, wheel: Float64s) -> None:
        """Weigh every cell with an epoch."""
        self._repair(sights)
        costs = [self._weighed(one.places_m, one.states, sights, fresh, wheel) for one in self._windows]
        least = min(float(cost.min()) for cost in costs)
        for one, cost in zip(self._windows, costs, strict=True):
            one.mass *= np.exp(-0.5 * (cost - least))

    def _main(self) -> Window:
        """The window that is believed."""
        return max(self._windows, key=self._belief)

    def _belief(self, window: Window) -> float:
        """Probability of a window, with what a passage has ahead that runs towards rising axis_m or was believed."""
        falls = window.speed_mps < -DIRECTION_KNOWN_MPS
        expected_m = self._best.axis_m + self._coasting.distance_m
        reach_m = DOUBT_REACH_M + self._coasting.sigma_m
        stays = abs(self._best.speed_mps) > DIRECTION_KNOWN_MPS and (
            window.start_m - reach_m < expected_m < window.start_m + len(window.mass) + reach_m
        )
        return window.total * (FALLING_ODDS if falls else 1.0) * (STAYING_ODDS if stays else 1.0)

    def _repair(self, sights: Records) -> None:
        """Take out what all satellites say of the receiver's clock at once: steps of clock and of drift."""
        main = self._main()
        best = int(np.argmax(main.mass))
        point, tangent = cells_at(self._table, main.places_m[best : best + 1])
        jump_m = common_jump_m(point[0], tangent[0], main.states[best], sights)
        lost = rate_level_of(point[0], tangent[0], main.states[best], sights) > WORST_RATE_LEVEL
        for one in self._windows:
            if jump_m:
                one.states[:, CLOCK:VAR_CLOCK] += jump_m
                one.states[:, VAR_CLOCK:] += JUMP_M2
            if lost:
                one.states[:, VAR_SPEED] += LOST_SPEED_M2PS2
                one.states[:, VAR_DRIFT] += LOST_DRIFT_M2PS2

    def _doubt(self, place_m: float, state: Float64s) -> None:
        """Give the neighbourhood of a place a little probability anew, so that one believed wrongly can be left.

        Speed and drift are taken from `state`.
        """
        self._doubted_s = self._t_s
        fresh = even(float(round(place_m - DOUBT_REACH_M)), 2 * int(DOUBT_REACH_M) + 1)
        fresh.mass *= DOUBT_MASS / len(fresh.mass)
        fresh.states[:, :CLOCK] = state[:CLOCK]
        fresh.states[:, VAR_SPEED] += DOUBT_SPEED_MPS**2
        self._windows.append(fresh)

    def _foot_of_free(self) -> tuple[float, float]:
        """Place along the axis nearest to the fix without the line, and its distance; NaN without such a fix."""
        if not np.isfinite(self._free_m).all():
            return math.nan, math.nan
        distance = np.linalg.norm(self._table[::COARSE_CELLS, :3] - self._free_m, axis=1)
        nearest = int(np.argmin(distance))
        return nearest * COARSE_CELLS - OVERHANG_M, float(distance[nearest])

    def _answer(self, sights: Records) -> LineEstimate:
        """Settle the windows and say where the train is."""
        self._windows = tidy(self._windows, self.axis.length_m)
        if not self._windows:
            self._best = LineEstimate("none", "ran off the end of the line")
            return self._best
        main = self._main()
        mode = mode_of(main)
        point, tangent = cells_at(self._table, main.places_m[mode.cell : mode.cell + 1])
        level = level_of(point[0], tangent[0], main.states[mode.cell], sights)
        dt_s = max(self._coasting.time_s, 0.01)
        free_axis_m, away_m = self._foot_of_free()
        self._belonging.take(point[0], tangent[0], sights, level, self._free_m, away_m, dt_s)
        self._level += (level - self._level) * min(1.0, dt_s / LEVEL_S)
        self._coasting = Coasting(mode.speed_mps, mode.speed_m2ps2)
        bound_m = min(bound_of(self._windows, mode.axis_m, self._level, sights), self.axis.length_m)
        axis_m = min(max(mode.axis_m, 0.0), self.axis.length_m)
        self._best = LineEstimate("fix", "", axis_m, bound_m, mode.speed_mps, len(sights), level, mode.sigma_m)
        if self._level > DOUBTFUL_LEVEL and self._t_s - self._doubted_s > DOUBT_AGAIN_S:
            self._doubt(self._best.axis_m, main.states[mode.cell])
            if away_m < DOUBT_REACH_M < abs(free_axis_m - axis_m):
                self._doubt(free_axis_m, main.states[mode.cell])
        denial = self._belonging.denial()
        if denial:
            if self._t_s - self._searched_s > AWAY_SEARCH_S:
                self._windows = []
            return LineEstimate("none", denial, used=len(sights), level=level)
        return self._best


def _moved(window: Window, dt_s: float, change_mps: float) -> Window:
    """A window after a step, its speeds changed as the wheels tell, half before and half after it."""
    told = math.isfinite(change_mps) and abs(window.speed_mps) > DIRECTION_KNOWN_MPS
    half_mps = math.copysign(0.5, window.speed_mps) * change_mps if told else 0.0
    step_mps = (WHEEL_ACCELERATION_MPS if told else ACCELERATION_MPS) * math.sqrt(dt_s)
    window.states[:, SPEED] += half_mps
    moved = move(window, dt_s, step_mps, DRIFT_STEP_MPS * math.sqrt(dt_s), CLOCK_STEP_M * math.sqrt(dt_s))
    moved.states[:, SPEED] += half_mps
    return moved
