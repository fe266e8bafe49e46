"""Detection of multipath by the change of pseudoranges (Yoshinaga et al. 2008, section 3).

D(x) = |Pd(x) - Pd(x-1)|,  d_n = mean of the last n D,  Pc(x) = |D(x) - d_n|

A satellite is held for multipath while Pc exceeds a threshold (0.45 m per 0.2 s). The mean goes
on taking in every change, so that the end of a stretch is noticed. Real intervals vary, hence
every D is divided by its own interval first and Pc is scaled to the nominal 0.2 s.

The substituted pseudorange is the previous one (substituted or measured) plus the mean *signed*
rate times the interval: with the unsigned mean an approaching satellite would run away. Doppler and
carrier phase are substituted consistently, which the paper names as missing (section 4.3): the
Doppler by its own mean over the same window, the carrier by the previous one moved on by it.

A drift of the receiver's clock is in every D and in its mean alike and cancels in Pc while it
is steady; jumps of whole milliseconds are taken out before (clock_jump.py).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from schemas.thresholds import Thresholds
from services.gnss_correction.clock_jump import MILLISECOND_M, clock_jump_ms
from services.gnss_correction.settings import Config
from services.gnss_receiver.observations import SYSTEMS

NOMINAL_INTERVAL_S: Final = 0.2
"""Interval to which changes and thresholds are scaled (paper, 4.4)."""


class Sight(NamedTuple):
    """A pseudorange to be judged."""

    satellite: int
    signal: int
    pseudorange_m: float
    range_rate_mps: float
    """From Doppler; NaN where there is none."""
    elevation_rad: float
    """NaN where it is not known."""
    carrier_m: float = math.nan
    """Carrier phase times wavelength; NaN where there is none."""


class Substitute(NamedTuple):
    """What was to be expected of a satellite, in place of what was measured: consistent with one another."""

    pseudorange_m: float
    range_rate_mps: float
    """Mean of the latest Dopplers as the pseudorange's is of its changes; without Doppler that one itself."""
    carrier_m: float
    """The carrier phase before, substituted or measured, moved on by this range rate; NaN where there is none."""


class Judgement(NamedTuple):
    """What the detector makes of a pseudorange."""

    watched_epochs: int
    """Changes in the mean so far; a judgement needs a full window."""
    change_m: float | None = None
    """Pc per nominal interval; None until the window is full."""
    threshold_m: float | None = None
    flagged: bool = False
    substitute: Substitute | None = None
    """Where the satellite's observables may be substituted."""


class _Track:
    """One satellite's past on one signal."""

    __slots__ = (
        "adjusting_from_s",
        "carrier_m",
        "clock_ms",
        "dopplers_mps",
        "followed_m",
        "pseudorange_m",
        "range_rate_mps",
        "rates_mps",
        "signal",
        "t_s",
    )

    def __init__(self, t_s: float, sight: Sight, clock_ms: int, window: int) -> None:
        self.signal = sight.signal
        self.clock_ms = clock_ms
        self.t_s = t_s
        self.pseudorange_m = self.followed_m = sight.pseudorange_m
        self.carrier_m = sight.carrier_m
        self.range_rate_mps = sight.range_rate_mps
        self.rates_mps: deque[float] = deque(maxlen=window)
        self.dopplers_mps: deque[float] = deque([sight.range_rate_mps], maxlen=window)
        self.adjusting_from_s: float | None = None

    def mean_doppler_mps(self, otherwise_mps: float) -> float:
        """Mean range rate by Doppler over the window, where there is one."""
        given = [rate for rate in self.dopplers_mps if math.isfinite(rate)]
        return sum(given) / len(given) if given else otherwise_mps

    def predicted_change_m(self, sight: Sight, interval_s: float) -> float:
        """Change to be expected by Doppler, else by the latest rate, else none."""
        rate_mps = 0.5 * (self.range_rate_mps + sight.range_rate_mps)
        if not math.isfinite(rate_mps):
            rate_mps = self.rates_mps[-1] if self.rates_mps else 0.0
        return rate_mps * interval_s


