"""Track circuits on the bus: samples in, telegrams, occupied or clear, and health out."""

from __future__ import annotations

from schemas.topics import (
    TRACK_CODE,
    TRACK_EQUALISER,
    TRACK_EVENT,
    TRACK_HEALTH,
    TRACK_OCCUPANCY,
    TRACK_SAMPLES,
    TRACK_TELEGRAM,
)
from services.runtime.node import Node, Service
from services.track_circuit.settings import Config


async def run(node: Node, config: Config) -> None:
    """Count samples until asked to stop."""
    arrivals = node.arrivals(TRACK_SAMPLES)
    node.ready()
    async for arrival in arrivals:
        if not config.circuits or arrival.fields["circuit"] in {one.name for one in config.circuits}:
            node.health.count("blocks")


SERVICE = Service(
    "track_circuit",
    Config,
    reads=(TRACK_SAMPLES,),
    writes=(
        TRACK_SAMPLES,
        TRACK_TELEGRAM,
        TRACK_CODE,
        TRACK_EQUALISER,
        TRACK_OCCUPANCY,
        TRACK_HEALTH,
        TRACK_EVENT,
    ),
    run=run,
    about="telegrams out of the rail, whether a track circuit is clear, and how well it is",
)
