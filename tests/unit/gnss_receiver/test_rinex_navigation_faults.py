"""Damaged navigation files: what cannot be meant is left out and named; what is good stays."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.rinex_error import RinexError
from services.gnss_receiver.rinex_navigation import parse_navigation
from tests.unit.gnss_receiver.navigation_samples import (
    EXPECTED_GPS,
    GLONASS,
    GPS,
    MIDNIGHT,
    Figures,
    changed,
    header_3,
    record_3,
)
from tests.unit.gnss_receiver.samples import header_line, text_of


def read(*parts: list[str]) -> Navigation:
    return parse_navigation([("a.nav", text_of(*parts))])


def complaint(*parts: list[str]) -> str:
    navigation = read(*parts)
    assert navigation.ephemerides == ()
    (issue,) = navigation.issues
    return str(issue)


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        (changed(GPS, 2, 3, 0.0), "no orbit has sqrt(A) 0.0 and eccentricity 0.00553706113715"),
        (changed(GPS, 2, 1, 0.9), "no orbit has sqrt(A) 5153.64817619 and eccentricity 0.9"),
        (changed(GPS, 2, 1, None), "eccentricity is missing"),
        (changed(GPS, 0, 0, None), "clock bias is missing"),
        (changed(GPS, 3, 0, 300_000.0), "its toe lies 59.3 h from its epoch"),
        (changed(GPS, 5, 2, 1850.0), "week 1850 does not fit its epoch, which lies in GPS week 1900"),
    ],
)
def test_ephemerides_that_cannot_be_are_refused(figures: Figures, words: str) -> None:
    expected = f"a.nav:3: the record of G01 is left out: {words}"
    assert complaint(header_3(), record_3("G01", MIDNIGHT, figures)) == expected


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        (changed(GLONASS, 1, 0, 0.0), "no GLONASS orbit has a radius of 24895 km"),
        (changed(GLONASS, 2, 3, 20.0), "GLONASS has no frequency channel 20"),
        (changed(GLONASS, 3, 1, None), "velocity z is missing"),
    ],
)
def test_glonass_states_that_cannot_be_are_refused(figures: Figures, words: str) -> None:
    figures = changed(figures, 3, 0, 6000.0) if "radius" in words else figures
    expected = f"a.nav:3: the record of R02 is left out: {words}"
    if "radius" in words:
        expected = "a.nav:3: the record of R02 is left out: no GLONASS orbit has a radius of 12971 km"
    assert complaint(header_3(), record_3("R02", MIDNIGHT, figures)) == expected


@pytest.mark.parametrize(
    "calendar",
    ["2016 06 31 00 00 00", "2016 13 06 00 00 00", "2016 06 06 24 00 00", "1916 06 06 00 00 00", "2016 06 06 xx 00 00"],
)
def test_epochs_that_are_none_are_refused(calendar: str) -> None:
    assert complaint(header_3(), record_3("G01", calendar, GPS)).startswith("a.nav:3: the record of ")


def test_damaged_records_lose_themselves_alone() -> None:
    good, bad = record_3("G01", MIDNIGHT, GPS), record_3("G02", MIDNIGHT, GPS)
    cut = "a.nav:3: the record of 'G02' is left out: it has 5 lines, not 8"
    for damaged, words in (
        (bad[:5], cut),
        (
            [bad[0].replace("2.27", "2.2x"), *bad[1:]],
            "a.nav:3: the record of 'G02' is left out: '2.2x0098775620E-05' is no number",
        ),
        (["garbage", *bad[1:]], "a.nav:3: this and what follows belong to no record; they are left out: 'garbage'"),
        (bad[1:], f"a.nav:3: this and what follows belong to no record; they are left out: {bad[1][:30]!r}"),
    ):
        navigation = read(header_3(), damaged, good)
        assert navigation.ephemerides == (EXPECTED_GPS,)
        assert [str(issue) for issue in navigation.issues] == [words]
    between = read(header_3(), good, ["garbage"], bad[1:])
    assert between.ephemerides == (EXPECTED_GPS,)
    assert len(between.issues) == 1
    # Without its first line a record cannot be told from a line too many in the one before.
    assert complaint(header_3(), good, bad[1:]) == "a.nav:3: the record of 'G01' is left out: it has 15 lines, not 8"


def test_comments_blank_lines_and_further_headers_are_passed_over() -> None:
    good = record_3("G01", MIDNIGHT, GPS)
    comment = [header_line("merged", "COMMENT"), ""]
    navigation = read(header_3(), comment, good[:3], comment, good[3:], header_3(), record_3("G01", MIDNIGHT, GPS))
    assert navigation.issues == ()
    assert navigation.ephemerides == (EXPECTED_GPS,)


def test_files_that_are_no_navigation_files_say_so() -> None:
    observation = header_line(f"{'3.04':>9}{'':11}OBSERVATION DATA    M", "RINEX VERSION / TYPE")
    future = header_line(f"{'4.00':>9}{'':11}NAVIGATION DATA     M", "RINEX VERSION / TYPE")
    for content, text in (
        (b"", "a.nav:1: this is not RINEX"),
        (b"\x00" * 100, "a.nav:1: this is not RINEX"),
        (text_of([observation]), "a.nav:1: this is no navigation file that is read but 'OBSERVATION DATA'"),
        (text_of([future]), "a.nav:1: RINEX version '4.00' is not read; convert the file to 3.04"),
        (text_of(header_3()[:-1]), "a.nav:1: the header does not end"),
    ):
        with pytest.raises(RinexError, match=text):
            parse_navigation([("a.nav", content)])


Damage = Callable[[list[bytes], random.Random], list[bytes]]


def _line_lost(lines: list[bytes], generator: random.Random) -> list[bytes]:
    at = generator.randrange(2, len(lines))
    return lines[:at] + lines[at + 1 :]


def _line_twice(lines: list[bytes], generator: random.Random) -> list[bytes]:
    at = generator.randrange(2, len(lines))
    return [*lines[: at + 1], *lines[at:]]


def _garbage(lines: list[bytes], generator: random.Random) -> list[bytes]:
    at = generator.randrange(2, len(lines))
    return [*lines[:at], bytes(generator.choices(b"\x00\xffx?* G", k=generator.randint(0, 90))), *lines[at:]]


def _overwritten(lines: list[bytes], generator: random.Random) -> list[bytes]:
    at = generator.randrange(len(lines))
    start = generator.randrange(len(lines[at]) + 1)
    bad = bytes(generator.choices(range(256), k=generator.randint(1, 30)))
    return [*lines[:at], lines[at][:start] + bad + lines[at][start + len(bad) :], *lines[at + 1 :]]


@settings(max_examples=300)
@given(damage=st.sampled_from((_line_lost, _line_twice, _garbage, _overwritten)), seed=st.integers(0, 10**6))
def test_no_damage_ends_the_reader(damage: Damage, seed: int) -> None:
    content = text_of(header_3(), record_3("G01", MIDNIGHT, GPS), record_3("R02", MIDNIGHT, GLONASS)).splitlines()
    damaged = damage(content, random.Random(seed))  # noqa: S311 - damage is no secret
    try:
        navigation = parse_navigation([("a.nav", b"\n".join(damaged))])
    except RinexError:
        return
    if damage in (_line_lost, _line_twice, _garbage):
        whole = parse_navigation([("a.nav", b"\n".join(content))])
        assert set(map(repr, navigation.ephemerides)) <= set(map(repr, whole.ephemerides))
        assert damage is _garbage or navigation.issues
