"""The weather where a train is, from reports by place."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

from schemas.radio import Weather

HOLDS_NS: Final = 3 * 3_600_000_000_000
"""After its time, and before it."""
MOST: Final = 500
"""Places remembered."""


Sky = Callable[[float | None], Weather | None]
"""Weather at a kilometrage during one pass; for None at the site or wherever the train is."""


def no_weather(_place_m: float | None) -> Weather | None:
    """Nothing known of the weather anywhere."""
    return None


class WeatherMap:
    """The last word on the weather by place."""

    def __init__(self) -> None:
        """None."""
        self._words: dict[float, Weather] = {}

    def take(self, word: Weather) -> None:
        """Keep it in place of an older one there."""
        before = self._words.get(word.axis_m)
        if before is None or word.t_ns >= before.t_ns:
            self._words[word.axis_m] = word
        if len(self._words) > MOST:
            del self._words[min(self._words, key=lambda axis_m: self._words[axis_m].t_ns)]

    def at(self, axis_m: float | None, t_ns: int) -> Weather | None:
        """Weather that holds at a place and time, the nearest; for a train without a place, the newest."""
        near = [
            word
            for word in self._words.values()
            if abs(word.t_ns - t_ns) <= HOLDS_NS and (axis_m is None or abs(word.axis_m - axis_m) <= word.reach_m)
        ]
        if not near:
            return None
        if axis_m is None:
            return max(near, key=lambda word: (word.t_ns, -word.axis_m))
        return min(near, key=lambda word: (abs(word.axis_m - axis_m), word.axis_m))


class WeatherDiary:
    """Reports of a whole file, taken as their times come."""

    def __init__(self, words: Iterable[Weather]) -> None:
        """In order of time."""
        self._words = list(words)
        self._map = WeatherMap()
        self._next = 0

    def sky(self, t_ns: int) -> Sky:
        """Weather during a pass; times are asked in rising order."""
        while self._next < len(self._words) and self._words[self._next].t_ns <= t_ns:
            self._map.take(self._words[self._next])
            self._next += 1
        return lambda place_m: self._map.at(place_m, t_ns)
