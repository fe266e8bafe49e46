"""Profiles that are delivered are valid, and the embedded one is the documented one."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.runtime.config import load_host
from services.runtime.config_report import checked

ROOT = Path(__file__).parents[3]
PROFILES = sorted((ROOT / "deploy" / "profiles").glob("*.toml"))


def test_the_embedded_demo_is_the_documented_one() -> None:
    embedded = ROOT / "services" / "runtime" / "profiles" / "demo.toml"
    assert embedded.read_bytes() == (ROOT / "deploy" / "profiles" / "demo.toml").read_bytes()


@pytest.mark.parametrize("path", PROFILES, ids=lambda path: path.name)
def test_a_profile_passes_its_check(path: Path) -> None:
    report = checked(path, {})
    assert report.problems == []
    assert report.notes == [], "every table belongs to a service that is started"


def test_there_is_a_profile_for_every_kind_of_place() -> None:
    assert {load_host(path, {}).host.place.kind for path in PROFILES} == {"train", "wayside", "cloud"}
