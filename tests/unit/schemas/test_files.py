"""Schemas of files as `kirotei schema` prints them."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from schemas.files import FILES, file_schema
from services.cli import app


@pytest.mark.parametrize("name", sorted(FILES))
def test_the_schema_of_a_file_is_printed(name: str) -> None:
    result = CliRunner().invoke(app, ["schema", name])
    assert result.exit_code == 0
    printed = json.loads(result.stdout)
    assert printed == json.loads(json.dumps(file_schema(name)))
    assert FILES[name].__name__ in printed["$defs"]


def test_thresholds_need_a_receiver_and_bands() -> None:
    schema = file_schema("thresholds")
    assert schema is not None
    assert schema["$defs"]["Thresholds"]["required"] == ["receiver", "bands"]
    assert schema["$defs"]["Thresholds"]["additionalProperties"] is False


def test_a_name_that_is_neither_is_refused() -> None:
    assert file_schema("gnss/fix") is None
    assert CliRunner().invoke(app, ["schema", "thresholds.toml"]).exit_code == 2
