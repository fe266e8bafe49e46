"""Settings of the fused mode."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta


class FusedSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the error-state filter with branches is told; noises it takes from the samples."""

    share: Annotated[float, Meta(ge=0.001, le=0.05)] = 0.03
    """Relative error of distance outside slips that is vouched for while the wheel's scale is not known better: wear
    of 2 % and micro-slip."""
    known_share: Annotated[float, Meta(ge=0.001, le=0.05)] = 0.022
    """What is left of it beside three standard deviations of a wheel scale found from references."""
    longest_slip_s: Annotated[float, Meta(ge=5.0, le=120.0)] = 40.0
    """After so long without re-adhesion the train should be stopped."""
    start_bound_m: Annotated[float, Meta(ge=0.1, le=5.0)] = 1.5
    """Error that is vouched for at the origin: pulses, delays, slips too small to be seen."""