class MultipathDetector:
    """Watches every satellite of one receiver. Feed it one epoch after the other; a step back starts anew."""

    def __init__(self, config: Config, thresholds: Thresholds | None = None) -> None:
        """Know no satellite yet. Without `thresholds` of the receiver those of the settings hold."""
        self._config = config
        self._thresholds = thresholds
        self._tracks: dict[int, _Track] = {}
        self._clock_ms = 0
        """Sum of the jumps so far."""
        self.clock_jumps = 0
        """Jumps of the receiver's clock taken out so far."""

    def judge(self, t_s: float, sights: Sequence[Sight]) -> list[Judgement]:
        """Judgement of each sight of the epoch at `t_s`, in their order.

        A satellite that is new, back after more than the longest gap or at an earlier time, or on
        another signal is watched from anew.
        """
        known = {}
        for sight in sights:
            track = self._tracks.get(sight.satellite)
            if track and track.signal == sight.signal and 0.0 < t_s - track.t_s <= self._config.longest_gap_s:
                known[sight.satellite] = track
        self._follow_clock(t_s, sights, known)
        judgements = []
        for sight in sights:
            track = known.get(sight.satellite)
            if track is None:
                self._tracks[sight.satellite] = _Track(t_s, sight, self._clock_ms, self._config.window_epochs)
                judgements.append(Judgement(watched_epochs=0))
            else:
                judgements.append(self._follow(track, t_s, sight))
        return judgements

    def _follow_clock(self, t_s: float, sights: Sequence[Sight], known: dict[int, _Track]) -> None:
        """Count a jump of the receiver's clock since the epoch before."""
        unpredicted_m = [
            sight.pseudorange_m
            - track.pseudorange_m
            - (self._clock_ms - track.clock_ms) * MILLISECOND_M
            - track.predicted_change_m(sight, t_s - track.t_s)
            for sight in sights
            if (track := known.get(sight.satellite))
        ]
        jump_ms = clock_jump_ms(unpredicted_m)
        self._clock_ms += jump_ms
        self.clock_jumps += jump_ms != 0

    def _follow(self, track: _Track, t_s: float, sight: Sight) -> Judgement:
        jump_ms = self._clock_ms - track.clock_ms
        jump_m = jump_ms * MILLISECOND_M
        interval_s = t_s - track.t_s - jump_ms * 1e-3
        if interval_s <= 0.0:
            self._tracks[sight.satellite] = _Track(t_s, sight, self._clock_ms, self._config.window_epochs)
            return Judgement(watched_epochs=0)
        rate_mps = (sight.pseudorange_m - track.pseudorange_m - jump_m) / interval_s
        window = list(track.rates_mps)
        if self._config.mean_includes_current:
            window = [*window, rate_mps][-self._config.window_epochs :]
        track.rates_mps.append(rate_mps)
        judgement = Judgement(watched_epochs=len(window))
        if len(window) == self._config.window_epochs:
            judgement = self._compare(
                track, t_s, sight.satellite, sight.elevation_rad, jump_m, interval_s, rate_mps, window
            )
        if not judgement.flagged:
            track.adjusting_from_s = None
        track.followed_m, track.carrier_m = sight.pseudorange_m, sight.carrier_m
        if judgement.substitute is not None:
            track.followed_m, _, track.carrier_m = judgement.substitute
        track.dopplers_mps.append(sight.range_rate_mps)
        track.t_s, track.clock_ms = t_s, self._clock_ms
        track.pseudorange_m, track.range_rate_mps = sight.pseudorange_m, sight.range_rate_mps
        return judgement

    def _threshold_m(self, satellite: int, elevation_rad: float) -> float:
        """Threshold by the receiver's own file where that covers the satellite, else by the paper's rule."""
        if self._thresholds is not None:
            own_m = self._thresholds.threshold_m(SYSTEMS[satellite // 100], math.degrees(elevation_rad))
            if own_m is not None:
                return own_m
        extra_m = self._config.near_horizon_extra_m
        low = elevation_rad < math.radians(self._config.near_horizon_deg)
        return self._config.threshold_m + (extra_m if low else 0.0)

    def _compare(
        self,
        track: _Track,
        t_s: float,
        satellite: int,
        elevation_rad: float,
        jump_m: float,
        interval_s: float,
        rate_mps: float,
        window: list[float],
    ) -> Judgement:
        config = self._config
        mean_mps = sum(abs(rate) for rate in window) / len(window)
        change_m = abs(abs(rate_mps) - mean_mps) * NOMINAL_INTERVAL_S
        threshold_m = self._threshold_m(satellite, elevation_rad)
        if change_m <= threshold_m:
            return Judgement(len(window), change_m, threshold_m)
        if track.adjusting_from_s is None:
            track.adjusting_from_s = track.t_s
        substitute = None
        if t_s - track.adjusting_from_s <= config.longest_adjusting_s:
            mean_signed_mps = sum(window) / len(window)
            doppler_mps = track.mean_doppler_mps(mean_signed_mps)
            substitute = Substitute(
                track.followed_m + jump_m + mean_signed_mps * interval_s,
                doppler_mps,
                track.carrier_m + jump_m + doppler_mps * interval_s,
            )
        return Judgement(len(window), change_m, threshold_m, True, substitute)  # noqa: FBT003 - in the order of the fields
