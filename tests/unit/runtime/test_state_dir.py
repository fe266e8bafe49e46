"""Where state is kept, and what happens where it cannot be."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from services.runtime.state_dir import VARIABLE, kernel_fingerprint, prepare, state_dir


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


def test_kernels_are_kept_in_the_state_folder_apart_for_every_version_of_their_sources(tmp_path: Path) -> None:
    environment: dict[str, str] = {}
    assert prepare(tmp_path / "state", environment) is None
    kernels = tmp_path / "state" / "kernels" / kernel_fingerprint()
    assert environment[VARIABLE] == f"{tmp_path}/state"
    assert environment["NUMBA_CACHE_DIR"] == str(kernels)
    assert kernels.is_dir()


def test_kernels_of_sources_long_gone_are_removed(tmp_path: Path) -> None:
    for age, name in enumerate(["newest", "new", "old", "older", "oldest"]):
        folder = tmp_path / "kernels" / name
        folder.mkdir(parents=True)
        os.utime(folder, (1e9 - age, 1e9 - age))
    prepare(tmp_path, {})
    left = {path.name for path in (tmp_path / "kernels").iterdir()}
    assert left == {"newest", "new", "old", kernel_fingerprint()}


def test_small_matrices_are_not_divided_unless_the_user_says_so(tmp_path: Path) -> None:
    ours: dict[str, str] = {}
    theirs = {"OPENBLAS_NUM_THREADS": "4"}
    for environment in (ours, theirs):
        prepare(tmp_path, environment)
    assert ours["OPENBLAS_NUM_THREADS"] == "1"
    assert theirs["OPENBLAS_NUM_THREADS"] == "4"


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
