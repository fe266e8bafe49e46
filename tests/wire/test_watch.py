"""The terminal view and the demonstration, as a user runs them."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from services.runtime.host_config import RouterConfig
from services.runtime.router import open_router
from tests.wire.ports import free_port
from tests.wire.processes import running, write_profile

CLI = ("-m", "services.cli")
METHODS = {"adjust", "original", "remove"}
TABLES = (
    '[simulator]\nscenario = "street_canyon"\n[gnss_correction]\nmethod = "adjust"\ncompare = ["original", "remove"]\n'
)


def test_the_demonstration_gives_live_fixes_with_their_errors_against_truth(tmp_path: Path) -> None:
    port = free_port()
    profile = write_profile(tmp_path, port, services=("simulator", "gnss_correction"), more=TABLES)
    endpoint = f"tcp/127.0.0.1:{port}"
    with running(*CLI, "up", "--profile", str(profile)) as up:
        up.event("all_ready", patience_s=120.0)
        with running(*CLI, "watch", "--once", "--json", "--connect", endpoint) as watch:
            assert watch.ended() == 0
            seen = json.loads("\n".join(watch.lines))
        with running(*CLI, "watch", "--once", "--lang", "ja", "--connect", endpoint) as watch:
            assert watch.ended() == 0
            assert any("● 測位" in line for line in watch.lines)
        with running(*CLI, "watch", "--connect", endpoint) as watch:
            watch.line_with("T1/front  adjust")
            watch.send(signal.SIGINT)
            assert watch.ended() == 0
        up.send(signal.SIGINT)
        assert up.ended(4.0) == 0
    fixes = {fix["method"]: fix for fix in seen["fixes"]}
    assert set(fixes) == METHODS
    assert [fix["method"] for fix in seen["fixes"] if fix["primary"]] == ["adjust"]
    for fix in fixes.values():
        assert fix["status"] == "fix"
        assert fix["age_s"] < 2.0
        # The run begins under open sky; a pseudorange solution there is good to some metres.
        assert fix["error_m"] < 15.0
    assert {service["source"] for service in seen["services"]} == {
        "demo/train/T1/simulator",
        "demo/train/T1/gnss_correction",
    }


def test_a_line_on_which_nobody_speaks_ends_with_code_1() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(RouterConfig(listen=(endpoint,))):
        with running(*CLI, "watch", "--once", "--connect", endpoint, "--line", "quiet") as watch:
            assert watch.ended() == 1
        assert watch.errors == ["kirotei watch: nothing heard on line quiet within 10 s"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--connect", "nonsense"), "'nonsense' is no endpoint such as tcp/127.0.0.1:7447"),
        (("--line", "a/b"), "line 'a/b' cannot stand in a key"),
        (("--lang", "de"), "--lang de: there are en and ja"),
        (("--json",), "--json goes with --once"),
    ],
)
def test_what_cannot_be_meant_ends_with_code_2(arguments: tuple[str, ...], words: str) -> None:
    with running(*CLI, "watch", *arguments) as watch:
        assert watch.ended() == 2
    assert watch.errors[0].startswith(f"kirotei watch: {words}")
