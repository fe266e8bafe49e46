"""What `kirotei config` tells of a profile and of services' settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from services.runtime.catalogue import load_service, service_name
from services.runtime.config import ConfigError, load_host
from services.runtime.config_words import differences
from services.runtime.host_config import HostConfig


@dataclass(slots=True)
class ConfigReport:
    """What was found in one profile."""

    file: str
    problems: list[str] = field(default_factory=list)
    values: list[tuple[str, str, str]] = field(default_factory=list)
    """Effective settings that are not at their default: path, value, default."""
    notes: list[str] = field(default_factory=list)

    def text(self) -> str:
        """For people: the problems, one per line, or what is set."""
        if self.problems:
            return "\n".join(self.problems)
        lines = [f"{self.file}: valid"]
        width = max((len(path) for path, _, _ in self.values), default=0)
        for path, value, default in self.values:
            origin = "" if default == "required" else f"   (default {default})"
            lines.append(f"  {path:{width}} = {value}{origin}")
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])

    def as_json(self) -> dict[str, object]:
        """For programs."""
        return {
            "file": self.file,
            "valid": not self.problems,
            "problems": self.problems,
            "values": [{"path": path, "value": value, "default": default} for path, value, default in self.values],
            "notes": self.notes,
        }


def checked(path: Path, environment: Mapping[str, str]) -> ConfigReport:
    """Report on a profile, its shared part and every service's table; imports the services."""
    report = ConfigReport(str(path))
    try:
        profile = load_host(path, environment)
    except ConfigError as error:
        report.problems += error.problems
        return report
    report.values += differences(profile.host)
    for instance in profile.instances():
        try:
            config = profile.service_config(instance, load_service(service_name(instance)))
        except ConfigError as error:
            report.problems += error.problems
            continue
        report.values += differences(config, f"{instance}.")
        if instance not in profile.host.services:
            report.notes.append(f"[{instance}] is set but not in `services`: `kirotei up` does not start it")
    return report


def settings_of(service: str) -> type[msgspec.Struct]:
    """Configuration struct of a service, or of the shared part for 'host'. Raises UnknownServiceError."""
    return HostConfig if service == "host" else load_service(service).config
