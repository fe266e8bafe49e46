"""One TOML profile per host, with overrides from the environment, as frozen structs.

`KIROTEI__GNSS_CORRECTION__METHOD=remove` overrides `method` in `[gnss_correction]`: double
underscores nest, and what cannot stand in a variable's name ('@', '-') is an underscore.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from services.runtime.catalogue import service_name, service_names, suggestion
from services.runtime.config_check import Faults, bare, converted, struct_of
from services.runtime.host_config import HostConfig
from services.runtime.node import Service

C = TypeVar("C", bound=msgspec.Struct)
PREFIX = "KIROTEI__"
EMBEDDED = "the embedded demo profile"


class ConfigError(ValueError):
    """A configuration that cannot be used; one line per fault, each naming file and path."""

    def __init__(self, problems: Iterable[str]) -> None:
        """Hold every fault found."""
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))


@dataclass(frozen=True, slots=True)
class Override:
    """One variable of the environment."""

    variable: str
    path: tuple[str, ...]
    """Table and field, lower-case as derived from the variable until matched with known names."""
    text: str


@dataclass(frozen=True, slots=True)
class Profile:
    """A host's configuration: the shared part, and a table for each instance."""

    name: str
    """As it stands in messages: the path as given, or words for the embedded profile."""
    path: Path | None
    host: HostConfig
    tables: Mapping[str, Mapping[str, object]]
    overrides: Mapping[str, tuple[Override, ...]]
    """Variables of the environment, by instance."""

    def instances(self) -> tuple[str, ...]:
        """Instances that are started or have a table."""
        return tuple(dict.fromkeys((*self.host.services, *self.tables, *self.overrides)))

    def service_config(self, instance: str, service: Service[C]) -> C:
        """Settings of an instance. Raises ConfigError that names every fault."""
        table = self.tables.get(instance, {})
        return _settled(table, service.config, self.overrides.get(instance, ()), (self.name, instance))


def load_host(path: Path | None, environment: Mapping[str, str], known: Iterable[str] | None = None) -> Profile:
    """Profile from a TOML file (None: the embedded demo profile) and the environment.

    `known` are the service names that tables and `services` may use, by default all of this
    installation. Raises ConfigError; services' own tables are checked by `service_config`.
    """
    name = str(path) if path is not None else EMBEDDED
    return parse_host(_read(path, name), name, path, environment, tuple(known or service_names()))


def _read(path: Path | None, name: str) -> str:
    try:
        if path is None:
            return (resources.files("services.runtime") / "profiles" / "demo.toml").read_text("utf-8")
        return path.read_text("utf-8")
    except OSError as error:
        raise ConfigError([f"{name}: cannot read: {error.strerror}"]) from error
    except UnicodeDecodeError as error:
        raise ConfigError([f"{name}: not UTF-8 at byte {error.start}"]) from error


def parse_host(
    text: str, name: str, path: Path | None, environment: Mapping[str, str], known: tuple[str, ...]
) -> Profile:
    """Profile from TOML text; see `load_host`."""
    document = _parse_toml(text, name)
    shared = {entry.encode_name for entry in msgspec.structs.fields(HostConfig)}
    problems = []
    tables: dict[str, Mapping[str, object]] = {}
    for key in [key for key in document if key not in shared]:
        table = document.pop(key)
        if service_name(key) not in known:
            problems.append(f"{name}: {key}: unknown field or service{suggestion(key, (*shared, *known))}")
        elif not isinstance(table, dict):
            problems.append(f"{name}: {key}: expected a table [{key}]")
        else:
            tables[key] = table
    named = document.get("services", [])
    instances = (*tables, *(item for item in named if isinstance(item, str))) if isinstance(named, list) else (*tables,)
    overrides, unmatched = _overrides(environment, shared, (*instances, *known))
    problems += unmatched
    try:
        host = _settled(document, HostConfig, overrides.pop("", ()), (name,))
        problems += _instance_problems(host.services, name, known)
    except ConfigError as error:
        problems += error.problems
    if problems:
        raise ConfigError(problems)
    return Profile(name, path, host, tables, overrides)


def _parse_toml(text: str, name: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"^(.*) \(at line (\d+), column (\d+)\)$", str(error))
        if found:
            told = f"{name}:{found[2]}: {found[1]} (column {found[3]})"
        else:
            told = f"{name}:{text.count(chr(10)) + 1}: {error}"
        raise ConfigError([told]) from error


