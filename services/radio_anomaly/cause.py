"""What may be behind an event, told from what goes with it.

Nakaune (Radio Wave Monitor in the Wireless Train Control System Utilizing AI, Table 1) reads power above the
threshold as interference, and below as dead zone, fault or snow. Measured on decoded frames it is not so: a
strong interferer lowers the power of what is still decoded, or leaves nothing to measure. So channel power,
decoded power and reception are weighed against each other, and one radio's stretch against all that was heard.
"""

from __future__ import annotations

from typing import Final

import msgspec

from schemas.radio import Cause, Kind, Weather

ALIKE: Final = 0.8
"""Share of a radio's sections, or of a site's radios, that counts as all of them."""
FEW: Final = 3
"""With fewer there is no telling what all of them do."""
SNOW_STRETCH_M: Final = 1000.0
"""Snow on an antenna or along the line does not end after a section."""
PLACE_M: Final = 3000.0
"""A cutting, a building, a parked train shades no more."""
FREEZING_C: Final = 1.5
"""Warmest air in which precipitation stays as snow."""
STRONG_DB: Final = 6.0
"""Above the power at which reception fails, power does not explain lost frames."""


class Circumstances(msgspec.Struct, frozen=True, kw_only=True):
    """What goes with a stretch. None: not measured."""

    kind: Kind
    length_m: float
    quantity: str = "power"
    """What the event is about, by its name in the analysis."""
    at_site: bool = False
    whole_line: bool = False
    """The change is that of the whole line (precursor)."""
    power_db: float | None = None
    """Change of channel power,"""
    decoded_db: float | None = None
    """of decoded power,"""
    received_ratio: float | None = None
    """ratio now,"""
    normal_ratio: float | None = None
    """and as learned."""
    strength_db: float | None = None
    """Decoded power now above the power at which reception fails, where most frames are lost."""
    transmit_db: float | None = None
    """Change of transmit power."""
    radio_share: float = 0.0
    """Of this radio's sections on the pass, those off the same way."""
    radio_sections: int = 0
    other_share: float | None = None
    """Of the other radios on the pass, those off the same way."""
    other_radios: int = 0
    range_passed: int | None = None
    """Sections of this radio's range that the train was in so far; None where its range does not matter or is not
    known,"""
    range_learned: int = 0
    """of so many."""
    dead_share: float | None = None
    """Of this radio's sections and channels on the pass, those without any reception."""
    louder_share: float = 0.0
    """Of them, those with more channel power than usual."""
    elsewhere_sections: int = 0
    """This radio's sections outside the stretch on the pass,"""
    elsewhere_share: float = 0.0
    """and of those the share that falls alike."""
    weather: Weather | None = None

    @property
    def whole_range(self) -> bool:
        """Whether the train was in nearly all of the radio's range."""
        return self.range_passed is not None and self.range_passed >= ALIKE * self.range_learned


def cause_of(seen: Circumstances) -> tuple[Cause, str]:
    """The likeliest cause, and the words for it."""
    for rule in (_own, _transmitter, _dead, _interference, _snow, _site, _device, _too_early):
        told = rule(seen)
        if told is not None:
            return told
    if seen.kind == "above":
        return "interference", "more power than ever learned here, and no reception measured that speaks against it"
    if seen.kind == "missing" and seen.normal_ratio is None:
        return "unknown", "nothing at all was heard that would tell a cause"
    if not seen.at_site and not seen.whole_line and seen.length_m <= PLACE_M:
        return "obstruction", f"only this place falls ({seen.length_m:.0f} m), the radio elsewhere does not"
    return "unknown", "nothing measured tells one cause from another"


def snowing(weather: Weather | None) -> bool:
    """Whether snow may lie or fall where a weather report holds."""
    if weather is None:
        return False
    cold = weather.temperature_c is not None and weather.temperature_c <= FREEZING_C
    return bool(
        (weather.snow_mm_per_h or 0.0) > 0.0
        or (weather.snow_depth_cm or 0.0) > 0.0
        or (cold and (weather.rain_mm_per_h or 0.0) > 0.0)
    )


def _own(seen: Circumstances) -> tuple[Cause, str] | None:
    """What nothing along the line changes."""
    if seen.quantity not in OWN:
        return None
    return "device", f"{OWN[seen.quantity]} is the device's own"


OWN: Final = {"temperature": "its temperature", "frequency": "its frequency"}


def _transmitter(seen: Circumstances) -> tuple[Cause, str] | None:
    change = seen.decoded_db if seen.decoded_db is not None else seen.power_db
    if seen.transmit_db is None or change is None or seen.transmit_db * change <= 0.0:
        return None
    if abs(seen.transmit_db) < max(0.5 * abs(change), 1.0):
        return None
    return "device", f"the transmitter itself reports {seen.transmit_db:+.1f} dB"


