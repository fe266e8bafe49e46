"""What a viewer makes of positions and events of trains."""

from __future__ import annotations

import io

import msgspec
import pytest
from rich.console import Console

from schemas.motion import SlipEpisode
from schemas.position import LandmarkMatch, MotionTruth, PositionEvent, ReferencePass, TrainPosition
from services.runtime.watch_state import MAX_ROWS, WatchState
from services.runtime.watch_trains import EVENTS_SHOWN_S, STALE_AFTER_S, TrainView
from services.runtime.watch_trains_view import ruler_line
from services.runtime.watch_view import plain_lines, render
from services.runtime.watch_words import Language

NS = 10**9


def position(
    at_s: float, axis_m: float = 1000.0, ahead_m: float = 6.0, behind_m: float = 4.0, **more: object
) -> TrainPosition:
    fields: dict[str, object] = {
        "t_ns": round(at_s * NS),
        "status": "valid",
        "reason": "",
        "branch": "",
        "axis_m": axis_m,
        "chainage_m": 12_345.6,
        "direction": "up",
        "speed_mps": 20.0,
        "bound_ahead_m": ahead_m,
        "bound_behind_m": behind_m,
        "reference": "R300-4",
        "reference_distance_m": 412.0,
    }
    return TrainPosition(**{**fields, **more})  # type: ignore[arg-type]  # fields by name


def truth(at_s: float, axis_m: float, branch: str = "") -> MotionTruth:
    return MotionTruth(
        t_ns=round(at_s * NS),
        axis_m=axis_m,
        branch=branch,
        chainage_m=axis_m,
        distance_m=axis_m,
        speed_mps=20.0,
        acceleration_mps2=0.0,
        slip=0,
        gradient_permille=0.0,
        curvature_per_m=0.0,
    )


def text_of(state: WatchState, now_s: float, language: Language = "en", width: int = 150) -> str:
    file = io.StringIO()
    Console(file=file, width=width, color_system=None).print(render(state, now_s, language))
    return file.getvalue()


def driving() -> WatchState:
    state = WatchState("demo")
    state.take_of_train("T1", position(10.0), 10.0, 0.02)
    for at_s, axis_m in ((9.9, 999.5), (10.1, 1003.5)):
        state.take_of_train("T1", truth(at_s, axis_m), at_s, 0.0)
    return state


def test_error_is_taken_against_the_truth_between_its_samples() -> None:
    view = driving().trains["T1"]
    assert view.error_m == pytest.approx(1.5)
    assert view.outside == 0


@pytest.mark.parametrize(
    ("true_m", "direction", "outside"),
    [(1005.9, "up", 0), (1006.1, "up", 1), (995.9, "up", 1), (1005.9, "down", 1), (994.1, "down", 0)],
)
def test_a_truth_outside_the_bounds_is_counted(true_m: float, direction: str, outside: int) -> None:
    view = TrainView("T1")
    view.take(position(10.0, direction=direction), 10.0, 0.0)
    view.take(truth(10.0, true_m), 10.0, 0.0)
    assert view.outside == outside


def test_a_truth_on_another_branch_gives_no_error() -> None:
    view = TrainView("T1")
    view.take(position(10.0), 10.0, 0.0)
    view.take(truth(10.0, 1000.0, branch="harbour"), 10.0, 0.0)
    assert view.error_m is None
    assert not view.errors


def test_the_place_is_shown_with_its_bounds_and_the_truth_between_them() -> None:
    text = text_of(driving(), 10.2)
    (row,) = (line for line in text.splitlines() if "12k345.6" in line)
    assert "● valid" in row
    assert "-4.0 +6.0 m" in row
    assert "72 km/h" in row
    assert "R300-4, 412 m ago" in row
    assert "-1.5 m" in row, "error is the estimate less the truth"
    (ruler,) = (line for line in text.splitlines() if "±10 m" in line)
    assert ruler.index("[") < ruler.index("●") < ruler.index("×") < ruler.index("]")
    # Half a ruler is 10 m: the bounds stand at 4 and 6 tenths of it, within a cell.
    middle, half = ruler.index("●"), (ruler.rindex("·") - ruler.index("·")) / 2
    assert ruler.index("]") - middle == pytest.approx(0.6 * half, abs=1.5)
    assert middle - ruler.index("[") == pytest.approx(0.4 * half, abs=1.5)


