"""Thresholds of the paper's detector for one receiver, by constellation and elevation, with their evidence.

The paper leaves open how to choose them for another receiver (Yoshinaga et al. 2008, sections 4.4
and 6). `kirotei gnss tune` finds them; this is what is kept of it.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

VERSION: Final = 1
System = Literal["G", "R", "E", "C", "J"]
Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Count = Annotated[int, Meta(ge=0)]
Elevation = Annotated[float, Meta(ge=0.0, le=90.0)]


class Band(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Threshold of one constellation between two elevations, and what it rests on."""

    system: System
    lowest_deg: Elevation
    """Included."""
    highest_deg: Elevation
    """Excluded, but for the zenith."""
    threshold_m: Positive
    """Change Pc per nominal interval (0.2 s) above which a satellite is held for multipath."""
    basis: Literal["band", "constellation", "receiver", "given"] = "given"
    """Whose clean changes the threshold was taken from: too few in a band, those of its constellation, and so on."""
    judged: Count = 0
    """Changes seen in the band."""
    clean: Count = 0
    """Those of them that nothing else speaks against."""
    p50_m: NotNegative | None = None
    p90_m: NotNegative | None = None
    p99_m: NotNegative | None = None
    """Quantiles of the clean changes."""
    noise_m: NotNegative | None = None
    """Standard deviation of a clean pseudorange that the median of the changes implies."""


class Thresholds(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A thresholds file (TOML)."""

    version: Annotated[int, Meta(ge=VERSION, le=VERSION)] = VERSION
    receiver: str
    recording: str = ""
    """What it was tuned on."""
    first_utc: str = ""
    last_utc: str = ""
    epochs: Count = 0
    interval_s: NotNegative = 0.0
    """Usual interval between epochs: thresholds hold for it."""
    false_alarms: Annotated[float, Meta(gt=0.0, lt=0.5)] = 0.01
    """Share of clean changes above the thresholds."""
    bands: Annotated[tuple[Band, ...], Meta(min_length=1, max_length=200)]

    def threshold_m(self, system: str, elevation_deg: float) -> float | None:
        """Threshold of a satellite; None where no band covers it, also when the elevation is NaN.

        >>> given = Band(system="G", lowest_deg=0.0, highest_deg=90.0, threshold_m=0.6)
        >>> Thresholds(receiver="r1", bands=(given,)).threshold_m("G", 90.0)
        0.6
        """
        for band in self.bands:
            if band.system == system and (
                band.lowest_deg <= elevation_deg < band.highest_deg or elevation_deg == band.highest_deg == ZENITH_DEG
            ):
                return band.threshold_m
        return None


ZENITH_DEG: Final = 90.0
EDGES_DEG: Final = (0.0, 15.0, 30.0, 45.0, 60.0, 90.0)
"""Edges of the elevation bands; the paper speaks of `extremely low`, `low` and `about 60 degrees` (section 4.4)."""
