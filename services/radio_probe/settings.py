"""Settings of the radio probe."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from services.byte_source.settings import SerialSource, TcpSource

Device = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")]
Name = Annotated[str, Meta(min_length=1, max_length=64)]
Stamps = Literal["checked", "device", "arrival"]
Positive = Annotated[float, Meta(gt=0.0)]
USUAL_COMMANDS = ("AT+CSQ", "AT+CESQ", "AT+QCSQ")


class Band(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A channel as a stretch of the spectrum."""

    channel: Name
    low_hz: Positive
    high_hz: Positive

    def __post_init__(self) -> None:
        """Refuse a stretch that is none."""
        if self.low_hz >= self.high_hz:
            msg = f"band {self.channel}: low_hz {self.low_hz:g} is not below high_hz {self.high_hz:g}"
            raise ValueError(msg)


class RadioInput(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A device, or a program, that reports: one of `serial`, `tcp`, `file` and `standard_input`."""

    device: Device
    """Its name in the keys."""
    serial: SerialSource | None = None
    tcp: TcpSource | None = None
    file: str = ""
    """Read from its beginning and followed as it grows."""
    standard_input: bool = False
    """Of the service's process."""
    format: Literal["csv", "json", "modem", "scan"] = "csv"
    """`csv`, `json`: a line each; `modem`: AT commands (3GPP TS 27.007); `scan`: lines of rtl_power or soapy_power."""
    carries: Literal["radio", "weather"] = "radio"
    """What the lines of `csv` and `json` are about."""
    columns: tuple[str, ...] = ()
    """Of `csv`; when left out, its first line names them."""
    radio: Annotated[str, Meta(max_length=64)] = ""
    """Who is measured, where the device does not tell; its own name when left out."""
    channel: Name = "1"
    """Which channel, where the device does not tell."""
    axis_m: float | None = None
    """Where a weather station stands that does not tell."""
    commands: Annotated[tuple[str, ...], Meta(min_length=1)] = USUAL_COMMANDS
    """Asked of a modem in turn; one that it does not know is asked no more."""
    every_s: Annotated[float, Meta(ge=0.1, le=3600.0)] = 1.0
    """Between a modem's reports."""
    bands: tuple[Band, ...] = ()
    """Channels that are summed up from a power scan."""
    calibration_db: Annotated[float, Meta(ge=-200.0, le=200.0)] = 0.0
    """Added to a power scan: its decibels count from the receiver's full scale, not from a milliwatt."""
    rate_hz: Annotated[float, Meta(ge=0.0, le=1000.0)] = 0.0
    """Reports expected per second; health tells when there are more or fewer. 0: whatever comes."""
    silence_s: Annotated[float, Meta(ge=1.0, le=3600.0)] = 10.0
    """A serial line or connection on which nothing comes for longer is opened anew."""
    stamps: Stamps = "checked"
    """`checked`: a device's own time is taken unless it is far from the host's; `device`: always, for recordings;
    `arrival`: never."""

    def __post_init__(self) -> None:
        """Refuse none or several sources, and settings that do not belong together."""
        sources = (self.serial is not None, self.tcp is not None, bool(self.file), self.standard_input)
        if sum(sources) != 1:
            msg = f"{self.device}: give one of serial, tcp, file and standard_input"
            raise ValueError(msg)
        if self.format == "modem" and self.serial is None and self.tcp is None:
            msg = f"{self.device}: a modem is asked over serial or tcp"
            raise ValueError(msg)
        if (self.format == "scan") != bool(self.bands):
            msg = f"{self.device}: format scan and bands belong together"
            raise ValueError(msg)
        if self.carries == "weather" and self.format not in ("csv", "json"):
            msg = f"{self.device}: weather comes as csv or json"
            raise ValueError(msg)


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the radio probe."""

    bus: bool = True
    """Take what devices report on the bus (`radio/reading`), the simulated one among them."""
    bus_stamps: Stamps = "checked"
    """As `stamps` of an input. `device` where a recording or a time-lapse is on the bus."""
    inputs: tuple[RadioInput, ...] = ()
    """Devices, programs and files that report to this service alone."""
    wait_s: Annotated[float, Meta(ge=0.1, le=60.0)] = 3.0
    """A report waits so long for the positions around its time; then it goes out without a place."""
    largest_gap_s: Annotated[float, Meta(ge=0.1, le=60.0)] = 2.0
    """Between two positions that are further apart in time there is no place."""
    largest_bound_m: Positive = 300.0
    """A place that is less certain is no place."""
    largest_clock_error_s: Positive = 300.0
    """Between a device's time and the host's, for `checked`."""

    def __post_init__(self) -> None:
        """Refuse nothing to read, and twins."""
        if not self.bus and not self.inputs:
            msg = "give inputs, or bus = true"
            raise ValueError(msg)
        names = [one.device for one in self.inputs]
        if len(set(names)) < len(names):
            msg = f"two inputs have the same device name: {', '.join(names)}"
            raise ValueError(msg)
        if sum(one.standard_input for one in self.inputs) > 1:
            msg = "only one input can have the standard input"
            raise ValueError(msg)
