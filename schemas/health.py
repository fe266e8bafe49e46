"""Messages about the services themselves."""

from __future__ import annotations

from typing import Literal

import msgspec

from schemas.message import Message, Part

Level = Literal["ok", "degraded", "failed"]


class InputHealth(Part, frozen=True, kw_only=True):
    """What a service has seen of one source on one key since it started."""

    key: str
    source: str
    received: int
    missing: int
    """Sequence numbers that never came."""
    duplicated: int
    """Received again, or overtaken, and not handed on twice."""
    restarts: int
    """Times the source came back with another boot id."""
    age_s: float
    """Time since the newest arrival [s]."""
    delay_s: float
    """Newest arrival's receive time minus its send time [s]; clocks of two hosts may differ."""


class Health(Message, frozen=True, kw_only=True):
    """How one service is doing, once a second and at every change."""

    service: str
    """Instance name, 'gnss_receiver' or 'gnss_receiver@rear'."""
    boot_id: str
    level: Level
    reasons: tuple[str, ...] = ()
    """In words: why the level is not ok."""
    uptime_s: float
    published: int
    received: int
    dropped: int
    """Arrivals that a full queue pushed out."""
    refused: int
    """Arrivals that could not be decoded."""
    counts: dict[str, int] = msgspec.field(default_factory=dict)
    """The service's own counters, by name."""
    inputs: tuple[InputHealth, ...] = ()


class ServiceEvent(Message, frozen=True, kw_only=True):
    """Something happened to a service that its operator must be able to look up later."""

    service: str
    boot_id: str
    kind: Literal["started", "stopping", "failed", "input_gap", "input_restart", "level"]
    text: str
