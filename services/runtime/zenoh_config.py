"""Zenoh configurations of services and of the embedded router."""

from __future__ import annotations

import json
from collections.abc import Mapping

import zenoh

from services.runtime.host_config import BusConfig, RouterConfig

CONNECT_TIMEOUT_MS = 500
"""One attempt to reach a router; the caller repeats it and can be cancelled between."""
QUERY_TIMEOUT_MS = 3000
"""How long history and recovery wait for a publisher that does not answer; live samples are held meanwhile."""
RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2.0}
KEEP_ALIVES_PER_LEASE = 4
"""As Zenoh advises after ITU-T G.8013: a link is lost after 3.5 missed signs of life."""


class BusConfigError(ValueError):
    """The bus or the router is configured in a way that Zenoh does not accept."""


def cause_of(error: zenoh.ZError) -> str:
    """First line of Zenoh's message, without the place in Zenoh's own source."""
    return str(error).splitlines()[0].split(" at /", 1)[0].strip()


def client_config(bus: BusConfig) -> zenoh.Config:
    """Configuration of a service's session: client of one of the routers named in `bus`.

    Raises BusConfigError naming the file or the setting that Zenoh refuses.
    """
    return _config(
        bus.config_file,
        {
            "mode": "client",
            "connect/endpoints": list(bus.connect),
            "connect/timeout_ms": CONNECT_TIMEOUT_MS,
            "connect/exit_on_failure": True,
            "connect/retry": RETRY,
            "listen/endpoints": [],
            # The cache of an advanced publisher stamps what it keeps.
            "timestamping/enabled": True,
            "queries_default_timeout": QUERY_TIMEOUT_MS,
        },
        bus.lease_s,
    )


def router_config(router: RouterConfig) -> zenoh.Config:
    """Configuration of the embedded router. Raises BusConfigError."""
    return _config(
        router.config_file,
        {
            "mode": "router",
            "listen/endpoints": list(router.listen),
            "listen/exit_on_failure": True,
            "scouting/delay": 0,  # nothing is scouted for; Zenoh would wait half a second for it all the same
            "connect/endpoints": list(router.connect),
            "connect/timeout_ms": -1,
            "connect/exit_on_failure": False,
            "connect/retry": RETRY,
            # Senders stamp. A router that stamps for them may reorder what a recorder's one subscription takes in.
            "timestamping/enabled": False,
        },
        router.lease_s,
    )


def _config(file: str | None, settings: Mapping[str, object], lease_s: float) -> zenoh.Config:
    try:
        config = zenoh.Config.from_file(file) if file else zenoh.Config()
    except zenoh.ZError as error:
        msg = f"{file} is no Zenoh configuration: {cause_of(error)}"
        raise BusConfigError(msg) from error
    common: dict[str, object] = {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": round(lease_s * 1000),
        "transport/link/tx/keep_alive": KEEP_ALIVES_PER_LEASE,
        # Messages stay under 64 kB; segments would be left behind by a killed process.
        "transport/shared_memory/enabled": False,
    }
    for path, value in (common | dict(settings)).items():
        try:
            config.insert_json5(path, json.dumps(value))
        except zenoh.ZError as error:
            msg = f"Zenoh refuses {path} = {value!r}: {cause_of(error)}"
            raise BusConfigError(msg) from error
    return config
