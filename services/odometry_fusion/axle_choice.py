"""One odometry of several axles: the axle that is most plausible now, handed over without a leap into its slip."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any, Final

import numpy as np

from services.odometry_fusion.motion_log import PERIOD_S, VALID, MotionRows, columns_of

HANDOVER_ROWS: Final = round(10.0 / PERIOD_S)
"""At a handover the last 10 s are taken from the new axle: the old one may have slipped unseen before it was seen."""


class AxleChoice:
    """Adds up the steps of whichever axle leads."""

    def __init__(self) -> None:
        """Lead with the first axle."""
        self.leader = 0
        self._sum: deque[tuple[float, float, float]] = deque(maxlen=HANDOVER_ROWS + 1)
        self._past: list[deque[tuple[float, float, float]]] = []

    def advance(self, axles: list[MotionRows]) -> MotionRows:
        """Rows of all axles together; each has the same times. One axle alone stays as it is."""
        if len(axles) == 1 or not len(axles[0]):
            return axles[0]
        while len(self._past) < len(axles):
            self._past.append(deque(maxlen=HANDOVER_ROWS + 1))
        sums = np.empty((len(axles[0]), 3))
        leaders = np.empty(len(axles[0]), np.int64)
        for at in range(len(axles[0])):
            self._step(axles, at)
            sums[at], leaders[at] = self._sum[-1], self.leader
        lead = axles[self.leader]
        columns: dict[str, Any] = {
            name: np.choose(leaders, [columns_of(rows)[name] for rows in axles]) for name in columns_of(lead)
        }
        shift_m = sums[:, 0] - columns["distance_m"]
        columns["curvature_distance_m"] = columns["curvature_distance_m"] + shift_m
        columns["distance_m"], columns["way_m"], columns["excess_m"] = sums[:, 0], sums[:, 1], sums[:, 2]
        columns["bound_m"] = lead.share_bound * sums[:, 1] + sums[:, 2] + columns["provisional_m"]
        return replace(lead, **columns)

    def _step(self, axles: list[MotionRows], at: int) -> None:
        for past, rows in zip(self._past, axles, strict=True):
            past.append((float(rows.distance_m[at]), float(rows.way_m[at]), float(rows.excess_m[at])))
        if self._is_doubtful(axles[self.leader], at):
            sound = [k for k, rows in enumerate(axles) if not self._is_doubtful(rows, at)]
            if sound:
                best = min(sound, key=lambda k: float(axles[k].provisional_m[at] + axles[k].excess_m[at]))
                self._hand_over(best)
                return
        if not self._sum:
            self._sum.append(self._past[self.leader][-1])
            return
        past = self._past[self.leader]
        self._sum.append(_moved(self._sum[-1], past[-2], past[-1]))

    def _hand_over(self, to: int) -> None:
        """Lead with another axle, whose last seconds replace the old one's."""
        self.leader = to
        if not self._sum:
            self._sum.append(self._past[to][-1])
            return
        # Both reach equally far back, but for the row that is being added.
        full = len(self._sum) == HANDOVER_ROWS + 1
        self._sum.append(_moved(self._sum[1 if full else 0], self._past[to][0], self._past[to][-1]))

    @staticmethod
    def _is_doubtful(rows: MotionRows, at: int) -> bool:
        return bool(rows.status[at] != VALID or rows.slip[at] != 0)


def _moved(
    base: tuple[float, float, float], before: tuple[float, float, float], now: tuple[float, float, float]
) -> tuple[float, float, float]:
    """`base` moved by what lies between `before` and `now`; way and excess never fall."""
    return (
        base[0] + now[0] - before[0],
        max(base[1], base[1] + now[1] - before[1]),
        max(base[2], base[2] + now[2] - before[2]),
    )
