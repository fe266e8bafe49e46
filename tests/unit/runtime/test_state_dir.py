"""Where state is kept, and what happens where it cannot be."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.runtime.state_dir import VARIABLE, prepare, state_dir


@pytest.mark.parametrize(
    ("environment", "configured", "expected"),
    [
        ({"HOME": "/home/a"}, None, "/home/a/.local/state/kirotei"),
        ({"HOME": "/home/a", "XDG_STATE_HOME": "/s"}, None, "/s/kirotei"),
        ({"XDG_STATE_HOME": "/s", "STATE_DIRECTORY": "/var/lib/kirotei:/x"}, None, "/var/lib/kirotei"),
        ({"STATE_DIRECTORY": "/var/lib/kirotei", VARIABLE: "/handed"}, None, "/handed"),
        ({VARIABLE: "/handed"}, "/configured", "/configured"),
        ({}, None, "/var/lib/.local/state/kirotei"),
    ],
)
def test_the_nearest_word_counts(environment: dict[str, str], configured: str | None, expected: str) -> None:
    assert state_dir(environment, configured) == Path(expected)


def test_kernels_are_kept_in_the_state_folder(tmp_path: Path) -> None:
    environment: dict[str, str] = {}
    assert prepare(tmp_path / "state", environment) is None
    assert environment == {VARIABLE: f"{tmp_path}/state", "NUMBA_CACHE_DIR": f"{tmp_path}/state/kernels"}
    assert (tmp_path / "state" / "kernels").is_dir()


def test_a_folder_of_the_users_own_is_kept(tmp_path: Path) -> None:
    environment = {"NUMBA_CACHE_DIR": "/mine"}
    assert prepare(tmp_path / "state", environment) is None
    assert environment["NUMBA_CACHE_DIR"] == "/mine"


def test_where_nothing_can_be_written_kernels_go_to_a_folder_of_this_start_alone(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    environments: list[dict[str, str]] = [{}, {}]
    for environment in environments:
        warning = prepare(tmp_path / "file", environment)
        assert warning is not None
        assert f"{tmp_path}/file" in warning
    first, second = (Path(environment["NUMBA_CACHE_DIR"]) for environment in environments)
    assert first != second
    for folder in (first, second):
        assert folder.stat().st_mode & 0o077 == 0, "nobody else may plant compiled code"
        folder.rmdir()
