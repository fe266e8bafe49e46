"""At what power reception fails, learned from powers with their reception ratios."""

from __future__ import annotations

from typing import Final

import msgspec

STEP_DB: Final = 2.0
LEAST: Final = 5
"""Sections in a step of power, for it to count."""
FAILING_SHARE: Final = 0.5


class ReceptionCurve(msgspec.Struct):
    """How many sections were heard at each step of power, and how many of them badly."""

    heard: dict[int, int] = msgspec.field(default_factory=dict)
    bad: dict[int, int] = msgspec.field(default_factory=dict)

    def add(self, power_dbm: float, received_ratio: float, least_ratio: float) -> None:
        """Count a section of a normal pass."""
        step = round(power_dbm / STEP_DB)
        self.heard[step] = self.heard.get(step, 0) + 1
        if received_ratio < least_ratio:
            self.bad[step] = self.bad.get(step, 0) + 1

    def loss_power_dbm(self) -> tuple[float, bool] | None:
        """Power at which half of the sections fall below the ratio, and whether that was seen.

        Where it never was, the lowest power heard (False): reception holds down to there at least. None without
        enough sections.

        >>> curve = ReceptionCurve()
        >>> for dbm in range(-100, -80): [curve.add(dbm, 1.0 if dbm > -95 else 0.5, 0.9) for _ in range(5)] and None
        >>> curve.loss_power_dbm()
        (-96.0, True)
        """
        steps = sorted((step for step, count in self.heard.items() if count >= LEAST), reverse=True)
        if not steps:
            return None
        for step in steps:
            if self.bad.get(step, 0) >= FAILING_SHARE * self.heard[step]:
                return STEP_DB * step, True
        return STEP_DB * steps[-1], False
