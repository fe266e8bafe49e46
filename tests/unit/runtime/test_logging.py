"""The log's lines: JSON stays JSON whatever libraries do, text is readable."""

from __future__ import annotations

import contextlib
import io
import json
import logging
import os
import subprocess
import sys
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
import structlog

from services.runtime.host_config import LogConfig
from services.runtime.logging import configure, wants_colour, wants_json


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def _put_back() -> Iterator[None]:
    """Give the process its own logging, hooks and warnings back."""
    handlers, level, hook = logging.root.handlers[:], logging.root.level, threading.excepthook
    yield
    logging.captureWarnings(capture=False)
    logging.root.handlers[:], threading.excepthook = handlers, hook
    logging.root.setLevel(level)
    structlog.reset_defaults()
    structlog.contextvars.clear_contextvars()


def test_json_lines_carry_event_level_time_and_what_is_bound() -> None:
    stream = io.StringIO()
    log = configure(LogConfig(format="json"), stream, service="recorder", line="demo", place="train/T1")
    log.bind(boot="b1").info("ready", depth=3)
    (line,) = stream.getvalue().splitlines()
    event = json.loads(line)
    assert event.pop("time").endswith("Z")
    assert event == {
        "event": "ready",
        "level": "info",
        "service": "recorder",
        "line": "demo",
        "place": "train/T1",
        "boot": "b1",
        "depth": 3,
    }


def test_exceptions_warnings_libraries_and_threads_stay_json_lines() -> None:
    stream = io.StringIO()
    log = configure(LogConfig(format="json"), stream, service="x")
    try:
        int("two\nlines")
    except ValueError:
        log.exception("failed")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.warn("old\nways", stacklevel=1)
    logging.getLogger("numba").warning("slow %s", "path")
    logging.getLogger("numba").info("not wanted")
    thread = threading.Thread(target=lambda: 1 / 0, name="worker")
    thread.start()
    thread.join()
    events = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert [event["event"] for event in events] == ["failed", "library_warning", "library_warning", "thread_failed"]
    assert "ValueError: invalid literal" in events[0]["exception"]
    assert "old ways" in events[1]["text"]
    assert (events[2]["library"], events[2]["text"]) == ("numba", "slow path")
    assert "ZeroDivisionError" in events[3]["exception"]


def test_what_json_cannot_say_is_said_in_words() -> None:
    stream = io.StringIO()
    configure(LogConfig(format="json"), stream).info("odd", thing=object, octets=b"\xff", number=float("nan"))
    assert json.loads(stream.getvalue())["event"] == "odd"


def test_the_level_is_a_floor() -> None:
    stream = io.StringIO()
    log = configure(LogConfig(format="json", level="warning"), stream)
    log.info("quiet")
    log.warning("loud")
    assert [json.loads(line)["event"] for line in stream.getvalue().splitlines()] == ["loud"]


def test_text_is_plain_without_colour() -> None:
    stream = io.StringIO()
    configure(LogConfig(format="text"), stream, service="recorder").info("ready", depth=3)
    assert "\x1b" not in stream.getvalue()
    assert "ready" in stream.getvalue()
    assert "depth=3" in stream.getvalue()


def test_the_format_follows_the_stream_unless_it_is_set() -> None:
    assert wants_json(LogConfig(), io.StringIO())
    assert not wants_json(LogConfig(), Terminal())
    assert wants_json(LogConfig(format="json"), Terminal())
    assert not wants_json(LogConfig(format="text"), io.StringIO())


def test_colour_follows_the_stream_and_the_usual_variables() -> None:
    assert wants_colour({}, Terminal())
    assert not wants_colour({}, io.StringIO())
    assert wants_colour({"FORCE_COLOR": "1"}, io.StringIO())
    assert not wants_colour({"NO_COLOR": "1", "FORCE_COLOR": "1"}, Terminal())


def test_native_prints_do_not_reach_the_logs_stream() -> None:
    script = """
import os, sys
from services.runtime.host_config import LogConfig
from services.runtime.logging import configure, guard_stdout
log = configure(LogConfig(format="json"), guard_stdout())
os.write(1, b"native\\n")
print("python")
sys.stdout.flush()
log.info("ready")
"""
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30)
    assert [json.loads(line)["event"] for line in done.stdout.splitlines()] == ["ready"]
    assert done.stderr.split() == ["native", "python"]


def test_a_log_whose_reader_has_gone_ends_nothing() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    lost: list[str] = []
    stream = os.fdopen(writer, "w", buffering=1)
    log = configure(LogConfig(format="json"), stream, on_lost=lambda: lost.append("lost"))
    log.info("first")
    log.info("second")
    assert lost == ["lost"]
    with contextlib.suppress(BrokenPipeError):
        stream.close()
    log.info("third")


def test_a_full_disk_ends_nothing() -> None:
    with Path("/dev/full").open("w", buffering=1, encoding="ascii") as full:
        log = configure(LogConfig(format="json"), full, on_lost=lambda: pytest.fail("a full disk is no lost reader"))
        log.info("first")
        with contextlib.suppress(OSError):
            full.close()
