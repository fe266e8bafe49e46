"""A receiver's recording on the bus: its epochs at their own pace, and what the satellites broadcast."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.gnss_time import WEEK_S, unix_ns_from_gps
from schemas.topics import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_IONOSPHERE
from services.gnss_receiver.broadcast_choice import BroadcastChoice
from services.gnss_receiver.observations import Navigation, Observations
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations
from services.runtime.node import Node, Service

LONGEST_WAIT_S = 60.0
"""A longer gap in a recording is passed over in this time, as far as waiting goes."""
PAUSE_S = 1.0
"""Between the end of a recording and its beginning."""
LATEST_S = 1.0
"""After an epoch later than this (the host slept) the pace starts anew, instead of catching up in a burst."""


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of a recorded receiver."""

    observations: Annotated[str, Meta(min_length=1)]
    """RINEX observation file."""
    navigation: tuple[str, ...] = ()
    """RINEX navigation files."""
    device: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")] = "front"
    """The receiver's name in its keys."""
    speed: Annotated[float, Meta(ge=0.0, le=1000.0)] = 1.0
    """Recorded seconds per second; 0 for as fast as it goes."""
    repeat: bool = False
    """Begin again at the end. Times stay those of the recording."""


async def run(node: Node, config: Config) -> None:
    """Publish the recording once, or again and again; raises RinexError or OSError for files that cannot be read."""
    observations = await node.in_thread(lambda: read_observations(Path(config.observations)))
    navigation = await node.in_thread(lambda: read_navigation([Path(path) for path in config.navigation]))
    _report(node, observations, navigation)
    if not len(observations):
        msg = f"{config.observations} holds no epoch that can be read"
        raise ValueError(msg)
    node.ready()
    going_on = await _play(node, config, observations, navigation)
    while going_on and config.repeat:
        node.health.count("repetitions")
        pause_s = PAUSE_S / config.speed if config.speed else 0.0
        going_on = await node.sleep(pause_s) and await _play(node, config, observations, navigation)


def _report(node: Node, observations: Observations, navigation: Navigation) -> None:
    """Count what was refused in the files, and say so in health."""
    issues = (*observations.issues, *navigation.issues)
    node.health.count("epochs_read", len(observations))
    node.health.count("ephemerides_read", len(navigation.ephemerides))
    node.health.count("issues", len(issues))
    if issues:
        node.health.set("issues", f"{len(issues)} things in the files were refused, the first: {issues[0]}")


async def _play(node: Node, config: Config, observations: Observations, navigation: Navigation) -> bool:
    """Publish every epoch once; False when asked to stop."""
    choice = BroadcastChoice.of(navigation.ephemerides)
    gps_s = observations.gps_week * WEEK_S + observations.tow_s
    if navigation.ionosphere is not None:
        first_ns = unix_ns_from_gps(int(observations.gps_week[0]), float(observations.tow_s[0]))
        ionosphere = msgspec.structs.replace(navigation.ionosphere, t_ns=first_ns)
        await node.publish(GNSS_IONOSPHERE, ionosphere, device=config.device)
    due_s = node.clock.monotonic_s()
    previous_s = float(gps_s[0])
    for index, now_s in enumerate(gps_s.tolist()):
        # Repeated and out-of-order epochs follow at once: a receiver gave them so.
        interval_s = min(max(now_s - previous_s, 0.0), LONGEST_WAIT_S)
        previous_s = now_s
        due_s += interval_s / config.speed if config.speed else 0.0
        if not await node.sleep(max(due_s - node.clock.monotonic_s(), 0.0)):
            return False
        late_s = node.clock.monotonic_s() - due_s
        due_s += late_s if late_s > LATEST_S else 0.0
        for ephemeris in choice.changed(now_s):
            await node.publish(GNSS_EPHEMERIS, ephemeris, device=config.device, satellite=ephemeris.satellite)
        await node.publish(GNSS_EPOCH, observations.epoch(index), device=config.device)
    return True


SERVICE = Service(
    "gnss_receiver",
    Config,
    reads=(),
    writes=(GNSS_EPOCH, GNSS_EPHEMERIS, GNSS_IONOSPHERE),
    run=run,
    about="a GNSS receiver's recording: what it measured, epoch by epoch, and what the satellites broadcast",
)
