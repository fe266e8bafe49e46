"""Where a receiver's words come from, as a service's configuration says it."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.gnss_time import NS
from services.byte_source.settings import Port, SerialSource, TcpSource, Text


class NtripSource(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A stream of an NTRIP caster."""

    host: Text
    port: Port = 2101
    mountpoint: Annotated[str, Meta(pattern=r"^[^\s/][^\s]*$")]
    version: Annotated[int, Meta(ge=1, le=2)] = 2
    tls: bool = False
    """Whether the caster speaks TLS; its certificate must then name `host`."""
    authority_file: str = ""
    """PEM file with the certificate of the authority that signed the caster's; empty for those the system knows."""
    user: str = ""
    password_file: str = ""
    """File that holds the password; nothing else may be in it."""
    password_variable: str = ""
    """Variable of the environment that holds the password, where there is no file."""
    position: tuple[float, float, float] | None = None
    """Latitude, longitude [deg] and ellipsoidal height [m] that are reported to the caster, where it asks for them."""


class FileSource(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a receiver sent, as it was recorded."""

    path: Text
    recorded: Annotated[str, Meta(pattern=r"^$|^\d{4}-\d{2}-\d{2}$")] = ""
    """Day of the recording (UTC), where its messages do not name it."""


Source = SerialSource | TcpSource | NtripSource | FileSource


class Reception(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a receiver is read: one of `observations`, `serial`, `tcp`, `ntrip` and `file`."""

    observations: Text | None = None
    """Recording of observations: RINEX, or RTCM 3 or UBX as the receiver sent them."""
    navigation: tuple[str, ...] = ()
    """Recordings of what the satellites broadcast: RINEX, RTCM 3 or UBX."""
    speed: Annotated[float, Meta(ge=0.0, le=1000.0)] = 1.0
    """Recorded seconds per second; 0 for as fast as it goes."""
    repeat: bool = False
    """Begin again at the end of a recording. Times stay those of the recording."""
    serial: SerialSource | None = None
    tcp: TcpSource | None = None
    ntrip: NtripSource | None = None
    file: FileSource | None = None
    silence_s: Annotated[float, Meta(ge=1.0, le=3600.0)] = 10.0
    """A live source that sends nothing for longer is opened anew."""
    rate_hz: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    """Epochs (or positions) per second that a live source should give; 0 does not check."""
    raw_log: str = ""
    """File to which a live source's bytes are appended as they come; empty for none."""
    raw_log_bytes: Annotated[int, Meta(ge=1_000)] = 100_000_000
    """When the log has grown to this it is renamed, to `.1`, the one before to `.2`, and so on."""
    raw_log_files: Annotated[int, Meta(ge=1, le=1000)] = 10
    """Logs that are kept, the newest included."""

    def __post_init__(self) -> None:
        """Refuse several sources, and none."""
        given = [name for name in ("observations", "serial", "tcp", "ntrip", "file") if getattr(self, name) is not None]
        if len(given) != 1:
            told = f", not {' and '.join(given)}" if given else ""
            msg = f"give one of observations (a recording), serial, tcp, ntrip and file{told}"
            raise ValueError(msg)

    @property
    def source(self) -> Source | None:
        """The one source that is given; None for a recording in `observations`."""
        return self.serial or self.tcp or self.ntrip or self.file


def recorded_ns(source: FileSource) -> int | None:
    """Noon of the day on which a source was recorded; None where it is left to the messages.

    Raises ValueError for a day that does not exist.
    """
    if not source.recorded:
        return None
    try:
        day = datetime.fromisoformat(f"{source.recorded}T12:00:00").replace(tzinfo=UTC)
    except ValueError as error:
        msg = f"{source.path}: recorded on {source.recorded}: there is no such day"
        raise ValueError(msg) from error
    return round(day.timestamp()) * NS
