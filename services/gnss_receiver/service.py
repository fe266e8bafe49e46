"""A receiver on the bus: its epochs, its own position, and what the satellites broadcast."""

from __future__ import annotations

from typing import Annotated, assert_never

from msgspec import Meta

from schemas.gnss import Ephemeris, Epoch, Ionosphere, OwnPosition
from schemas.topics import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_IONOSPHERE, GNSS_OWN_POSITION
from services.gnss_receiver.heard import Heard, StationPosition
from services.gnss_receiver.reception import Reception
from services.gnss_receiver.reception_stream import receive
from services.runtime.node import Node, Service


class Config(Reception, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of a receiver."""

    device: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")] = "front"
    """The receiver's name in its keys."""


async def run(node: Node, config: Config) -> None:
    """Publish what the receiver says; raises RinexError, OSError or ValueError for recordings that cannot be read."""
    async for heard in receive(node, config):
        await _publish(node, config.device, heard)


async def _publish(node: Node, device: str, heard: Heard) -> None:
    match heard:
        case Epoch():
            await node.publish(GNSS_EPOCH, heard, device=device)
        case Ephemeris():
            await node.publish(GNSS_EPHEMERIS, heard, device=device, satellite=heard.satellite)
        case Ionosphere():
            await node.publish(GNSS_IONOSPHERE, heard, device=device)
        case OwnPosition():
            await node.publish(GNSS_OWN_POSITION, heard, device=device)
        case StationPosition():
            # A reference station's; a train has no use for it.
            node.health.count("station_positions")
        case _:
            assert_never(heard)


SERVICE = Service(
    "gnss_receiver",
    Config,
    reads=(),
    writes=(GNSS_EPOCH, GNSS_EPHEMERIS, GNSS_IONOSPHERE, GNSS_OWN_POSITION),
    run=run,
    about="a GNSS receiver, live or recorded: what it measured, where it believes to be, what the satellites broadcast",
)
