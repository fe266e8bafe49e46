"""What every service of a host shares: its place, the bus, the router, the log."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from schemas.topic import Place, PlaceKind

Endpoint = Annotated[str, Meta(pattern=r"^(tcp|tls|quic|unixsock-stream|ws)/.+$")]
Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")]
Instance = Annotated[str, Meta(pattern=r"^[a-z][a-z_]*(@[A-Za-z0-9_-]+)?$")]


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the configuration; unknown fields are refused."""


class PlaceConfig(Settings, frozen=True, kw_only=True):
    """Where this host stands."""

    line: Name
    """The railway line, as it stands in every key."""
    kind: PlaceKind
    """What `name` is."""
    name: Name
    """Train, wayside site or cloud."""

    def place(self) -> Place:
        """Place as topics take it."""
        return Place(self.line, self.kind, self.name)


class BusConfig(Settings, frozen=True, kw_only=True):
    """How a service reaches its router."""

    connect: Annotated[tuple[Endpoint, ...], Meta(min_length=1)] = ("tcp/127.0.0.1:7447",)
    """Routers to try, one of which must answer."""
    lease_s: Annotated[float, Meta(ge=0.5, le=60.0)] = 2.0
    """A silent link is given up after this."""
    config_file: str | None = None
    """Zenoh's own configuration (JSON5) to start from: TLS, certificates."""
    retain_s: Annotated[float, Meta(ge=0.0, le=86_400.0)] = 600.0
    """What must reach the cloud is kept in its sender's memory this long, for a bridge that was away …"""
    retain_mb: Annotated[float, Meta(ge=0.0, le=10_000.0)] = 64.0
    """… up to this per service."""


class RouterConfig(Settings, frozen=True, kw_only=True):
    """The embedded router of `kirotei up`."""

    enabled: bool = True
    """False where a stock zenohd runs."""
    listen: Annotated[tuple[Endpoint, ...], Meta(min_length=1)] = ("tcp/127.0.0.1:7447",)
    """Addresses at which it accepts services, viewers and other hosts' routers."""
    connect: tuple[Endpoint, ...] = ()
    """Routers of other hosts."""
    lease_s: Annotated[float, Meta(ge=0.5, le=60.0)] = 2.0
    """A silent link is given up after this."""
    config_file: str | None = None
    """Zenoh's own configuration (JSON5) to start from: TLS, certificates, access control."""


class LogConfig(Settings, frozen=True, kw_only=True):
    """What is logged and how it looks."""

    level: Literal["debug", "info", "warning", "error"] = "info"
    """The least that is logged."""
    format: Literal["auto", "json", "text"] = "auto"
    """`auto`: readable text on a terminal, JSON elsewhere."""


class LifeConfig(Settings, frozen=True, kw_only=True):
    """How long a service may take."""

    start_timeout_s: Annotated[float, Meta(ge=1.0, le=3600.0)] = 600.0
    """A service that is not ready by then is ended with exit code 1; compiling kernels for the first time counts."""
    watchdog_s: Annotated[float, Meta(ge=1.0, le=600.0)] = 20.0
    """`kirotei up` kills and restarts a service whose event loop has given no sign for this long."""


class HostConfig(Settings, frozen=True, kw_only=True):
    """The shared part of a profile. Each service's own settings stand in a table of its name."""

    place: PlaceConfig
    services: tuple[Instance, ...] = ()
    """What `kirotei up` starts here; 'gnss_receiver@rear' is a second instance with its own table."""
    bus: BusConfig = BusConfig()
    router: RouterConfig = RouterConfig()
    log: LogConfig = LogConfig()
    life: LifeConfig = LifeConfig()
    state_dir: str | None = None
    """Where state and compiled kernels are kept; by default $XDG_STATE_HOME/kirotei or ~/.local/state/kirotei."""
