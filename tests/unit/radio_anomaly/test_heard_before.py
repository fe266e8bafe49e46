"""What was learned is known again by its senders' numbers."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from services.radio_anomaly.heard_before import MOST_SENDERS, HeardBefore
from services.radio_anomaly.live_passes import LivePass

LINE = "demo/train/T1/cab/line"


def test_up_to_the_last_number_of_a_pass_that_is_over_all_is_said_again() -> None:
    heard = HeardBefore()
    assert heard.is_again(LINE, "a", 0, 100) == "new"
    heard.learned(LINE, {"a": (41, 100)})
    assert [heard.is_again(LINE, "a", number, 50) for number in (0, 41, 42)] == ["again", "again", "new"]
    assert heard.is_again(LINE, "a", 0, 101) == "renumbered"
    assert heard.is_again(LINE, "b", 0, 50) == "new", "another start of the sender"
    assert heard.is_again("demo/train/T1/cab/site", "a", 0, 50) == "new", "a period at a site is a pass of its own"
    assert heard.is_again(LINE, "", -1, 50) == "new", "a sender that marks nothing keeps nothing to say again"


def test_a_pass_without_numbers_leaves_no_mark() -> None:
    current = LivePass(source=LINE, device="cab", name="P", direction="up")
    current.note("", -1, 100)
    assert current.heard == {}
    current.note("a", 7, 100)
    current.note("a", 8, 60)
    assert current.heard == {"a": (8, 100)}


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 99), st.integers(0, 99)), max_size=30))
def test_what_was_learned_is_never_new_again_also_once_kept(said: list[tuple[str, int, int]]) -> None:
    heard = HeardBefore()
    for boot_id, number, t_ns in said:
        heard.learned(LINE, {boot_id: (number, t_ns)})
    for one in (heard, HeardBefore(heard.kept())):
        assert all(one.is_again(LINE, boot_id, number, t_ns) == "again" for boot_id, number, t_ns in said)


def test_senders_of_long_ago_are_forgotten_first() -> None:
    heard = HeardBefore()
    for number in range(MOST_SENDERS):
        heard.learned(LINE, {f"boot-{number}": (9, 100)})
    heard.learned(LINE, {"boot-0": (12, 100)})
    heard.learned(LINE, {"one more": (9, 100)})
    assert len(heard.kept()) == MOST_SENDERS
    assert [heard.is_again(LINE, f"boot-{n}", 9, 100) for n in (0, 1, 2)] == ["again", "new", "again"]
