"""One broadcast, many ways: RTCM 3, subframes, pages and strings all give the same ephemeris."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from msgspec.structs import replace
from pyrtcm import RTCMMessage

from schemas.gnss import Ephemeris, Ionosphere, KeplerOrbit
from schemas.gnss_time import unix_ns_from_gps
from services.gnss_receiver.beidou_subframes import BeidouCollector
from services.gnss_receiver.broadcast_elements import full_week, reference_week, sisa_index, sisa_m, ura_index, ura_m
from services.gnss_receiver.glonass_strings import GlonassCollector
from services.gnss_receiver.inav_pages import InavCollector
from services.gnss_receiver.lnav_subframes import LnavCollector
from services.gnss_receiver.rtcm_ephemerides import GALILEO_F, read_ephemeris, write_ephemeris
from services.gnss_receiver.rtcm_messages import number_of, read_fields, write_fields
from tests.unit.gnss_receiver.broadcast_samples import (
    NEAR_NS,
    WEEK,
    beidou_subframes,
    glonass,
    glonass_strings,
    inav_pages,
    kepler,
    lnav_ionosphere,
    lnav_subframes,
)

NEAR_S = WEEK * 604_800 + 455_618.0
KEPLERS = ("G05", "J02", "E21", "C30")


def assert_same(ours: Ephemeris, wanted: Ephemeris, *, sent: bool) -> None:
    """Every figure equal but for the last bits, which pi times a figure may differ by."""
    for name in Ephemeris.__struct_fields__:
        a, b = getattr(ours, name), getattr(wanted, name)
        if name == "orbit":
            for part in a.__struct_fields__:
                assert getattr(a, part) == pytest.approx(getattr(b, part), rel=1e-14), part
        elif isinstance(a, float):
            assert a == pytest.approx(b, rel=1e-14), name
        elif name != "t_ns" or sent:
            assert a == b, name


@pytest.mark.parametrize("healthy", [True, False])
@pytest.mark.parametrize("satellite", KEPLERS)
def test_rtcm_holds_an_ephemeris(satellite: str, *, healthy: bool) -> None:
    wanted = kepler(satellite, healthy=healthy)
    message = write_ephemeris(wanted)
    assert_same(read_ephemeris(number_of(message), message, NEAR_NS), wanted, sent=True)


@pytest.mark.parametrize("healthy", [True, False])
def test_rtcm_holds_a_glonass_ephemeris(*, healthy: bool) -> None:
    wanted = glonass(healthy=healthy)
    message = write_ephemeris(wanted)
    assert number_of(message) == 1020
    assert_same(read_ephemeris(1020, message, NEAR_NS), wanted, sent=True)


def test_pyrtcm_reads_what_is_written() -> None:
    read = RTCMMessage(payload=write_ephemeris(kepler("G05")))
    assert (read.identity, read.DF009, read.DF076, read.DF071) == ("1019", 5, WEEK % 1024, 21)
    assert read.DF086 == -2222 / 32
    assert read.DF092 == 2_702_000_001 * 2.0**-19
    read = RTCMMessage(payload=write_ephemeris(glonass()))
    assert (read.DF038, read.DF040, read.DF110) == (9, 5, 37)


def test_fnav_comes_as_1045() -> None:
    values = read_fields(write_ephemeris(kepler("E21")))
    message = write_fields(GALILEO_F, values | {"DF291": 107, "DF312": 9 * 2.0**-32})
    ephemeris = read_ephemeris(GALILEO_F, message, NEAR_NS)
    assert ephemeris.group_delay_s == 9 * 2.0**-32
    assert ephemeris.healthy
    assert not read_ephemeris(GALILEO_F, write_fields(GALILEO_F, values | {"DF315": 1}), NEAR_NS).healthy


@pytest.mark.parametrize("satellite", KEPLERS)
def test_a_message_cut_short_is_refused(satellite: str) -> None:
    message = write_ephemeris(kepler(satellite))
    for length in range(2, len(message)):
        with pytest.raises(ValueError, match="fields need"):
            read_ephemeris(number_of(message), message[:length], NEAR_NS)


def test_what_no_message_holds_is_refused() -> None:
    with pytest.raises(ValueError, match="I03: RTCM 3 has no ephemeris of system I"):
        write_ephemeris(replace(kepler("G05"), satellite="I03"))
    with pytest.raises(ValueError, match=r"DF084 \(GPS af0.*does not fit into 22 bits"):
        write_ephemeris(replace(kepler("G05"), clock_bias_s=1.0))


@pytest.mark.parametrize("satellite", KEPLERS)
@pytest.mark.parametrize("away_s", [-3.4 * 86_400, 0.0, 3.4 * 86_400])
def test_the_week_comes_from_the_message_not_from_the_clock(satellite: str, away_s: float) -> None:
    # A host whose clock is days off still finds the right week.
    message = write_ephemeris(kepler(satellite))
    near_ns = NEAR_NS + round(away_s * 1e9)
    assert read_ephemeris(number_of(message), message, near_ns).gps_week == WEEK


@pytest.mark.parametrize("satellite", KEPLERS)
def test_the_first_ephemeris_of_a_week_is_sent_in_the_week_before(satellite: str) -> None:
    # 23:50 on Saturday: toe is 0:00 on Sunday, the week in the message may still be the old one.
    sunday = kepler(satellite, toe_s=0.0, week=WEEK + 1)
    near_ns = unix_ns_from_gps(WEEK, 604_200.0)
    message = write_ephemeris(sunday)
    field = {"G": "DF076", "J": "DF452", "E": "DF289", "C": "DF489"}[satellite[0]]
    values = read_fields(message)
    older = write_fields(number_of(message), values | {field: values[field] - 1})
    for one in (message, older):
        assert_same(read_ephemeris(number_of(one), one, near_ns), sunday, sent=True)


def test_weeks_turn_over() -> None:
    # GPS weeks 2048 - 1 and 2048 = 2 * 1024 (2019-04-06 and -07), and 3072.
    assert [full_week(1023, 1024, 2047), full_week(0, 1024, 2047), full_week(1023, 1024, 2048)] == [2047, 2048, 2047]
    assert full_week(0, 1024, 3071) == 3072
    assert reference_week(2047, 0.0, 2047 * 604_800 + 604_000.0) == 2048
    assert reference_week(2047, 600_000.0, 2047 * 604_800 + 604_000.0) == 2047
    rolled = kepler("G05", toe_s=604_784.0, week=2047)
    message = write_ephemeris(rolled)
    assert read_ephemeris(1019, message, unix_ns_from_gps(2048, 300.0)).gps_week == 2047


def test_accuracies_are_indices() -> None:
    assert [ura_index(ura_m(index)) for index in range(16)] == list(range(16))
    assert ura_index(None) == 15
    assert [sisa_index(sisa_m(index)) for index in range(126)] == list(range(126))
    assert (sisa_m(125), sisa_m(126), sisa_m(255)) == (6.0, -1.0, -1.0)
    assert (sisa_index(None), sisa_index(99.0)) == (255, 255)


@pytest.mark.parametrize("system", ["G", "J"])
def test_lnav_subframes_in_any_order_make_the_ephemeris(system: str) -> None:
    wanted = kepler(f"{system}05")
    frames = lnav_subframes(wanted)
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0)):
        collector = LnavCollector(system)
        found = [collector.add(5, frames[index], NEAR_S) for index in order]
        assert found[:2] == [None, None]
        assert isinstance(found[2], Ephemeris)
        assert_same(found[2], wanted, sent=False)
        assert found[2].t_ns == unix_ns_from_gps(WEEK, 75_936 * 6.0)


def test_lnav_subframes_of_two_issues_make_none() -> None:
    old = lnav_subframes(kepler("G05"))
    new = lnav_subframes(replace(kepler("G05"), issue=22))
    collector = LnavCollector("G")
    assert [collector.add(5, frame, NEAR_S) for frame in (old[0], old[1], new[2], new[1])] == [None] * 4
    found = collector.add(5, new[0], NEAR_S)
    assert isinstance(found, Ephemeris)
    assert found.issue == 22


def test_lnav_page_18_holds_the_ionosphere() -> None:
    found = LnavCollector("G").add(5, lnav_ionosphere((11, 2, -1, -2), (45, 4, -2, -6)), NEAR_S)
    assert isinstance(found, Ionosphere)
    assert found.alpha == (11 * 2.0**-30, 2 * 2.0**-27, -(2.0**-24), -2 * 2.0**-24)
    assert found.beta == (45 * 2.0**11, 4 * 2.0**14, -2 * 2.0**16, -6 * 2.0**16)
    assert found.t_ns == unix_ns_from_gps(WEEK, 75_939 * 6.0)


@pytest.mark.parametrize("healthy", [True, False])
def test_inav_pages_in_any_order_make_the_ephemeris(*, healthy: bool) -> None:
    wanted = kepler("E21", healthy=healthy)
    pages = inav_pages(wanted)
    for turn in range(5):
        collector = InavCollector()
        found = [collector.add(21, page, NEAR_S) for page in (*pages[turn:], *pages[:turn])]
        assert found[:4] == [None] * 4
        assert found[4] is not None
        assert_same(found[4], wanted, sent=False)
        # The same again says nothing new, another health does.
        assert collector.add(21, pages[0], NEAR_S) is None
        changed = collector.add(21, inav_pages(replace(wanted, healthy=not healthy))[4], NEAR_S)
        assert changed is not None
        assert changed.healthy is not healthy


def test_inav_parts_come_in_either_order_and_alert_pages_say_nothing() -> None:
    wanted = kepler("E21")
    collector = InavCollector()
    found = [collector.add(21, [*page[4:], *page[:4]], NEAR_S) for page in inav_pages(wanted)]
    assert found[4] is not None
    even_twice = inav_pages(wanted)[0]
    with pytest.raises(ValueError, match="do not belong together"):
        collector.add(21, [*even_twice[:4], *even_twice[:4]], NEAR_S)


@pytest.mark.parametrize("healthy", [True, False])
def test_beidou_subframes_make_the_ephemeris(*, healthy: bool) -> None:
    wanted = kepler("C30", healthy=healthy)
    collector = BeidouCollector()
    found = [collector.add(30, frame, NEAR_S) for frame in beidou_subframes(wanted)]
    assert found[:2] == [None, None]
    assert found[2] is not None
    assert_same(found[2], wanted, sent=False)


def test_beidou_subframes_of_two_frames_make_none() -> None:
    early, late = (beidou_subframes(kepler("C30"), sow_s) for sow_s in (455_400, 455_430))
    collector = BeidouCollector()
    assert [collector.add(30, frame, NEAR_S) for frame in (early[0], early[1], late[2], late[0])] == [None] * 4
    assert collector.add(30, late[1], NEAR_S) is not None


@pytest.mark.parametrize("healthy", [True, False])
def test_glonass_strings_make_the_ephemeris(*, healthy: bool) -> None:
    wanted = glonass(healthy=healthy)
    collector = GlonassCollector()
    found = [collector.add(9, -2, words, NEAR_S + 2.0 * index) for index, words in enumerate(glonass_strings(wanted))]
    assert found[:3] == [None] * 3
    assert found[3] is not None
    assert_same(found[3], wanted, sent=True)


def test_glonass_strings_of_two_frames_make_none() -> None:
    strings = glonass_strings(glonass())
    collector = GlonassCollector()
    times = (NEAR_S, NEAR_S + 32.0, NEAR_S + 34.0, NEAR_S + 36.0)
    assert [collector.add(9, -2, words, t_s) for words, t_s in zip(strings, times, strict=True)] == [None] * 4


Reader = Callable[[list[int]], object]
READERS: dict[str, tuple[Reader, list[int], int]] = {
    "lnav": (lambda words: LnavCollector("G").add(5, words, NEAR_S), lnav_subframes(kepler("G05"))[1], 30),
    "d1": (lambda words: BeidouCollector().add(30, words, NEAR_S), beidou_subframes(kepler("C30"))[1], 30),
    "strings": (lambda words: GlonassCollector().add(9, -2, words, NEAR_S), glonass_strings(glonass())[1], 32),
    "inav": (lambda words: InavCollector().add(21, words, NEAR_S), inav_pages(kepler("E21"))[0], 32),
}


UNUSED = {
    "lnav": set(),
    # Reserved bits of the first word have no check.
    "d1": {(0, bit) for bit in range(15, 19)},
    # Padding after a string of 85 bits, and after parts of 114 and 106 bits.
    "strings": {(2, bit) for bit in range(11)} | {(3, bit) for bit in range(32)},
    "inav": {(3, bit) for bit in range(14)} | {(7, bit) for bit in range(22)},
}


@pytest.mark.parametrize("kind", READERS)
def test_every_flipped_bit_is_noticed(kind: str) -> None:
    read, words, width = READERS[kind]
    read(words)
    for index, bit in ((index, bit) for index in range(len(words)) for bit in range(width)):
        if (index, bit) in UNUSED[kind]:
            continue
        flipped = [*words]
        flipped[index] ^= 1 << bit
        with pytest.raises(ValueError, match=r"check|parity|belong"):
            read(flipped)


def test_figures_that_cannot_be_are_refused() -> None:
    sick = kepler("G05")
    assert isinstance(sick.orbit, KeplerOrbit)
    flat = replace(sick, orbit=replace(sick.orbit, sqrt_a=1.0))
    collector = LnavCollector("G")
    with pytest.raises(ValueError, match="no orbit has"):
        _ = [collector.add(5, frame, NEAR_S) for frame in lnav_subframes(flat)]
    with pytest.raises(ValueError, match="no orbit has"):
        read_ephemeris(1019, write_ephemeris(flat), NEAR_NS)


def test_angles_beyond_a_turn_are_the_same_angles() -> None:
    wanted = kepler("G05")
    assert isinstance(wanted.orbit, KeplerOrbit)
    turned = replace(wanted, orbit=replace(wanted.orbit, omega0_rad=wanted.orbit.omega0_rad + 2.0 * math.pi))
    assert write_ephemeris(turned) == write_ephemeris(wanted)
