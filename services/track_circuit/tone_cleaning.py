"""Bursts received with foreign tones taken out, where that makes them better."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.channel_estimate import response
from services.track_circuit.interference import ToneFinder
from services.track_circuit.modulate import spread
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Burst, Receiver, Reception
from services.track_circuit.synchronisation_tracking import burst_response
from services.track_circuit.tone_removal import ToneRemoval
from services.track_circuit.walsh import code

OWN_CHIP_RATES: Final = 0.0125
"""CH1's own lines, where its data repeat, are no further than this from half the chip rate off the carrier."""
CLEANER_DB: Final = 0.2
"""By how much a burst must become better for more tones to be taken out of it."""
WORSE_DB: Final = 1.5
"""By how much the next bursts may be worse than the one by which that was decided, before it is decided anew."""
URGENT_DB: Final = 2.0
"""By how much the latest burst must be worse than the best of late for tones to be sought before their time."""
FORGET_DB: Final = 0.05
"""By how much the least error of late rises from burst to burst."""
GOOD_DB: Final = -14.0
"""A burst with less error has no wrong decision to be mended: nothing more is tried."""

DOUBTFUL_DB: Final = -8.0
"""Above, decisions are so often wrong that it pays to measure the tones once more behind the signal."""

NONE: Final = np.empty(0)


@dataclass(frozen=True, slots=True)
class _Received:
    """A burst received one way, and the receiver that learned from it."""

    receiver: Receiver
    found: Reception
    burst: Burst


class CleanReception:
    """A receiver behind a search for tones.

    CH1 itself may be a tone for a time, and a comb may be none. So there are several ways to receive a burst: as it is,
    without the lines that cannot be CH1's, without all lines, without the comb as well; and where decisions are
    doubtful, the signal is taken away before the tones are measured once more. All ways are tried for the first burst
    after each search, and when the best one gets worse; in between, that one alone.
    """

    def __init__(self, profile: Profile, receiver: Receiver) -> None:
        """Nothing heard yet."""
        self._profile, self._receiver = profile, receiver
        self._code1 = code(profile.code_length, profile.ch1_row)
        self._code2 = profile.ch2_amplitude * code(profile.code_length, profile.ch2_row)
        self._finder = ToneFinder(2.0 * profile.chip_rate_hz)
        self._found = NONE
        self._count = 0
        self._ways: list[NDArray[np.float64]] = [NONE]
        """Tones taken out in each."""
        self._removals: dict[int, ToneRemoval] = {}
        """By number of the way; made when first tried."""
        self._best = 0
        self._least_db = -np.inf
        """Error of the best way when all were tried last."""
        self._latest_db = self._usual_db = -np.inf

    def receive(self, burst: Burst, carrier_hz: float) -> tuple[Reception, Burst, NDArray[np.float64]]:
        """The reception, the samples that it is of, and the tones taken out in cycles per sample."""
        self._finder.take(burst.samples)
        tones = self._finder.tones(carrier_hz, urgent=self._latest_db > max(self._usual_db + URGENT_DB, GOOD_DB))
        if tones is not self._found or len(burst.samples) != self._count:
            self._prepare(tones, len(burst.samples))
        if len(self._ways) == 1:
            found = self._receiver.receive(burst)
            self._heard(found.evm_db)
            return found, burst, NONE
        received = self._received(burst, self._best)
        if received.found.evm_db > max(self._least_db + WORSE_DB, GOOD_DB):
            received = self._tried(burst, received)
            self._least_db = received.found.evm_db
        self._receiver = received.receiver
        self._heard(received.found.evm_db)
        return received.found, received.burst, self._ways[self._best]

    def _heard(self, error_db: float) -> None:
        """The latest error, and the least of late."""
        self._latest_db = error_db
        usual_db = self._usual_db + FORGET_DB if np.isfinite(self._usual_db) else error_db
        self._usual_db = min(usual_db, error_db)

    def _prepare(self, tones: NDArray[np.float64], count: int) -> None:
        """Ways to receive bursts of `count` samples: each takes out more than the one before."""
        self._found, self._count, self._least_db = tones, count, -np.inf
        lines = self._finder.lines
        own = np.abs(np.abs(lines) - 0.25) < 0.5 * OWN_CHIP_RATES
        parts = (lines[~own], lines) if len(lines) == len(tones) else (lines, tones)
        sets = {len(part): part for part in parts}
        self._ways, self._removals = [NONE, *(part for size, part in sets.items() if size)], {}
        self._best = min(self._best, len(self._ways) - 1)

    def _received(self, burst: Burst, number: int) -> _Received:
        """One way; where decisions are doubtful, tones are measured once more behind the signal."""
        receiver = self._receiver.copied()
        if not number:
            return _Received(receiver, receiver.receive(burst), burst)
        if number not in self._removals:
            self._removals[number] = ToneRemoval(self._ways[number], self._count)
        way = self._removals[number]
        cleaned = _without(way.tones_in(burst.samples), burst)
        first = _Received(receiver, receiver.receive(cleaned), cleaned)
        if first.found.evm_db < DOUBTFUL_DB:
            return first
        again = _without(way.tones_in(burst.samples - self._signal(first)), burst)
        other = self._receiver.copied()
        second = _Received(other, other.receive(again), again)
        return second if second.found.evm_db < first.found.evm_db else first

    def _signal(self, received: _Received) -> NDArray[np.complex128]:
        """What the decided symbols make of the burst's samples."""
        samples, decided = received.burst.samples, np.where(received.found.soft < 0.0, -1.0, 1.0)
        chips = spread(received.burst.pilots, self._code2) + spread(decided, self._code1)
        model = response(burst_response(samples, chips), chips)[: len(samples)]
        return np.concatenate([model, np.zeros(len(samples) - len(model))])

    def _tried(self, burst: Burst, latest: _Received) -> _Received:
        """The burst by the best of all ways; `latest` is what the one of the last bursts gives."""
        numbers = range(len(self._ways))
        every = [(number, latest if number == self._best else self._received(burst, number)) for number in numbers]
        self._best, best = every[0]
        for number, received in every[1:]:
            if received.found.evm_db < best.found.evm_db - CLEANER_DB:
                self._best, best = number, received
        return best


def _without(tones: NDArray[np.complex128], burst: Burst) -> Burst:
    return Burst(burst.samples - tones, burst.pilots, burst.known)
