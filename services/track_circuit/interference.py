"""Foreign tones (inverter lines, harmonics of the mains) found in the averaged spectrum."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

SIZE: Final = 8192
"""Points of the spectrum; a burst is padded to them."""
NEIGHBOURHOOD: Final = 129
"""Bins over which the median around a line is taken."""
FIRST_RATIO: Final = 30.0
"""Power of a line over that median, which no bin of one spectrum of noise reaches."""
LAST_RATIO: Final = 4.0
"""The same for the average of many spectra."""
THINNED: Final = 16
"""Bins for which one median serves."""
SELDOM: Final = 8
"""Bursts between searches where there is no need for more: tones stay, and searching costs as much as receiving."""
FADE: Final = 0.9
"""Share of the averaged spectrum kept from burst to burst."""
SAME: Final = 2e-5
"""Cycles per sample by which a tone may move and is still the same: a twentieth of what a burst resolves."""
MOVED: Final = 3
"""Bins by which a line may have moved since it entered the average: less than a burst resolves."""
NYQUIST: Final = 0.5
MOST_TONES: Final = 24
MAINS_HZ: Final = (50.0, 60.0)
MAINS_TOLERANCE_HZ: Final = 0.5
MAINS_STEP_HZ: Final = 0.002
"""Search step of the mains frequency: half a hertz at the 250th harmonic."""
COMB_SIGMAS: Final = 8.0
"""Excess of the harmonics' mean over its expectation, in standard deviations, that makes a comb."""
WIDEST: Final = 0.1
"""Greatest standard deviation taken for that, relative to the expectation: a comb widens its neighbours' votes."""
COMMON: Final = 0.25
"""Share of that excess which the median of the harmonics must have."""
RELATIVE_LIMIT: Final = 30.0
"""Power over the median at which one line's vote for a comb is cut, so that a single tone makes none."""


class ToneFinder:
    """Averages the spectra of bursts and names the tones that stand out, and the mains comb."""

    def __init__(self, sample_rate_hz: float) -> None:
        """Nothing heard yet."""
        self._rate_hz = sample_rate_hz
        self._power = np.zeros(SIZE)
        self._weight = 0.0
        self._bursts = 0
        self._searched, self._pause = 0, 1
        self._found = np.empty(0)
        self._window = np.empty(0)
        self._latest = self._power
        self.lines = np.empty(0)
        """Of the tones, those that stand out by themselves."""

    def take(self, samples: NDArray[np.complex128]) -> None:
        """Add a burst (at least a few hundred samples; what exceeds SIZE is left out)."""
        part = samples[:SIZE]
        if len(self._window) != len(part):
            self._window = np.blackman(len(part))
        spectrum = np.abs(np.fft.fft(part * self._window, SIZE)) ** 2
        self._power = FADE * self._power + spectrum
        self._latest = spectrum
        self._weight = FADE * self._weight + 1.0
        self._bursts += 1

    def tones(self, carrier_hz: float, *, urgent: bool = False) -> NDArray[np.float64]:
        """Frequencies relative to the carrier in cycles per sample: the mains comb and single lines, ascending.

        The very same array is given until something new is found. `urgent`: seek them more often, for they move.
        """
        pause = min(self._pause, SELDOM) if urgent or self._bursts < SELDOM else SELDOM
        if self._bursts >= self._searched + pause:
            found = np.sort(self._search(carrier_hz))
            moved = len(found) != len(self._found) or np.max(np.abs(found - self._found), initial=0.0) > SAME
            self._pause = 1 if moved else 2 * self._pause
            self._searched = self._bursts
            if moved:
                self._found = found
        return self._found

    def _search(self, carrier_hz: float) -> NDArray[np.float64]:
        if self._weight == 0.0:
            return np.empty(0)
        around = np.pad(self._power, NEIGHBOURHOOD // 2, "wrap")
        median = np.median(np.lib.stride_tricks.sliding_window_view(around, NEIGHBOURHOOD)[::THINNED], axis=1)
        relative = self._power / (np.repeat(median, THINNED)[:SIZE] + 1e-30)
        comb = self._comb(np.minimum(relative, RELATIVE_LIMIT), carrier_hz)
        lines = self._lines(relative)
        if len(comb) and len(lines):
            # What was measured says better where a line stands than the comb, which may be none.
            apart = np.min(np.abs(comb[:, None] - lines[None, :]), axis=1)
            comb = comb[apart > 4.0 / SIZE]
        self.lines = np.sort(lines)
        return np.concatenate([comb, lines])

    def _lines(self, relative: NDArray[np.float64]) -> NDArray[np.float64]:
        power, before, after = self._power, np.roll(self._power, 1), np.roll(self._power, -1)
        ratio = LAST_RATIO + (FIRST_RATIO - LAST_RATIO) / self._weight
        lines = np.flatnonzero((relative > ratio) & (power > before) & (power >= after))
        lines = lines[np.argsort(power[lines])[::-1]][:MOST_TONES]
        # Where a strong line stands by now, the latest burst says better than the average.
        near = (lines[:, None] + np.arange(-MOVED, MOVED + 1)) % SIZE
        newest = near[np.arange(len(lines)), np.argmax(self._latest[near], axis=1)]
        now, peak = self._latest, self._latest[newest]
        crest = (peak >= now[(newest - 1) % SIZE]) & (peak >= now[(newest + 1) % SIZE])
        lines = np.where(crest & (relative[lines] > FIRST_RATIO), newest, lines)
        left, middle, right = (np.log(now[(lines + step) % SIZE] + 1e-300) for step in (-1, 0, 1))
        shift = np.clip(0.5 * (left - right) / (left - 2.0 * middle + right - 1e-12), -0.5, 0.5)
        return np.unique(np.asarray(((lines + shift) / SIZE + 0.5) % 1.0 - 0.5, np.float64))

    def _comb(self, relative: NDArray[np.float64], carrier_hz: float) -> NDArray[np.float64]:
        """Harmonics of the mains within the band, if they stand out together."""
        half = 0.5 * self._rate_hz
        for nominal in MAINS_HZ:
            order = np.arange(np.ceil((carrier_hz - half) / nominal), np.floor((carrier_hz + half) / nominal) + 1)
            order = order[order > 0]
            grid = nominal + np.arange(-MAINS_TOLERANCE_HZ, MAINS_TOLERANCE_HZ, MAINS_STEP_HZ)
            place = (grid[:, None] * order - carrier_hz) / self._rate_hz
            places = np.rint(place * SIZE).astype(np.int64) % SIZE
            score = relative[places].mean(axis=1)
            best = int(np.argmax(score))
            middle = float(np.median(score))
            spread = min(1.48 * float(np.median(np.abs(score - middle))), WIDEST * middle)
            # Of a comb most harmonics stand out, not one or two alone.
            common = float(np.median(relative[places[best]]) - np.median(relative))
            if score[best] > middle + COMB_SIGMAS * spread and common > COMMON * (score[best] - middle):
                inside = np.abs(place[best]) < NYQUIST
                return np.asarray(place[best][inside], np.float64)
        return np.empty(0)
