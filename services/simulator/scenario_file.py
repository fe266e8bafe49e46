"""Scenarios in TOML files, and those that come with Kirotei."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from services.simulator.scenario import Scenario, ScenarioError, scenario_from_toml

_FOLDER = resources.files("services.simulator") / "scenarios"
LARGEST_BYTES = 1_000_000


def embedded_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that come with Kirotei."""
    return tuple(
        sorted(entry.name.removesuffix(".toml") for entry in _FOLDER.iterdir() if entry.name.endswith(".toml"))
    )


def read_scenario(name_or_path: str) -> Scenario:
    """Scenario by an embedded one's name, or from a TOML file (whatever has a slash or ends in .toml).

    Raises ScenarioError that names the file, and the field that is wrong.
    """
    is_path = "/" in name_or_path or name_or_path.endswith(".toml")
    if not is_path and name_or_path not in embedded_scenarios():
        msg = f"no scenario {name_or_path!r}; there are: {', '.join(embedded_scenarios())}, or give a .toml file"
        raise ScenarioError(msg)
    source = Path(name_or_path) if is_path else _FOLDER / f"{name_or_path}.toml"
    try:
        octets = source.read_bytes()
        if len(octets) > LARGEST_BYTES:
            msg = f"{len(octets)} bytes, more than {LARGEST_BYTES}"
            raise ScenarioError(msg)
        return scenario_from_toml(octets.decode("utf-8"))
    except OSError as error:
        msg = f"{name_or_path}: cannot read: {error.strerror}"
        raise ScenarioError(msg) from error
    except ValueError as error:
        msg = f"{name_or_path}: {error}"
        raise ScenarioError(msg) from error
