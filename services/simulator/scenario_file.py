"""Scenarios in TOML files, and those that come with Kirotei."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from schemas.line import Line
from services.line.alignment import Alignment, alignment_of
from services.line.chainage import Chainage
from services.line.line_file import load_line
from services.simulator.radio_scenario import RadioScenario, is_radio_scenario, radio_scenario_from_toml
from services.simulator.radio_world import RadioLine
from services.simulator.scenario import Scenario, ScenarioError, scenario_from_toml
from services.simulator.train_scenario import TrainScenario, is_train_scenario, train_scenario_from_toml

_FOLDER = resources.files("services.simulator") / "scenarios"
LARGEST_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class LoadedRoute:
    """A line, and the way of a train along it."""

    line: Line
    alignment: Alignment


def embedded_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that come with Kirotei."""
    return tuple(
        sorted(entry.name.removesuffix(".toml") for entry in _FOLDER.iterdir() if entry.name.endswith(".toml"))
    )


def read_scenario(name_or_path: str) -> Scenario:
    """Scenario of a receiver alone; see `read_any_scenario`. Raises ScenarioError, also for any other kind."""
    found = read_any_scenario(name_or_path)
    if not isinstance(found, Scenario):
        what = "a whole train" if isinstance(found, TrainScenario) else "radio passes"
        msg = f"{name_or_path}: the scenario of {what}, not of a receiver alone"
        raise ScenarioError(msg)
    return found


def read_any_scenario(name_or_path: str) -> Scenario | TrainScenario | RadioScenario:
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
        text = octets.decode("utf-8")
        if is_radio_scenario(text):
            return radio_scenario_from_toml(text)
        return train_scenario_from_toml(text) if is_train_scenario(text) else scenario_from_toml(text)
    except OSError as error:
        msg = f"{name_or_path}: cannot read: {error.strerror}"
        raise ScenarioError(msg) from error
    except ValueError as error:
        msg = f"{name_or_path}: {error}"
        raise ScenarioError(msg) from error


def alignment_for(scenario: TrainScenario) -> LoadedRoute | None:
    """Line and route of a train's scenario; None on a track drawn at random. Raises ScenarioError."""
    return None if scenario.line is None else _load(scenario.line, scenario.journey.branch)


def radio_line_for(scenario: RadioScenario) -> tuple[RadioLine, Chainage | None]:
    """Radios of a scenario of passes, and the kilometrage where its line has one. Raises ScenarioError."""
    if scenario.straight is not None:
        return scenario.straight.line(), None
    loaded = _load(str(scenario.line), "")
    return radio_line_of(loaded), loaded.alignment.chainage


def train_radio_line(scenario: TrainScenario, loaded: LoadedRoute | None) -> RadioLine | None:
    """Radios along a train's route; None for a train without a radio. Raises ScenarioError."""
    return radio_line_of(loaded) if scenario.radio is not None and loaded is not None else None


def radio_line_of(loaded: LoadedRoute) -> RadioLine:
    """Radios along a route. Raises ScenarioError when it has none."""
    alignment = loaded.alignment
    if not loaded.line.radio_sites:
        msg = f"line {loaded.line.id}: no radio_sites"
        raise ScenarioError(msg)
    return RadioLine(alignment.length_m, loaded.line.radio_sites, alignment.surroundings_along)


def _load(name: str, branch: str) -> LoadedRoute:
    try:
        line = load_line(Path(name)).line
        return LoadedRoute(line, alignment_of(line, branch))
    except OSError as error:
        msg = f"{name}: cannot read: {error.strerror}"
        raise ScenarioError(msg) from error
    except (ValueError, KeyError) as error:
        words = error.args[0] if isinstance(error, KeyError) else error
        msg = f"line {name}: {words}"
        raise ScenarioError(msg) from error
