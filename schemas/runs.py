"""Messages about runs: what a leg from station to station took and cost."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from schemas.line import Direction
from schemas.message import Message

NotNegative = Annotated[float, Meta(ge=0.0)]


class RunRecord(Message, frozen=True, kw_only=True):
    """A leg of a train; `t_ns` is the arrival, or the last moment known of a leg that was cut."""

    run_id: str
    """Of the train's way since it was first seen, turns included."""
    from_station: str
    """Id; empty when the leg was cut at its beginning."""
    to_station: str
    """Id; empty when it was cut at its end."""
    cut: Literal["", "start", "end"] = ""
    """The record begins between stations (a restart, positions lost), or ends there."""
    direction: Direction | None = None
    departure_ns: int | None = None
    arrival_ns: int | None = None
    running_time_s: NotNegative | None = None
    """None for a cut leg, and so the energy."""
    energy_kwh: NotNegative | None = None
    """Traction alone, from the line."""
    energy_sigma_kwh: NotNegative | None = None
    energy_noise_kwh: NotNegative | None = None
    """What noise in the speeds would have added to the traction, taken off already …"""
    energy_noise_sigma_kwh: NotNegative | None = None
    """… and its standard deviation."""
    regenerated_kwh: NotNegative | None = None
    """Given back to the line; not in `energy_kwh`."""
    regenerated_sigma_kwh: NotNegative | None = None
    auxiliaries_kwh: NotNegative | None = None
    """Heating, light, compressors from departure to arrival; not in `energy_kwh`."""
    auxiliaries_sigma_kwh: NotNegative | None = None
    quality: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    excluded_because: str = ""
    """Why it does not count in statistics; empty when it does."""
    series: str = ""
    vehicle: str = ""
    line_version: str = ""
