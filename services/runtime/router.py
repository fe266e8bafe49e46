"""The embedded router: what stock zenohd does at scale, inside `kirotei up` on one machine."""

from __future__ import annotations

from types import TracebackType
from typing import Self

import zenoh

from services.runtime.host_config import RouterConfig
from services.runtime.zenoh_config import cause_of, router_config
from services.runtime.zenoh_session import close_session


class RouterError(RuntimeError):
    """The router cannot listen where it should."""


class Router:
    """A running router. Closing it, or leaving its `with`, ends every link."""

    def __init__(self, session: zenoh.Session) -> None:
        """Take over a session in router mode."""
        self._session = session

    def close(self) -> None:
        """Stop routing. Does nothing when closed already."""
        if not self._session.is_closed():
            close_session(self._session)

    def __enter__(self) -> Self:
        """Route until the end of the `with`."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop routing."""
        self.close()


def open_router(config: RouterConfig) -> Router:
    """Router listening on `config.listen`, linked with the routers in `config.connect` as they come up.

    Raises RouterError when an endpoint is taken or cannot be listened on, BusConfigError when
    Zenoh refuses a setting. Blocks some milliseconds.
    """
    try:
        session = zenoh.open(router_config(config))
    except zenoh.ZError as error:
        where = ", ".join(config.listen)
        msg = (
            f"no router on {where}: {cause_of(error)}. Stop what listens there (another `kirotei up`, zenohd), "
            "or set router.listen, or router.enabled = false to use the router that runs already"
        )
        raise RouterError(msg) from error
    return Router(session)
