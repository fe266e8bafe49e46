"""Foreign tones worth telling: those that stay, once each, and anew after they were gone for a while."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from services.track_circuit.profile import Profile

STAYED_S: Final = 1.0
"""Time in symbols over which a tone must have been found, not necessarily in a row."""
GONE_S: Final = 60.0
BUCKET_HZ: Final = 10.0
OWN_HZ: Final = 30.0
"""CH1 itself stands so near half the chip rate from the carrier, as lines where its data repeat."""


@dataclass
class _Tone:
    stayed_s: float = 0.0
    seen_s: float = 0.0
    told: bool = False


class ToneWatch:
    """The tones of one circuit."""

    def __init__(self, profile: Profile) -> None:
        """Nothing heard yet."""
        self._own_hz = (
            profile.carrier_hz - profile.chip_rate_hz / 2.0,
            profile.carrier_hz + profile.chip_rate_hz / 2.0,
        )
        self._tones: dict[int, _Tone] = {}

    def take(self, lines_hz: tuple[float, ...], symbols_s: float, now_s: float) -> list[float]:
        """Tones to be told now, after symbols of some length in which `lines_hz` were found."""
        self._tones = {key: tone for key, tone in self._tones.items() if now_s - tone.seen_s < GONE_S}
        new = []
        for key, hz in {round(hz / BUCKET_HZ): hz for hz in lines_hz}.items():
            if any(abs(hz - own) < OWN_HZ for own in self._own_hz):
                continue
            tone = self._tones.setdefault(key, _Tone())
            tone.stayed_s += symbols_s
            tone.seen_s = now_s
            if tone.stayed_s >= STAYED_S and not tone.told:
                tone.told = True
                new.append(hz)
        return new
