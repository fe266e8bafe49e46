"""The check of line files: every fault is named by its field, all of them at once, and sound files have none."""

from __future__ import annotations

from collections.abc import Callable
from datetime import date

import msgspec
import pytest

from schemas.line import ChainagePoint, Curve, Gradient, Line, SpeedLimit
from services.line.built_in_file import built_in_line
from services.line.line_check import problems_of
from services.line.validity import line_validity

DEMO = built_in_line("demo")
replace = msgspec.structs.replace


def with_one(name: str, number: int, **fields: object) -> Line:
    """The demo line with one entry of a list changed."""
    entries = list(getattr(DEMO, name))
    entries[number] = replace(entries[number], **fields)
    return replace(DEMO, **{name: tuple(entries)})


def with_branch(**fields: object) -> Line:
    return replace(DEMO, branches=(replace(DEMO.branches[0], **fields),))


FAULTS: dict[str, tuple[Callable[[], Line], str, str]] = {
    "overlapping curves": (
        lambda: with_one("curves", 3, end_axis_m=DEMO.curves[4].start_axis_m + 30.0),
        "$.curves[4].start_axis_m",
        "before the curve ahead of it ends",
    ),
    "curves out of order": (
        lambda: replace(DEMO, curves=(DEMO.curves[1], DEMO.curves[0], *DEMO.curves[2:])),
        "$.curves[1].start_axis_m",
        "put the curves in order",
    ),
    "radius contradicts the axis": (
        lambda: with_one("curves", 2, radius_m=250.0),
        "$.curves[2].radius_m",
        "500 m would fit",
    ),
    "hand contradicts the axis": (lambda: with_one("curves", 1, radius_m=400.0), "$.curves[1].radius_m", "sign"),
    "no radius": (lambda: with_one("curves", 1, radius_m=0.0), "$.curves[1].radius_m", "no radius"),
    "transitions longer than the curve": (
        lambda: with_one("curves", 0, transition_in_m=100.0),
        "$.curves[0].transition_in_m",
        "not of the arc",
    ),
    "curve backwards": (
        lambda: with_one("curves", 0, start_axis_m=900.0, end_axis_m=800.0),
        "$.curves[0].end_axis_m",
        "exchange start and end",
    ),
    "gradient contradicts heights": (
        lambda: with_one("gradients", 4, permille=-33.0),
        "$.gradients[4].permille",
        "uphill",
    ),
    "gradients out of order": (
        lambda: with_one("gradients", 4, axis_m=1000.0),
        "$.gradients[4].axis_m",
        "in order",
    ),
    "station beyond the end": (
        lambda: with_one("stations", 7, axis_m=29_800.0),
        "$.stations[7].axis_m",
        "not kilometrage",
    ),
    "stations out of order": (
        lambda: with_one("stations", 2, axis_m=2000.0),
        "$.stations[2].axis_m",
        "comes after matsuo",
    ),
    "station twice": (lambda: with_one("stations", 2, id="matsuo"), "$.stations[2].id", "$.stations[1]"),
    "balise off the line": (lambda: with_one("balises", 7, axis_m=26_000.0), "$.balises[7].axis_m", "the line runs"),
    "limit without a length": (
        lambda: replace(DEMO, speed_limits=(SpeedLimit(start_axis_m=500.0, end_axis_m=500.0, limit_mps=10.0),)),
        "$.speed_limits[0].end_axis_m",
        "not beyond its start",
    ),
    "unknown branch": (lambda: with_one("landmarks", 0, branch="akaiva"), "$.landmarks[0].branch", "akaiwa"),
    "landmark rows in the other direction": (
        lambda: with_one("landmarks", 0, direction="down"),
        "$.landmarks[0].entry_straight_end_m",
        "as the train passes them",
    ),
    "landmark of the other hand": (lambda: with_one("landmarks", 0, hand="right"), "$.landmarks[0].hand", "other hand"),
    "landmark of another radius": (
        lambda: with_one("landmarks", 0, radius_m=450.0),
        "$.landmarks[0].radius_m",
        "300 m",
    ),
    "landmark beyond the end": (
        lambda: with_one("landmarks", 24, exit_straight_end_m=30_000.0),
        "$.landmarks[24].exit_straight_end_m",
        "beyond the end",
    ),
    "chainage out of order": (
        lambda: with_one("chainage", 1, axis_m=12_000.0),
        "$.chainage[2]",
        "rising order",
    ),
    "chainage standing still": (
        lambda: replace(
            DEMO, chainage=(ChainagePoint(axis_m=0.0, chainage_m=5.0), ChainagePoint(axis_m=9.0, chainage_m=5.0))
        ),
        "$.chainage[1]",
        "stands still",
    ),
    "chainage beyond all railways": (
        lambda: with_one("chainage", 1, chainage_m=1e300),
        "$.chainage[1]",
        "is none",
    ),
    "branch that leaves before the line begins": (
        lambda: with_branch(leaves_axis_m=0.0),
        "$.branches[0].leaves_axis_m",
        "begin before it",
    ),
    "axis with a wild vertex": (
        lambda: replace(DEMO, axis=(*DEMO.axis[:50], (133.9, 34.99, 0.0), *DEMO.axis[50:])),
        "$.axis[50]",
        "at this vertex",
    ),
    "axis with a vertex beyond the sea": (
        lambda: replace(DEMO, axis=(*DEMO.axis[:50], (0.0, 0.0, 0.0), *DEMO.axis[50:])),
        "$.axis[50]",
        "km from the vertex before",
    ),
    "branch of another place": (
        lambda: with_branch(leaves_axis_m=12_000.0),
        "$.branches[0].axis[0]",
        "begin on the main line",
    ),
    "branch beyond the end": (
        lambda: with_branch(leaves_axis_m=40_000.0),
        "$.branches[0].leaves_axis_m",
        "beyond the end",
    ),
    "branch backwards": (
        lambda: with_branch(axis=tuple(reversed(DEMO.axis[:1700]))[100:], curves=(), stations=()),
        "$.branches[0].axis",
        "towards rising axis_m",
    ),
    "a day that no calendar has": (lambda: replace(DEMO, valid_from="2026-02-30"), "$.valid_from", "YYYY-MM-DD"),
    "days exchanged": (lambda: replace(DEMO, valid_until="2019-12-31"), "$.valid_until", "exchange"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_by_its_field_and_what_to_do(name: str) -> None:
    make, field, words = FAULTS[name]
    problems = problems_of(make())
    found = [one for one in problems if one.field == field]
    assert found, [one.field for one in problems]
    assert found[0].severity == "error"
    assert words in f"{found[0].text}; {found[0].advice}"


def test_all_faults_are_listed_at_once_errors_first() -> None:
    faulty = replace(
        with_one("curves", 2, radius_m=250.0),
        stations=(DEMO.stations[1], DEMO.stations[0]),
        valid_from="2026-13-01",
        version="",
        track_circuits=(DEMO.track_circuits[0], replace(DEMO.track_circuits[1], start_axis_m=100.0)),
    )
    problems = problems_of(faulty)
    assert {one.field for one in problems} >= {
        "$.curves[2].radius_m",
        "$.stations[1].axis_m",
        "$.valid_from",
        "$.version",
        "$.track_circuits",
    }
    severities = [one.severity for one in problems]
    assert severities == sorted(severities)


@pytest.mark.parametrize(
    ("line", "field", "words"),
    [
        (replace(DEMO, curves=DEMO.curves[1:]), "$.curves", "without a listed curve"),
        (
            replace(
                DEMO,
                chainage=tuple(ChainagePoint(axis_m=1000.0 * k, chainage_m=one) for k, one in enumerate((0, 1000, 0))),
                branches=(),
            ),
            "$.chainage[2].chainage_m",
            "falls from 1000 on",
        ),
        (
            replace(DEMO, axis=tuple((x, y, 0.0) for x, y, _ in DEMO.axis), branches=()),
            "$.axis",
            "heights are the same",
        ),
        (with_one("chainage", 1, chainage_m=11_000.0), "$.chainage[1].chainage_m", "broken chain is two rows"),
        (
            with_one("landmarks", 0, exit_lower_limit_m=702.0, entry_lower_limit_m=701.0),
            "$.landmarks[0].hand",
            "straight",
        ),
    ],
)
def test_what_looks_odd_is_said(line: Line, field: str, words: str) -> None:
    found = [one for one in problems_of(line) if one.field == field]
    assert found
    assert words in f"{found[0].text}; {found[0].advice}"


def test_coarse_vertices_contradict_nothing() -> None:
    coarse = replace(DEMO, axis=(*DEMO.axis[::5], DEMO.axis[-1]), branches=(), landmarks=())
    # 25 m between vertices in curves: the axis is 5 m shorter than places say.
    assert [one for one in problems_of(coarse) if ".curves[" in one.field and "radius" in one.field] == []


def test_a_line_of_nothing_but_an_axis_is_sound() -> None:
    assert problems_of(Line(id="a", name="a", axis=((134.0, 35.0, 0.0), (134.005, 35.0, 0.0)))) == ()


def test_stretches_end_with_the_line_in_whole_millimetres() -> None:
    odd = replace(DEMO, gradients=(*DEMO.gradients, Gradient(axis_m=25_652.9, permille=0.0)))
    assert problems_of(odd) == ()


def test_a_curve_beyond_the_end_is_one_problem_not_a_crash() -> None:
    wild = Curve(start_axis_m=90_000.0, end_axis_m=90_500.0, radius_m=300.0)
    fields = {one.field for one in problems_of(replace(DEMO, curves=(*DEMO.curves, wild)))}
    assert f"$.curves[{len(DEMO.curves)}].start_axis_m" in fields


def test_a_line_is_valid_from_its_first_to_its_last_day() -> None:
    line = replace(DEMO, valid_from="2026-01-01", valid_until="2026-06-30")
    assert line_validity(line, date(2026, 1, 1)).usable
    assert line_validity(line, date(2026, 6, 30)).usable
    early, late = line_validity(line, date(2025, 12, 31)), line_validity(line, date(2026, 7, 1))
    assert not early.usable
    assert "from 2026-01-01" in early.reason
    assert not late.usable
    assert "until 2026-06-30" in late.reason
    assert line_validity(replace(DEMO, valid_from=None), date(1999, 1, 1)).usable
