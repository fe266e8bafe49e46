"""What radios measure, what the weather was, what is normal, and what leaves it.

Powers in dBm at the antenna connector. Places are the railway's kilometrage (`chainage_m`) where the
measuring radio's train knew it, and `axis_m`, true metres along the axis.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from msgspec import Meta

from schemas.message import Message, Part

Name = Annotated[str, Meta(min_length=1, max_length=64)]
Ratio = Annotated[float, Meta(ge=0.0, le=1.0)]
Direction = Literal["up", "down"]
Kind = Literal["above", "below", "missing", "trend"]
Cause = Literal["interference", "obstruction", "device", "snow", "unknown"]
Side = Literal["onboard", "wayside"]


class RadioMeasurement(Message, frozen=True, kw_only=True):
    """One periodic measurement by one radio on one channel.

    Channel power is what the receiver hears on the channel, whoever sends; decoded power is that of
    the frames it could decode. The two part under interference, hence both. What a device does not
    measure is None.
    """

    radio: Name
    """Sender that is measured where it can be told (a wayside radio, a cell), else the measuring device."""
    channel: Name
    """Frequency, ARFCN or band, as the railway names it."""
    side: Side = "onboard"
    channel_power_dbm: float | None = None
    decoded_power_dbm: float | None = None
    received_ratio: Ratio | None = None
    """Of the frames expected in the period."""
    corrected_bits: Annotated[float, Meta(ge=0.0)] | None = None
    """By error correction, per frame."""
    snr_db: float | None = None
    """As the device gives it: signal against noise and interference."""
    rsrq_db: float | None = None
    """Reference signal received quality of a cell (3GPP TS 36.214)."""
    frequency_offset_hz: float | None = None
    temperature_c: float | None = None
    tx_power_dbm: float | None = None
    cell: str = ""
    """Serving cell, where the device tells it."""
    chainage_m: float | None = None
    axis_m: float | None = None
    place_bound_m: Annotated[float, Meta(ge=0.0)] | None = None
    """Error of the place that the position vouches for."""
    branch: str = ""
    direction: Direction | None = None
    speed_mps: float | None = None
    pass_id: str = ""
    """One journey over the line in one direction, of the transmitting train on the wayside; empty where no train's
    place is known."""
    train: str = ""
    """Whose transmission a wayside radio measured, where it knows."""


class Weather(Message, frozen=True, kw_only=True):
    """Weather at a place of the line."""

    axis_m: float
    reach_m: Annotated[float, Meta(gt=0.0)] = 5000.0
    """How far along the line it may be taken to hold."""
    temperature_c: float | None = None
    rain_mm_per_h: Annotated[float, Meta(ge=0.0)] | None = None
    snow_mm_per_h: Annotated[float, Meta(ge=0.0)] | None = None
    """As water."""
    snow_depth_cm: Annotated[float, Meta(ge=0.0)] | None = None
    lightning: bool | None = None


class RadioEvent(Message, frozen=True, kw_only=True):
    """Something about the radio of a stretch that is not as it was learned."""

    event_id: str
    """The same for every later word about it."""
    incident_id: str = ""
    """The same for every event that is one thing, over radios, channels, directions and stretches: what a person is
    told once. Empty from those who do not put events together."""
    incident: str = ""
    """The incident so far in words: cause, from where to where, which radios and channels."""
    phase: Literal["began", "goes_on", "ended"]
    radio: Name
    channel: Name
    direction: Direction | None = None
    section_start_m: float
    """Kilometrage."""
    section_end_m: float
    kind: Kind
    cause: Cause
    value_dbm: float | None = None
    lower_dbm: float | None = None
    upper_dbm: float | None = None
    score: float
    """How unusual: in standard deviations of what is normal between passes."""
    confirmed: bool
    """Seen on two passes, or certain at once."""
    pass_id: str = ""
    first_seen_ns: int
    expected_loss_ns: int | None = None
    """When reception is expected to fall below the configured ratio, for a trend."""
    expected_loss_early_ns: int | None = None
    expected_loss_late_ns: int | None = None
    false_alarm_rate: Ratio | None = None
    """Of the model, held out: share of normal pass-sections that it would report."""
    learned_passes: int = 0
    reason: str
    """Why, in words and figures."""


class RadioSection(Message, frozen=True, kw_only=True):
    """How a section of the line was heard on the newest pass, with what is normal there: for people to look at."""

    radio: Name
    channel: Name
    direction: Direction | None = None
    section_start_m: float
    section_end_m: float
    state: Literal["learning", "normal", "above", "below", "missing", "trend"]
    value_dbm: float | None = None
    lower_dbm: float | None = None
    mean_dbm: float | None = None
    upper_dbm: float | None = None
    received_ratio: Ratio | None = None
    passes: int
    """Learned from."""
    pass_id: str = ""


class RadioAcceptance(Message, frozen=True, kw_only=True):
    """A person's word that what a stretch shows now is its new normal, or that an earlier such word is taken back."""

    acceptance_id: Name
    radio: Name
    channel: str = ""
    """Empty: every channel."""
    direction: Direction | None = None
    section_start_m: float
    section_end_m: float
    since_ns: int
    """Passes from here on are the new normal."""
    by: Name
    why: str = ""
    revoked: bool = False


class BinSums(Part, frozen=True, kw_only=True):
    """Mergeable sums over the passes of one day: n, Σ and Σ² of pass values."""

    quantity: Annotated[str, Meta(min_length=1, max_length=32)] = "power"
    """What was summed: power in dBm, or another column of a measurement."""
    cell: Annotated[str, Meta(max_length=64)] = ""
    """Serving cell, where the device tells it."""
    day: Annotated[str, Meta(pattern=r"^\d{4}-\d{2}-\d{2}$")]
    radio: Name
    channel: Name
    direction: Literal["up", "down", ""]
    section: int
    n: Annotated[float, Meta(ge=0.0)]
    sum: float
    sum_squares: float

    def __post_init__(self) -> None:
        """Refuse sums that are no numbers."""
        if not all(math.isfinite(value) for value in (self.n, self.sum, self.sum_squares)):
            msg = f"sums of {self.radio} {self.channel} section {self.section} on {self.day} are not finite"
            raise ValueError(msg)
