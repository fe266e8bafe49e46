"""How much of what was heard on a pass is off its mean the same way: one place, one radio, or all of them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Final

import msgspec
import numpy as np

from services.radio_anomaly.monitor import Judgement
from services.radio_anomaly.passes import plain
from services.radio_anomaly.stream_state import POWERS, View

OFF_SCORE: Final = 1.0
"""A section this many standard deviations off the same way counts as going with an event."""
OTHERS_OFF_SHARE: Final = 0.5
"""Of another radio's sections, for that radio to count as off."""
NOTHING_RATIO: Final = 0.05
"""Reception up to this is none."""

Place = tuple[str, int]
"""Channel and section."""


class Range(msgspec.Struct, frozen=True, kw_only=True):
    """One radio on a pass, over all of its channels and all of the range in which it was learned."""

    passed: int = 0
    """Sections of its range that the train was in so far,"""
    learned: int = 0
    """of so many, in this direction."""
    dead_share: float | None = None
    """Of its places heard or expected, those with no reception at all; None without any."""
    louder_share: float = 0.0
    """Of its places with a channel power, those where that is above its mean."""
    elsewhere: int = 0
    """Its places outside the stretch in question,"""
    elsewhere_share: float = 0.0
    """and of those the share that is off the same way, or silent."""

    @property
    def whole(self) -> bool:
        """Whether nearly all of its range was passed."""
        return self.learned > 0 and self.passed >= WHOLE_SHARE * self.learned


WHOLE_SHARE: Final = 0.8


class OffShares:
    """Of each radio on a pass, the share of its places that are off one way."""

    def __init__(self, judgement: Judgement) -> None:
        """From the scores of its power, or of its decoded power where there is no other, else of its reception."""
        self._silent: defaultdict[str, set[Place]] = defaultdict(set)
        for one in judgement.silences:
            self._silent[one.radio].update((one.channel, one.start + k) for k in range(one.length))
        self._score: defaultdict[str, dict[Place, float]] = defaultdict(dict)
        self._ratio: defaultdict[str, dict[Place, float]] = defaultdict(dict)
        self._louder: defaultdict[str, dict[Place, bool]] = defaultdict(dict)
        for quantity in ("reception", *reversed(POWERS)):
            for (of, radio, channel), view in judgement.views.items():
                if of == quantity:
                    scores = _scores(view)
                    self._score[radio].update(((channel, s), z) for s, z in scores.items())
                    if quantity == "reception":
                        values = zip(view.residuals.sections, view.values, strict=True)
                        self._ratio[radio].update(((channel, int(s)), plain(quantity, float(v))) for s, v in values)
                    elif quantity == "power":
                        self._louder[radio].update(((channel, s), z >= OFF_SCORE) for s, z in scores.items())
        self._radios = self._score.keys() | self._silent.keys()
        self._off = {sign: {radio for radio in self._radios if self._mostly(radio, sign)} for sign in (-1.0, 1.0)}

    def _mostly(self, radio: str, sign: float) -> bool:
        share, count = self.of(radio, sign)
        return bool(self._silent.get(radio)) or (count > 0 and share >= OTHERS_OFF_SHARE)

    def of(self, radio: str, sign: float) -> tuple[float, int]:
        """Share of a radio's places on all its channels that are off one way, and how many places were heard."""
        scores = self._score.get(radio, {})
        return _share(sign * score >= OFF_SCORE for score in scores.values()), len(scores)

    def others(self, radio: str, sign: float) -> tuple[float | None, int]:
        """Share of the other radios most of whose places are off the same way or silent, and how many they are."""
        count = len(self._radios - {radio})
        return (len(self._off[sign] - {radio}) / count if count else None), count

    def range_of(self, radio: str, sign: float, stretch: tuple[int, int], learned: set[int], passed: set[int]) -> Range:
        """The radio over its range; `learned` are its sections in this direction, `stretch` (0, 0) the whole line."""
        silent, scores, ratios = self._silent.get(radio, set()), self._score.get(radio, {}), self._ratio.get(radio, {})
        elsewhere = [
            place in silent or sign * scores.get(place, 0.0) >= OFF_SCORE
            for place in scores.keys() | silent
            if stretch[1] and not stretch[0] <= place[1] < stretch[0] + stretch[1]
        ]
        # Where reception was never good it tells nothing; where none is measured, what was heard at all was received.
        measured = (ratios or scores).keys() | silent
        return Range(
            passed=len(learned & passed),
            learned=len(learned),
            dead_share=(
                _share(place in silent or ratios.get(place, 1.0) <= NOTHING_RATIO for place in measured)
                if measured
                else None
            ),
            louder_share=_share(self._louder.get(radio, {}).values()),
            elsewhere=len(elsewhere),
            elsewhere_share=_share(elsewhere),
        )


def _scores(view: View) -> dict[int, float]:
    """Standard deviations off the mean, by section."""
    scores = np.concatenate([test.z for test in view.tests])
    return {int(section): float(z) for section, z in zip(view.residuals.sections, scores, strict=True)}


def _share(flags: Iterable[bool]) -> float:
    listed = list(flags)
    return sum(listed) / len(listed) if listed else 0.0
