"""The ephemeris of each satellite whose reference time is nearest, and when that changes."""

from __future__ import annotations

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from schemas.gnss import Ephemeris
from schemas.gnss_time import WEEK_S
from services.gnss_receiver.broadcast_choice import BroadcastChoice
from services.gnss_receiver.rinex_navigation import parse_navigation
from tests.unit.gnss_receiver.navigation_samples import GPS, header_3, record_3
from tests.unit.gnss_receiver.samples import text_of

(TEMPLATE,) = parse_navigation([("", text_of(header_3(), record_3("G01", "2016 06 06 00 00 00", GPS)))]).ephemerides
START_S = 1900 * WEEK_S


def ephemeris(satellite: str, toe_s: int, sent_s: int = 0) -> Ephemeris:
    week, of_week_s = divmod(START_S + toe_s, WEEK_S)
    return msgspec.structs.replace(
        TEMPLATE, satellite=satellite, gps_week=week, toe_s=float(of_week_s), t_ns=sent_s * 10**9
    )


def test_all_at_first_then_only_what_changes() -> None:
    first, second, other = ephemeris("G01", 0), ephemeris("G01", 7200), ephemeris("E05", 600)
    choice = BroadcastChoice.of([second, first, other])
    assert choice.changed(START_S) == [other, first]
    assert choice.changed(START_S + 3599) == []
    assert choice.changed(START_S + 3600) == [second]
    assert choice.changed(START_S + 99_999) == []
    # A recording that goes back in time gets the older one again.
    assert choice.changed(START_S) == [first]


def test_of_two_for_one_time_the_later_sent_is_taken() -> None:
    old, new = ephemeris("G01", 0, sent_s=10), ephemeris("G01", 0, sent_s=20)
    assert BroadcastChoice.of([new, old]).changed(START_S) == [new]


def test_nothing_to_choose_from() -> None:
    assert BroadcastChoice.of([]).changed(START_S) == []


@given(
    toes=st.lists(st.integers(-WEEK_S, WEEK_S), min_size=1, max_size=8, unique=True),
    times=st.lists(st.integers(-WEEK_S, WEEK_S), min_size=1, max_size=20),
)
def test_the_nearest_is_held_at_every_time(toes: list[int], times: list[int]) -> None:
    choice = BroadcastChoice.of(ephemeris("G01", toe_s) for toe_s in toes)
    held: Ephemeris | None = None
    for time_s in times:
        changed = choice.changed(START_S + time_s)
        held = changed[0] if changed else held
        assert held is not None
        away_s = abs(held.gps_week * WEEK_S + held.toe_s - START_S - time_s)
        assert away_s == min(abs(toe_s - time_s) for toe_s in toes)