def _dead(seen: Circumstances) -> tuple[Cause, str] | None:
    """A radio that is not received anywhere, and in whose place nobody else is louder."""
    if seen.kind == "above" or seen.at_site or seen.dead_share is None or seen.range_passed is None:
        return None
    if seen.dead_share < ALIKE or seen.louder_share > LOUDER_SHARE or seen.range_passed < FEW or not seen.whole_range:
        return None
    if seen.other_radios and seen.other_share is not None and seen.other_share >= ALIKE:
        return "device", "no radio is received anywhere on this pass: the train's own receiver or antenna"
    return (
        "device",
        f"nothing of this radio is received on any channel in the {seen.range_passed} sections of its range",
    )


LOUDER_SHARE: Final = 0.2


def _interference(seen: Circumstances) -> tuple[Cause, str] | None:
    lost = (
        seen.received_ratio is not None
        and seen.normal_ratio is not None
        and seen.received_ratio < seen.normal_ratio - LOST_SHARE
    )
    ratios = (
        f"reception {seen.received_ratio:.0%} against {seen.normal_ratio:.0%}"
        if seen.received_ratio is not None and seen.normal_ratio is not None
        else ""
    )
    if seen.power_db is not None and seen.decoded_db is not None:
        gap_db = seen.power_db - seen.decoded_db
        if gap_db >= GAP_DB and seen.power_db > -GAP_DB:
            words = f"channel power {seen.power_db:+.1f} dB, decoded power {seen.decoded_db:+.1f} dB"
            return "interference", f"the channel carries what is not decoded: {words}{', ' if ratios else ''}{ratios}"
        if seen.kind == "above" and not lost:
            return "unknown", f"the wanted signal itself is stronger ({seen.decoded_db:+.1f} dB decoded)"
    if lost and seen.power_db is not None and seen.power_db > -UNCHANGED_DB:
        return "interference", f"{ratios} although channel power is {seen.power_db:+.1f} dB off its mean"
    known = [change for change in (seen.power_db, seen.decoded_db) if change is not None]
    if seen.quantity == "bits" and not seen.whole_line and known and min(known) > -UNCHANGED_DB:
        return "interference", f"more bits need correcting although power is {min(known):+.1f} dB off its mean"
    weaker = seen.decoded_db is not None and seen.decoded_db < -GAP_DB
    if lost and not weaker and seen.strength_db is not None and seen.strength_db > STRONG_DB:
        return "interference", f"{ratios} although decoded power is {seen.strength_db:.0f} dB above what it needs"
    return None


LOST_SHARE: Final = 0.05
GAP_DB: Final = 3.0
UNCHANGED_DB: Final = 1.0
"""At the edge of its range a radio loses frames by a decibel or two of power: less than this explains none."""


def _snow(seen: Circumstances) -> tuple[Cause, str] | None:
    if seen.kind == "above" or not snowing(seen.weather):
        return None
    if seen.at_site or seen.whole_line or seen.length_m >= SNOW_STRETCH_M or seen.radio_share >= ALIKE:
        return "snow", "snow is reported here, and a long stretch falls alike"
    return None


def _site(seen: Circumstances) -> tuple[Cause, str] | None:
    if not seen.at_site or seen.other_radios < FEW or seen.other_share is None:
        return None
    if seen.other_share >= SITE_SHARE and seen.kind != "above":
        words = f"{seen.other_share:.0%} of {seen.other_radios} other links here fall in the same period"
        return "interference", f"{words}, which no single device or obstacle does"
    return None


SITE_SHARE: Final = 0.6


def _device(seen: Circumstances) -> tuple[Cause, str] | None:
    if seen.kind == "above":
        return None
    if seen.whole_line or (seen.radio_sections >= LEAST_SECTIONS and seen.radio_share >= ALIKE):
        if seen.other_radios and seen.other_share is not None and seen.other_share >= ALIKE:
            return "device", "every section of every radio falls alike: the train's own receiver or antenna"
        return "device", "every section of this radio falls alike"
    if seen.whole_range and seen.range_learned >= FEW and seen.radio_share >= ALIKE and seen.elsewhere_share >= ALIKE:
        return "device", f"all that is left of this radio's range falls alike ({seen.range_learned} sections)"
    return None


def _too_early(seen: Circumstances) -> tuple[Cause, str] | None:
    """All of a radio falls that was passed so far: its range will tell whether it is the place or the radio."""
    if seen.kind == "above" or seen.at_site or seen.whole_line or seen.range_passed is None or seen.whole_range:
        return None
    if seen.elsewhere_sections >= FEW and seen.elsewhere_share < ALIKE:
        return None
    if seen.radio_share < ALIKE and (seen.dead_share or 0.0) < ALIKE:
        return None
    return "unknown", (
        f"all of this radio's sections passed so far fall ({seen.range_passed} of {seen.range_learned}): "
        "the rest will tell the place from the radio"
    )


LEAST_SECTIONS: Final = 15
"""For a fall everywhere to be told from a long obstacle."""