def test_a_train_running_down_has_its_front_on_the_other_side() -> None:
    view = TrainView("T1")
    view.take(position(10.0, ahead_m=9.0, behind_m=1.0, direction="down"), 10.0, 0.0)
    ruler = ruler_line(view, 80)
    assert ruler.index("●") - ruler.index("[") > 5 * (ruler.index("]") - ruler.index("●"))


def test_a_silent_train_is_stale_and_shows_no_place() -> None:
    text = text_of(driving(), 10.0 + STALE_AFTER_S + 1.0)
    assert "◇ stale" in text
    assert "12k345.6" not in text
    assert "±10 m" not in text


def test_a_lost_position_says_why() -> None:
    state = WatchState("demo")
    nowhere: dict[str, object] = {"axis_m": None, "chainage_m": None, "bound_ahead_m": None, "bound_behind_m": None}
    lost = msgspec.structs.replace(position(10.0, status="lost", reason="no reference yet"), **nowhere)
    state.take_of_train("T1", lost, 10.0, 0.0)
    assert "■ lost" in text_of(state, 10.1)
    assert "no reference yet" in text_of(state, 10.1)
    assert plain_lines(state, 10.1)[0].startswith("T1  ■  lost")


def test_what_happened_stands_below_newest_first_and_goes_after_a_while() -> None:
    state = driving()
    for at_s, message in (
        (11.0, PositionEvent(t_ns=0, kind="reset", text="landmark R300-4")),
        (
            12.0,
            SlipEpisode(
                t_ns=0,
                origin="o",
                episode=1,
                phase="ended",
                slip=-1,
                start_t_ns=0,
                correction_s=8.0,
                corrected_m=14.2,
                bound_m=3.0,
                stop_demanded=False,
                reason="",
            ),
        ),
        (
            13.0,
            ReferencePass(
                t_ns=0, reference="B3", kind="balise", axis_m=1.0, error_m=9.0, bound_m=5.0, within=False, way_m=1.0
            ),
        ),
    ):
        state.take_of_train("T1", message, at_s, 0.0)
    text = text_of(state, 14.0)
    assert text.index("OUTSIDE ±5.0 m") < text.index("slide ended after 8 s, +14.2 m") < text.index("reset: landmark")
    assert "slide ended" not in text_of(state, 15.0 + EVENTS_SHOWN_S)


def test_a_refused_landmark_says_why() -> None:
    state = driving()
    match = LandmarkMatch(
        t_ns=0,
        landmark="R300-4",
        direction="up",
        accepted=False,
        reason="upper limit",
        origin="o",
        distance_m=1.0,
        axis_m=1.0,
        correction_m=0.0,
        bound_m=1.0,
        database_version="1",
        line_version="1",
    )
    state.take_of_train("T1", match, 11.0, 0.0)
    assert "landmark R300-4 refused: upper limit" in text_of(state, 11.0)


def test_every_word_is_there_in_japanese() -> None:
    text = text_of(driving(), 10.2, "ja")
    for word in ("列車 T1 の位置", "有効", "キロ程", "先頭の範囲", "最後の基準点"):
        assert word in text


def test_a_flood_of_trains_is_not_kept() -> None:
    state = WatchState("demo")
    for k in range(MAX_ROWS + 5):
        state.take_of_train(f"T{k}", position(1.0), 1.0, 0.0)
    assert len(state.trains) == MAX_ROWS
    assert state.crowded


@pytest.mark.parametrize("width", [30, 60, 100, 200])
def test_any_width_can_be_drawn(width: int) -> None:
    assert "●" in text_of(driving(), 10.2, width=width)
