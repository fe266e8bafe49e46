"""Fixes of one receiver as NMEA 0183 sentences over TCP."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.topics import GNSS_FIX
from services.nmea_output.outlet_socket import MOST_CLIENTS, Outlet
from services.nmea_output.sentences import sentences
from services.runtime.node import Node, Service


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the output."""

    device: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")] = "front"
    """The receiver whose fixes are given."""
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0 for every network of the host. Whoever connects is served."""
    port: Annotated[int, Meta(ge=0, le=65_535)] = 10_110
    """Port to listen on; 10110 is registered for NMEA 0183. 0 takes a free one, which health tells."""
    most_clients: Annotated[int, Meta(ge=1, le=1000)] = MOST_CLIENTS
    """Further clients are turned away."""
    geoid_m: Annotated[float, Meta(ge=-120.0, le=100.0)] | None = None
    """Geoid's height above the ellipsoid on the line. Without it the height in GGA is the ellipsoidal one."""


async def run(node: Node, config: Config) -> None:
    """Serve until asked to stop; raises OSError when the address is taken."""
    outlet = Outlet(config.host, config.port, config.most_clients)
    try:
        node.health.counts["port"] = outlet.port
        arrivals = node.arrivals(GNSS_FIX)
        node.ready()
        async for arrival in arrivals:
            if arrival.fields["device"] != config.device:
                continue
            outlet.greet()
            outlet.send(sentences(arrival.message, config.geoid_m))
            _report(node, outlet)
    finally:
        outlet.close()


def _report(node: Node, outlet: Outlet) -> None:
    node.health.counts.update(
        sent=node.health.counts.get("sent", 0) + 1,
        clients=outlet.clients,
        accepted=outlet.accepted,
        turned_away=outlet.refused,
        gone=outlet.lost,
        dropped_slow=outlet.dropped,
    )


SERVICE = Service(
    "nmea_output",
    Config,
    reads=(GNSS_FIX,),
    writes=(),
    run=run,
    about="fixes as NMEA 0183 (GGA, RMC, GST) over TCP for existing onboard equipment",
)
