"""When an ended process is started again, and how its output is dressed."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.runtime.child_output import LineSplitter, OutputStyle
from services.runtime.restart_policy import FIRST_WAIT_S, HEALTHY_S, LONGEST_WAIT_S, RestartPolicy, exit_words


def test_waits_double_up_to_the_longest() -> None:
    policy = RestartPolicy()
    waits = [policy.after_exit(1, None) for _ in range(8)]
    assert waits == [0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 10.0, 10.0]
    assert policy.restarts == 8


def test_half_a_minute_of_health_earns_the_shortest_wait_again() -> None:
    policy = RestartPolicy()
    for _ in range(5):
        policy.after_exit(1, HEALTHY_S - 0.1)
    assert policy.after_exit(-9, HEALTHY_S) == FIRST_WAIT_S
    assert policy.after_exit(-9, 0.0) == 2 * FIRST_WAIT_S


def test_work_that_is_done_is_not_done_again_unless_it_must_run_for_ever() -> None:
    assert RestartPolicy().after_exit(0, 5.0) is None
    assert RestartPolicy(restart_when_done=True).after_exit(0, 5.0) == FIRST_WAIT_S


@given(st.lists(st.tuples(st.integers(-64, 255), st.none() | st.floats(0, 1e6)), max_size=40))
def test_waits_stay_within_their_limits(exits: list[tuple[int, float | None]]) -> None:
    policy = RestartPolicy(restart_when_done=True)
    for code, ready_for_s in exits:
        wait_s = policy.after_exit(code, ready_for_s)
        assert wait_s is not None
        assert FIRST_WAIT_S <= wait_s <= LONGEST_WAIT_S


@pytest.mark.parametrize(
    ("code", "words"),
    [(1, "exit code 1"), (-11, "killed by signal 11 (SIGSEGV)"), (-63, "killed by signal 63")],
)
def test_an_end_in_words(code: int, words: str) -> None:
    assert exit_words(code) == words


@given(st.lists(st.binary(max_size=30), max_size=20))
def test_lines_come_out_whole_however_they_are_cut(chunks: list[bytes]) -> None:
    splitter = LineSplitter()
    lines = [line for chunk in chunks for line in splitter.take(chunk)] + splitter.finish()
    whole = b"".join(chunks)
    assert b"\n".join(lines) == whole.removesuffix(b"\n")


def test_a_line_without_end_does_not_fill_the_memory() -> None:
    splitter = LineSplitter()
    lines = [line for _ in range(64) for line in splitter.take(b"x" * 65_536)]
    assert sum(map(len, lines)) >= 3 << 20


def test_json_lines_pass_as_they_are_and_others_are_wrapped() -> None:
    style = OutputStyle(json=True, colour=False)
    assert style.dressed("recorder", b'{"event":"ready"}', error=False) == '{"event":"ready"}'
    for line, error in ((b"Traceback", True), (b"hello", False), (b'{"event":1}', True), (b"\xff{", False)):
        wrapped = json.loads(style.dressed("recorder", line, error=error))
        assert (wrapped["event"], wrapped["service"]) == ("output", "recorder")
        assert wrapped["stream"] == ("stderr" if error else "stdout")


def test_text_carries_its_sender_in_a_colour_of_its_own() -> None:
    plain = OutputStyle(json=False, colour=False, width=9)
    assert plain.dressed("recorder", b"ready\r", error=False) == "recorder  | ready"
    assert plain.dressed("recorder", b"panic", error=True) == "recorder  ! panic"
    coloured = OutputStyle(json=False, colour=True, width=4)
    first, second = (coloured.dressed(name, b"x", error=False) for name in ("a", "b"))
    assert first.split("m", 1)[0] != second.split("m", 1)[0]
    assert coloured.dressed("a", b"x", error=False) == first