def _instance_problems(instances: tuple[str, ...], name: str, known: tuple[str, ...]) -> list[str]:
    problems = []
    for index, instance in enumerate(instances):
        if service_name(instance) not in known:
            near = suggestion(service_name(instance), known)
            problems.append(f"{name}: services[{index}]: no service {service_name(instance)!r}{near}")
        if instance in instances[:index]:
            problems.append(f"{name}: services[{index}]: {instance!r} stands twice; name instances 'service@name'")
    return problems


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9_]", "_", name.lower())


def _overrides(
    environment: Mapping[str, str], shared: Iterable[str], instances: Iterable[str]
) -> tuple[dict[str, tuple[Override, ...]], list[str]]:
    """Overrides by instance ('' for the shared part), and problems with unknown names."""
    sections = {_plain(instance): instance for instance in reversed(tuple(instances))}
    top = set(shared)
    matched: dict[str, tuple[Override, ...]] = {}
    problems = []
    for variable in sorted(name for name in environment if name.startswith(PREFIX)):
        first, *rest = (_plain(chunk) for chunk in variable.removeprefix(PREFIX).split("__"))
        text = environment[variable]
        if first in top:
            matched[""] = (*matched.get("", ()), Override(variable, (first, *rest), text))
        elif first in sections and rest:
            instance = sections[first]
            matched[instance] = (*matched.get(instance, ()), Override(variable, tuple(rest), text))
        else:
            near = suggestion(first, (*top, *sections))
            problems.append(f"environment {variable}: unknown field or service {first!r}{near}")
    return matched, problems


def _settled(
    table: Mapping[str, object], struct: type[C], overrides: tuple[Override, ...], where: tuple[str, ...]
) -> C:
    """Struct of a table after the overrides; `where` is the profile's name and the path so far."""
    name, *outer = where
    origin: dict[tuple[str, ...], str] = {}
    for override in overrides:
        path, value = _typed(override, struct)
        table = _placed(table, path, value)
        origin[path] = override.variable
    faults = Faults()
    settled = converted(table, struct, faults)
    if settled is not None:
        return settled
    problems = []
    for path, words in faults.found:
        field = tuple(chunk.partition("[")[0] for chunk in path)
        variable = next((origin[field[:end]] for end in range(len(field), 0, -1) if field[:end] in origin), None)
        spot = f"{name}: {'.'.join((*outer, *path))}" if variable is None else f"environment {variable}"
        problems.append(f"{spot}: {words}" if path or outer else f"{name}: {words}")
    raise ConfigError(problems)


def _placed(table: Mapping[str, object], path: tuple[str, ...], value: object) -> dict[str, object]:
    changed = dict(table)
    if len(path) == 1:
        changed[path[0]] = value
    else:
        inner = changed.get(path[0])
        changed[path[0]] = _placed(inner if isinstance(inner, Mapping) else {}, path[1:], value)
    return changed


def _typed(override: Override, struct: type[msgspec.Struct]) -> tuple[tuple[str, ...], object]:
    """Path by the struct's own names, and the text as whatever the field wants."""
    wanted: Any = struct
    path = []
    for chunk in override.path:
        inner = struct_of(bare(wanted))
        fields = {} if inner is None else {_plain(f.encode_name): f for f in msgspec.structs.fields(inner)}
        path.append(fields[chunk].encode_name if chunk in fields else chunk)
        wanted = fields[chunk].type if chunk in fields else Any
    readings = [read for read in (_as_json(override.text), _as_toml(override.text)) if read is not _UNREADABLE]
    for reading in (*readings, override.text):
        try:
            msgspec.convert(reading, wanted)
        except msgspec.ValidationError:
            continue
        return tuple(path), reading
    return tuple(path), readings[0] if readings else override.text


_UNREADABLE = object()


def _as_json(text: str) -> object:
    return _attempt(lambda: json.loads(text))


def _as_toml(text: str) -> object:
    return _attempt(lambda: tomllib.loads(f"value = {text}")["value"])


def _attempt(read: Callable[[], object]) -> object:
    try:
        return read()
    except ValueError:
        return _UNREADABLE
