"""The simulated train on the bus: a receiver's epochs, broadcast ephemerides, and the truth, for ever."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from schemas.gnss_time import NS, WEEK_S, gps_from_unix_ns
from schemas.topics import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_IONOSPHERE, TRAIN_TRUTH
from services.runtime.node import Node, Service
from services.simulator.constellation import reference_time
from services.simulator.scenario_file import read_scenario
from services.simulator.simulation import Simulation

LATEST_S = 1.0
"""Epochs that could not be made in time (the host slept) are left out once they are later than this."""


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the simulated train."""

    scenario: str = "street_canyon"
    """Name of a scenario that comes with Kirotei, or path of a TOML file."""
    device: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")] = "front"
    """The receiver's name in its keys."""
    speed: Annotated[float, Meta(gt=0.0, le=100.0)] = 1.0
    """Simulated seconds per second. Other than 1 the epochs' times move away from now."""
    seed: Annotated[int, Meta(ge=0)] | None = None
    """Seed of everything drawn; absent: the scenario's own."""


async def run(node: Node, config: Config) -> None:
    """Publish until stopped: GPS time is the calendar's at the start and runs on by itself from there."""
    scenario = await node.in_thread(lambda: read_scenario(config.scenario))
    seed = scenario.seed if config.seed is None else config.seed

    def begin(gps_ns: int) -> Simulation:
        return Simulation(scenario, gps_ns, np.random.default_rng(seed))

    # A first step beforehand: what has to be compiled is compiled before time starts to count.
    await node.in_thread(begin(_gps_now_ns(node)).step)
    origin_ns, origin_s = _gps_now_ns(node), node.clock.monotonic_s()
    interval_ns = round(scenario.receiver.interval_s * NS)
    simulation = begin(-(-origin_ns // interval_ns) * interval_ns)
    node.ready()

    def ahead_s() -> float:
        """How long until the next epoch is due; negative when it is late."""
        passed_ns = round((node.clock.monotonic_s() - origin_s) * config.speed * NS)
        return (simulation.next_gps_ns - origin_ns - passed_ns) / NS / config.speed

    reference_ns: int | None = None
    while await node.sleep(max(ahead_s(), 0.0)):
        late_s = -ahead_s()
        if late_s > LATEST_S:
            now_ns = simulation.next_gps_ns + round(late_s * config.speed * NS)
            node.health.count("epochs_skipped", simulation.skip_until(now_ns))
            continue
        if reference_time(simulation.next_gps_ns) != reference_ns:
            reference_ns = reference_time(simulation.next_gps_ns)
            await _broadcast(node, config, simulation)
        instant = simulation.step()
        await node.publish(GNSS_EPOCH, instant.epoch, device=config.device)
        await node.publish(TRAIN_TRUTH, instant.truth, device=config.device)


def _gps_now_ns(node: Node) -> int:
    """Calendar now as GPS time [ns] since the GPS epoch."""
    week, tow_s = gps_from_unix_ns(node.clock.now_ns())
    return week * WEEK_S * NS + round(tow_s * NS)


async def _broadcast(node: Node, config: Config, simulation: Simulation) -> None:
    """Publish what the satellites broadcast now."""
    await node.publish(GNSS_IONOSPHERE, simulation.ionosphere(), device=config.device)
    for ephemeris in simulation.ephemerides():
        await node.publish(GNSS_EPHEMERIS, ephemeris, device=config.device, satellite=ephemeris.satellite)


SERVICE = Service(
    "simulator",
    Config,
    reads=(),
    writes=(GNSS_EPOCH, GNSS_EPHEMERIS, GNSS_IONOSPHERE, TRAIN_TRUTH),
    run=run,
    about="a train on a line with a simulated receiver among buildings, and where it really is",
)
