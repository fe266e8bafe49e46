"""Settings in words: for the documentation, for `config show`, and what differs from the default."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest
from msgspec import Meta

from services.runtime.catalogue import UnknownServiceError, load_service, service_names
from services.runtime.config_words import config_table, differences, field_rows
from services.runtime.host_config import BusConfig, HostConfig, PlaceConfig

ROOT = Path(__file__).parents[3]


class Inner(msgspec.Struct, frozen=True, kw_only=True):
    """Inner table."""

    gain: float = 2.0


class Sample(msgspec.Struct, frozen=True, kw_only=True):
    """Settings with one of each kind."""

    device: str
    """Name of the
    receiver."""
    threshold_m: Annotated[float, Meta(ge=0.0, lt=9.0)] = 0.45
    mode: Literal["a", "b"] | None = None
    """One | two."""
    inner: Inner = Inner()
    names: tuple[str, ...] = ("x",)


def test_rows_tell_type_limits_default_and_meaning() -> None:
    rows = {row.name: (row.type, row.limits, row.default, row.about) for row in field_rows(Sample)}
    assert rows == {
        "device": ("string", "", "required", "Name of the receiver."),
        "threshold_m": ("float", ">= 0 and < 9", "0.45", ""),
        "mode": ("one of a, b, or nothing", "", "nothing", "One | two."),
        "inner.gain": ("float", "", "2.0", ""),
        "names": ("list of string", "", '["x"]', ""),
    }


def test_the_markdown_table_escapes_what_would_end_a_cell() -> None:
    assert "| `mode` | one of a, b, or nothing |  | `nothing` | One \\| two. |" in config_table(Sample).splitlines()


def test_only_what_is_not_at_its_default_differs() -> None:
    host = HostConfig(place=PlaceConfig(line="demo", kind="train", name="T1"), bus=BusConfig(lease_s=3.0))
    assert differences(host) == [
        ("place.line", '"demo"', "required"),
        ("place.kind", '"train"', "required"),
        ("place.name", '"T1"', "required"),
        ("bus.lease_s", "3.0", "2.0"),
    ]


def test_every_shared_setting_stands_in_the_documentation() -> None:
    page = (ROOT / "docs" / "configuration.md").read_text("utf-8")
    assert config_table(HostConfig) in page, "paste the output of `kirotei config show host` into docs/configuration.md"


def test_the_catalogue_finds_services_by_folder() -> None:
    names = service_names()
    assert "simulator" in names
    assert "runtime" not in names
    assert load_service("simulator").name == "simulator"
    with pytest.raises(UnknownServiceError, match=r"no service 'simulater', did you mean simulator\?"):
        load_service("simulater")
