"""Which live source of bytes a configuration names."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

Text = Annotated[str, Meta(min_length=1)]
Port = Annotated[int, Meta(ge=1, le=65_535)]


class SerialSource(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A device on a serial line."""

    port: Text
    """Device, `/dev/ttyACM0`."""
    baud: Annotated[int, Meta(ge=300, le=4_000_000)] = 115_200


class TcpSource(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A device, or a serial server, that sends to whoever connects."""

    host: Text
    port: Port
