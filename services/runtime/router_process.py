"""The embedded router as a process of its own: `python -m services.runtime.router_process [PROFILE]`."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path
from typing import NoReturn

from services.runtime.config import ConfigError, load_host
from services.runtime.logging import configure, guard_stdout, wants_colour
from services.runtime.process_end import StopSignals, arm_hard_exit, end_process, end_with_supervisor
from services.runtime.router import RouterError, open_router
from services.runtime.sd_notify import Notifier
from services.runtime.zenoh_config import BusConfigError


def run_router(profile_path: Path | None) -> NoReturn:
    """Run the profile's router until asked to stop, and end the process: code 0, or 1 when it could not open."""
    end_with_supervisor(os.environ)
    try:
        host = load_host(profile_path, os.environ).host
    except ConfigError as error:
        sys.stderr.write(f"{error}\n")
        end_process(1)
    terminal = sys.stdout
    colour = wants_colour(os.environ, terminal)
    stream = terminal if terminal.isatty() else guard_stdout()
    log = configure(host.log, stream, colour=colour, service="router")
    notifier = Notifier(os.environ)
    stop = threading.Event()
    StopSignals(stop.set)
    try:
        router = open_router(host.router)
    except (RouterError, BusConfigError) as error:
        log.error("router_failed", text=str(error))  # noqa: TRY400 - the words say all
        arm_hard_exit()
        end_process(1, stream)
    log.info("ready", listen=", ".join(host.router.listen))
    notifier.ready()
    while not stop.wait(None if notifier.watchdog_s is None else notifier.watchdog_s / 2):
        notifier.watchdog()
    notifier.stopping()
    router.close()
    end_process(0, stream)


if __name__ == "__main__":
    run_router(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
