"""The terminal view in text: what a person reads off it."""

from __future__ import annotations

import io

import pytest
from rich.cells import cell_len
from rich.console import Console

from services.runtime.sparkline import buckets, spark
from services.runtime.watch_state import WatchState
from services.runtime.watch_view import plain_lines, render
from services.runtime.watch_words import WORDS, Language
from tests.unit.runtime.test_watch_state import fix_at, health, truth


def text_of(state: WatchState, now_s: float, language: Language = "en", width: int = 140) -> str:
    console = Console(file=io.StringIO(), width=width, color_system=None)
    console.print(render(state, now_s, language))
    file = console.file
    assert isinstance(file, io.StringIO)
    return file.getvalue()


def line_of(text: str, word: str) -> str:
    (line,) = (line for line in text.splitlines() if word in line)
    return line


def driving() -> WatchState:
    """A train with three methods at time 10 s, errors 3, 12 and none, and two services."""
    state = WatchState("demo")
    state.take_truth("T1", "front", truth(10.0), heard_s=10.0)
    state.take_fix("T1", "front", fix_at(10.0, 3.0, "adjust"), primary=True, heard_s=10.0, delay_s=0.02)
    state.take_fix("T1", "front", fix_at(10.0, 12.0, "original"), primary=False, heard_s=10.0, delay_s=0.02)
    state.take_fix("T1", "front", fix_at(10.0, None, "remove"), primary=False, heard_s=10.0, delay_s=0.02)
    state.take_health("demo/train/T1/simulator", health(5.0, 50), heard_s=9.0, delay_s=0.0)
    state.take_health("demo/train/T1/simulator", health(6.0, 60), heard_s=10.0, delay_s=0.0)
    state.take_health("demo/train/T1/gnss", health(6.0, 60, level="degraded", missing=4), heard_s=10.0, delay_s=0.0)
    return state


def test_every_method_has_its_line_the_primary_one_first() -> None:
    text = text_of(driving(), 10.2)
    rows = [line for line in text.splitlines() if "0.2 s" in line and "train/" not in line]
    assert [row.split()[1] for row in rows] == ["adjust", "original", "remove"]
    assert "adjust *" in rows[0]
    assert rows[0].split()[3:8] == ["●", "fix", "0.2", "s", "0.000027"]
    assert "3.0 m" in rows[0]
    assert "12.0 m" in rows[1]
    assert "■ none: 3 satellites" in rows[2]


def test_the_surroundings_stand_above_the_table() -> None:
    assert "train T1, receiver front · street canyon" in text_of(driving(), 10.2)


def test_a_silent_train_is_stale_with_its_age_and_no_current_figures() -> None:
    text = text_of(driving(), 85.0)
    row = line_of(text, "adjust *")
    assert "◇ stale" in row
    assert "75 s" in row
    assert "●" not in row
    assert "street canyon" not in text


@pytest.mark.parametrize(
    ("now_s", "word", "expected"),
    [
        (10.2, "T1/simulator", "● ok"),
        (10.2, "T1/gnss", "▲ degraded"),
        (16.0, "T1/simulator", "◇ lost"),
        (16.0, "T1/gnss", "◇ lost"),
    ],
)
def test_a_service_has_a_shape_and_a_word(now_s: float, word: str, expected: str) -> None:
    assert expected in line_of(text_of(driving(), now_s), word)


def test_a_service_shows_rate_losses_and_reasons() -> None:
    assert "10.0" in line_of(text_of(driving(), 10.2), "T1/simulator")
    row = line_of(text_of(driving(), 10.2), "T1/gnss")
    assert "4" in row.split()
    assert "no sky" in row


def test_failed_services_are_squares() -> None:
    state = driving()
    state.take_health("demo/train/T1/gnss", health(7.0, 61, level="failed"), heard_s=10.1, delay_s=0.0)
    assert "■ failed" in line_of(text_of(state, 10.2), "T1/gnss")


def test_nothing_heard_is_said() -> None:
    assert "nothing heard yet" in text_of(WatchState("demo"), 0.0)


def test_japanese_says_the_same() -> None:
    text = text_of(driving(), 10.2, "ja")
    for word in ("路線 demo", "測位", "不能", "低下", "補正なし", "直近1分"):
        assert word in text
    assert "nothing heard" not in text_of(WatchState("demo"), 0.0, "ja")


def test_both_languages_have_every_word_with_the_same_places() -> None:
    for entry in WORDS.values():
        assert set(entry) == {"en", "ja"}
        assert entry["en"].count("{") == entry["ja"].count("{")


@pytest.mark.parametrize("width", [40, 80, 100, 200])
def test_it_fits_the_terminal_and_always_says_how_a_fix_stands(width: int) -> None:
    text = text_of(driving(), 85.0, width=width)
    assert max(cell_len(line) for line in text.splitlines()) <= width
    row = line_of(text, "adjust *")
    assert "◇" in row
    assert "75 s" in row


def test_markup_in_names_and_reasons_is_shown_as_it_is() -> None:
    state = driving()
    state.take_health("demo/train/[red]T9/x", health(1.0, 1, level="degraded"), heard_s=10.0, delay_s=0.0)
    assert "[red]T9" in text_of(state, 10.2)


def test_plain_lines_say_the_same_for_pipes() -> None:
    lines = plain_lines(driving(), 10.2)
    assert lines[0].startswith("T1/front  adjust  ●  fix  age 0.2 s")
    assert lines[2].startswith("T1/front  remove  ■  none")
    assert [line for line in lines if "simulator" in line] == [], "a service that is well needs no line"
    assert lines[3].startswith("train/T1/gnss  ▲ degraded")
    stale = plain_lines(driving(), 85.0)
    assert stale[0].startswith("T1/front  adjust  ◇  stale  age 75 s")
    assert "0.000027" not in stale[0]


def test_a_chart_shows_the_largest_of_each_stretch_and_where_nothing_was() -> None:
    points = [(0.0, 1.0), (0.5, 7.0), (2.5, 3.0), (-1.0, 99.0), (4.0, 99.0)]
    assert buckets(points, 0.0, 4.0, 4) == [7.0, None, 3.0, None]
    assert spark([7.0, None, 3.0, None], 8.0) == "█·▄·"
