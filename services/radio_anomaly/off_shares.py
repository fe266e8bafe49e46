"""How much of what was heard on a pass is off its mean the same way: one place, one radio, or all of them."""

from __future__ import annotations

from typing import Final

import numpy as np

from services.radio_anomaly.monitor import Judgement
from services.radio_anomaly.stream_state import POWERS

OFF_SCORE: Final = 1.0
"""A section this many standard deviations off the same way counts as going with an event."""
OTHERS_OFF_SHARE: Final = 0.5
"""Of another radio's sections, for that radio to count as off."""


class OffShares:
    """Of each radio and channel on a pass, the share of its sections that are off one way."""

    def __init__(self, judgement: Judgement) -> None:
        """From the scores of its power, or of its decoded power where there is no other."""
        self.missing = {(s.radio, s.channel) for s in judgement.silences}
        self.of: dict[tuple[str, str], dict[float, tuple[float, int]]] = {}
        for quantity in ("reception", *reversed(POWERS)):
            for stream, view in judgement.views.items():
                if stream[0] == quantity:
                    scores = np.concatenate([test.z for test in view.tests])
                    self.of[stream[1:]] = {
                        sign: (float((sign * scores >= OFF_SCORE).mean()), len(scores)) for sign in (-1.0, 1.0)
                    }
        self.keys = self.of.keys() | self.missing
        self._off = {
            sign: {key for key in self.keys if key in self.missing or self.of[key][sign][0] >= OTHERS_OFF_SHARE}
            for sign in (-1.0, 1.0)
        }

    def others(self, key: tuple[str, str], sign: float) -> tuple[float | None, int]:
        """Share of the other radios most of whose sections are off the same way or silent, and how many they are."""
        count = len(self.keys - {key})
        return (len(self._off[sign] - {key}) / count if count else None), count
