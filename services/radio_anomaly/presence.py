"""Samples that were expected and did not come: a state of its own, as interference leaves no sample at all."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Final

import msgspec

from services.radio_anomaly.passes import Journey
from services.radio_anomaly.settings import Settings

LEAST_PASSED: Final = 4
SURE_SHARE: Final = 0.9
"""Of the passes through a section that heard the radio there: below it, silence is nothing new."""


class Silence(msgspec.Struct, frozen=True):
    """Neighbouring sections in which a radio and channel was not heard."""

    radio: str
    channel: str
    start: int
    length: int
    expected: float
    """Smallest share of earlier passes that heard it there."""
    passes: int
    """Earlier passes that the share is of, the smallest."""
    confirmed: bool


class Presence:
    """Who was heard where, of the passes that went there."""

    def __init__(self) -> None:
        """Of nobody."""
        self.passed: dict[tuple[str, int], float] = {}
        """By direction and section, of every radio's passes,"""
        self.heard: dict[tuple[str, str, str, int], float] = {}
        """and by radio, channel, direction, section."""
        self.since: dict[tuple[str, str, str, int], float] = {}
        """Passes through a section before the radio was heard there first."""
        self.silent: set[tuple[str, str, int]] = set()
        """Radio, channel, section that the last pass there did not hear and should have."""

    def learn(self, journey: Journey) -> None:
        """Count a normal pass."""
        for section in journey.passed:
            key = (journey.direction, section)
            self.passed[key] = self.passed.get(key, 0.0) + 1.0
        for radio, channel, section in journey.heard:
            full = (radio, channel, journey.direction, section)
            if full not in self.heard:
                self.since[full] = self.passed[(journey.direction, section)] - 1.0
            self.heard[full] = self.heard.get(full, 0.0) + 1.0

    def share(self, radio: str, channel: str, direction: str, section: int) -> tuple[float, float]:
        """Share of passes that heard it since it first did, and how many passes those are."""
        full = (radio, channel, direction, section)
        if full not in self.heard:
            return 0.0, 0.0
        passes = self.passed[(direction, section)] - self.since[full]
        return self.heard[full] / passes, passes

    def streams(self) -> set[tuple[str, str]]:
        """Radios and channels ever heard."""
        return {key[:2] for key in self.heard}

    def ranges(self, direction: str) -> dict[str, set[int]]:
        """Of every radio, the sections in which it was ever heard in a direction, on any channel."""
        found: defaultdict[str, set[int]] = defaultdict(set)
        for radio, _, way, section in self.heard:
            if way == direction:
                found[radio].add(section)
        return found

    def missing(self, journey: Journey, settings: Settings) -> list[Silence]:
        """Runs of sections in which a radio was expected and not heard.

        Confirmed: as long as `missing_certain`, or silent on the last pass there too.
        """
        found: list[Silence] = []
        for radio, channel in sorted(self.streams()):
            run: list[tuple[int, float, float]] = []
            for section in journey.passed:
                share, passes = self.share(radio, channel, journey.direction, section)
                expected = passes >= LEAST_PASSED and share >= SURE_SHARE
                gone = expected and (radio, channel, section) not in journey.heard
                if run and (not gone or section != run[-1][0] + 1):
                    found.append(self._silence(radio, channel, run, settings))
                    run = []
                if gone:
                    run.append((section, share, passes))
            if run:
                found.append(self._silence(radio, channel, run, settings))
        return found

    def _silence(self, radio: str, channel: str, run: list[tuple[int, float, float]], settings: Settings) -> Silence:
        again = any((radio, channel, section) in self.silent for section, _, _ in run)
        return Silence(
            radio,
            channel,
            run[0][0],
            len(run),
            min(share for _, share, _ in run),
            int(min(passes for _, _, passes in run)),
            confirmed=again or len(run) >= settings.missing_certain,
        )

    def remember(self, journey: Journey, silences: Iterable[Silence]) -> None:
        """Keep in mind where this pass heard nothing, for the next one's confirmation."""
        gone = {(one.radio, one.channel, one.start + k) for one in silences for k in range(one.length)}
        passed = set(journey.passed)
        self.silent = {key for key in self.silent if key[2] not in passed} | gone
