"""Settings of the track-circuit service."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")]


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which circuits are received."""

    circuits: tuple[Name, ...] = ()
    """Their names; empty: every circuit whose samples are heard."""
