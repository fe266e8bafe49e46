"""The services that this installation has, by name; none is imported before it is asked for."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import services
from services.runtime.node import Service


class UnknownServiceError(ValueError):
    """No service has this name."""


def service_names() -> tuple[str, ...]:
    """Names of all services: the folders under services/ that hold a service.py."""
    return tuple(sorted({path.parent.name for root in services.__path__ for path in Path(root).glob("*/service.py")}))


def service_name(instance: str) -> str:
    """Service of an instance.

    >>> service_name("gnss_receiver@rear")
    'gnss_receiver'
    """
    return instance.partition("@")[0]


def load_service(name: str) -> Service[Any]:
    """Service by its name; imports its module. Raises UnknownServiceError with the nearest known name."""
    names = service_names()
    if name not in names:
        msg = f"no service {name!r}{suggestion(name, names)}; there are: {', '.join(names)}"
        raise UnknownServiceError(msg)
    service: Service[Any] = importlib.import_module(f"services.{name}.service").SERVICE
    return service


def suggestion(name: str, known: Iterable[str]) -> str:
    """Words that name the nearest of `known`, or nothing.

    >>> suggestion("treshold_m", ["threshold_m", "method"])
    ', did you mean threshold_m?'
    """
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f", did you mean {near[0]}?" if near else ""
