"""Damaged observation files: the good epochs, and an issue that names the line; never a wrong figure."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from services.gnss_receiver.observations import Observations
from services.gnss_receiver.rinex_error import MAX_ISSUES, RinexError
from services.gnss_receiver.rinex_observations import parse_observations
from tests.unit.gnss_receiver.samples import (
    MANY,
    TYPES_3,
    epoch_2,
    epoch_3,
    expected,
    header_2,
    header_3,
    header_line,
    rows_of,
    text_of,
)

Build = tuple[list[str], Callable[..., list[str]]]
BOTH: dict[str, Build] = {"2": (header_2(), epoch_2), "3": (header_3(), epoch_3)}
both = pytest.mark.parametrize("build", BOTH.values(), ids=BOTH.keys())
two, three = pytest.mark.parametrize("build", [BOTH["2"]]), pytest.mark.parametrize("build", [BOTH["3"]])


def read(*parts: list[str]) -> Observations:
    return parse_observations(text_of(*parts), "a.rnx")


def complaints(observations: Observations) -> list[tuple[int, str]]:
    return [(issue.line, issue.text) for issue in observations.issues]


def line_of(*parts: list[str]) -> int:
    """Number of the line after these parts."""
    return sum(len(part) for part in parts) + 1


@both
def test_garbage_between_epochs(build: Build) -> None:
    header, epoch = build
    observations = read(header, epoch(0), ["??? the disk was full ???"], epoch(1))
    assert rows_of(observations) == expected(2)
    assert [line for line, _ in complaints(observations)] in ([line_of(header, epoch(0))], [line_of(header)])


@both
def test_garbage_before_the_first_epoch(build: Build) -> None:
    header, epoch = build
    observations = read(header, ["???", ""], epoch(0))
    assert rows_of(observations) == expected(1)
    assert complaints(observations) == [(line_of(header), "1 lines belong to no epoch; they are left out")]


@both
def test_blank_lines_between_epochs(build: Build) -> None:
    header, epoch = build
    observations = read(header, epoch(0), ["", "   "], epoch(1), [""])
    assert observations.issues == ()
    assert rows_of(observations) == expected(2)


@three
def test_rinex_3_with_too_many_announced(build: Build) -> None:
    header, epoch = build
    lines = epoch(0)
    lines[0] = lines[0].replace("  0  4", "  0  5")
    observations = read(header, lines, epoch(1))
    assert rows_of(observations) == expected(2)
    assert complaints(observations) == [
        (line_of(header), "the epoch announces 5 satellites, 4 lines follow; they are read")
    ]


@three
def test_rinex_3_with_too_few_announced(build: Build) -> None:
    header, epoch = build
    lines = epoch(0)
    lines[0] = lines[0].replace("  0  4", "  0  3")
    observations = read(header, lines, epoch(1))
    assert rows_of(observations) == {
        key: row for key, row in expected(2).items() if key[1] > 126641.8 or key[2] != "G19"
    }
    assert complaints(observations) == [
        (line_of(header), "the epoch announces 3 satellites, 4 lines follow; those that follow them are left out")
    ]


@two
@pytest.mark.parametrize("count", [3, 5, 13])
def test_rinex_2_with_a_wrong_count_is_left_out(build: Build, count: int) -> None:
    header, epoch = build
    lines = epoch(0)
    lines[0] = lines[0].replace("  0  4", f"  0{count:3d}")
    observations = read(header, lines, epoch(1))
    assert rows_of(observations) == {key: row for key, row in expected(2).items() if key[1] > 126641.8}
    ((line, text),) = complaints(observations)
    assert line == line_of(header)
    assert text.endswith("which line is whose is in doubt, the epoch is left out")


@two
def test_rinex_2_without_one_of_its_lines_is_left_out(build: Build) -> None:
    header, epoch = build
    for gone in range(1, 16):  # a second list line, then fourteen satellites
        lines = epoch(0, MANY)
        del lines[gone]
        observations = read(header, lines, epoch(1))
        assert rows_of(observations) == {key: row for key, row in expected(2).items() if key[1] > 126641.8}
        assert len(observations.issues) == 1


@two
def test_rinex_2_with_a_slipped_list_is_left_out(build: Build) -> None:
    header, epoch = build
    lines = epoch(0, MANY)
    lines[1] = "   " + lines[1]
    observations = read(header, lines, epoch(1))
    assert rows_of(observations) == {key: row for key, row in expected(2).items() if key[1] > 126641.8}
    ((line, text),) = complaints(observations)
    assert line == line_of(header)
    assert text.startswith("the list of satellites has a gap")


@both
def test_an_unreadable_epoch_header_loses_its_epoch_alone(build: Build) -> None:
    header, epoch = build
    broken = epoch(1)
    for bad in (
        broken[0].replace(" 11 10", " 11 70"),
        broken[0].replace("  0  4", "  9  4"),
        broken[0].replace(" 6  6", " 6 31").replace("06 06", "06 31"),
    ):
        observations = read(header, epoch(0), [bad, *broken[1:]], epoch(2))
        assert rows_of(observations) == {key: row for key, row in expected(3).items() if key[1] != 126642.0}
        ((line, text),) = complaints(observations)
        assert line == line_of(header, epoch(0))
        assert text.startswith("the epoch is left out, its header cannot be read")


@both
def test_a_lost_epoch_header_never_gives_its_lines_to_the_epoch_before(build: Build) -> None:
    header, epoch = build
    observations = read(header, epoch(0), epoch(1)[1:], epoch(2))
    assert observations.issues
    rows = rows_of(observations)
    assert rows.items() <= expected(3).items()
    assert rows.items() >= {key: row for key, row in expected(3).items() if key[1] == 126642.2}.items()


@both
def test_an_unknown_satellite_loses_its_line_alone(build: Build) -> None:
    header, epoch = build
    observations = read(header, epoch(0, ("G12", "X20", "E05", "G00")))
    assert rows_of(observations) == {key: row for key, row in expected(1).items() if key[2] in {"G12", "E05"}}
    assert [text for _, text in complaints(observations)] == [
        "'X20' is no satellite; its observations are left out",
        "'G00' is no satellite; its observations are left out",
    ]


@both
def test_a_satellite_named_twice_counts_once(build: Build) -> None:
    header, epoch = build
    observations = read(header, epoch(0, ("G12", "R20", "G12", "G19")))
    assert rows_of(observations) == {key: row for key, row in expected(1).items() if key[2] != "E05"}
    ((line, text),) = complaints(observations)
    assert line == line_of(header) + 3
    assert text == "G12 stands twice in this epoch; the first is taken"


def test_a_system_without_observables_is_reported_once() -> None:
    observations = read(header_3({"G": TYPES_3}), epoch_3(0), epoch_3(1))
    assert {key[2] for key in rows_of(observations)} == {"G12", "G19"}
    assert [text for _, text in complaints(observations)] == [
        "the header names no observables for system R; 2 lines of it are left out",
        "the header names no observables for system E; 2 lines of it are left out",
    ]


def test_a_wrong_count_of_observables_is_reported() -> None:
    header = header_3()
    header[1] = header[1].replace("G    4", "G    5")
    observations = read(header, epoch_3(0))
    assert rows_of(observations) == expected(1)
    assert complaints(observations) == [(2, "5 observables announced, 4 listed; the list is taken")]


def test_observables_without_their_first_line_are_not_guessed() -> None:
    types = tuple(f"{quantity}{signal}" for signal in ("1C", "1W", "2L", "5Q") for quantity in "CLSD")
    header = header_3({"G": types})
    del header[1]
    with pytest.raises(RinexError, match=r"a.rnx:4: the header names no observables"):
        read(header, epoch_3(0))
    wide = ("C1", "L1", "S1", "D1", "P1", "P2", "L2", "S2", "D2", "C5", "L5")
    header = header_2(wide)
    del header[1]
    with pytest.raises(RinexError, match=r"the header names no observables; it needs '# / TYPES OF OBSERV'"):
        read(header, epoch_2(0))
    change = [" " * 28 + "4  1", header_2(wide)[2]]
    observations = read(header_2(), epoch_2(0), change, epoch_2(1))
    assert rows_of(observations) == expected(1)
    assert [line for line, _ in complaints(observations)] == [line_of(header_2(), epoch_2(0)) + at for at in (1, 2)]


@both
def test_a_missing_time_of_first_observation_is_reported(build: Build) -> None:
    header, epoch = build
    short = [line for line in header if "TIME OF FIRST" not in line]
    observations = read(short, epoch(0))
    assert rows_of(observations) == expected(1)
    assert complaints(observations) == [(len(short), "'TIME OF FIRST OBS' is missing; GPS time is taken")]


@both
def test_another_file_in_the_middle_ends_the_reading(build: Build) -> None:
    header, epoch = build
    other_header, other = BOTH["3" if header == BOTH["2"][0] else "2"]
    observations = read(header, epoch(0), other_header, other(1))
    assert rows_of(observations) == expected(1)
    ((line, text),) = complaints(observations)
    assert line == line_of(header, epoch(0))
    assert text.startswith("another file of another kind starts here")


@both
def test_another_time_scale_in_the_middle_ends_the_reading(build: Build) -> None:
    header, epoch = build
    record = header_line("  2016     6     6    11    10   42.0000000     GLO", "TIME OF FIRST OBS")
    observations = read(header, epoch(0), [record], epoch(1))
    assert rows_of(observations) == expected(1)
    assert len(observations.issues) == 1


@both
def test_a_file_cut_anywhere_gives_what_was_whole(build: Build) -> None:
    header, epoch = build
    content = text_of(header, epoch(0), epoch(1))
    whole = expected(2)
    header_size, first_size = len(text_of(header)), len(text_of(header, epoch(0)))
    for size in range(header_size, len(content)):
        observations = parse_observations(content[:size], "cut.rnx")
        rows = rows_of(observations)
        for key, row in rows.items():
            assert all(value in (None, good) for value, good in zip(row, whole[key], strict=True)), size
        if size >= first_size:
            assert rows.items() >= expected(1).items()


def test_files_that_are_no_observation_files_say_so() -> None:
    navigation = header_line(f"{'3.04':>9}{'':11}N: GNSS NAV DATA", "RINEX VERSION / TYPE")
    future = header_line(f"{'4.00':>9}{'':11}OBSERVATION DATA    M", "RINEX VERSION / TYPE")
    system = header_line(f"{'3.04':>9}{'':11}OBSERVATION DATA    Q", "RINEX VERSION / TYPE")
    for content, text in (
        (b"", r"a.rnx:1: this is not RINEX: the first line must end in 'RINEX VERSION / TYPE'"),
        (b"\n\n\n", "a.rnx:1: this is not RINEX"),
        (b"\x00\xff" * 500, "a.rnx:1: this is not RINEX"),
        (b"{}", "a.rnx:1: this is not RINEX"),
        (text_of([navigation]), "a.rnx:1: this is no observation file but 'N: GNSS NAV DATA'; give it as navigation"),
        (text_of([future]), "a.rnx:1: RINEX version '4.00' is not read; convert the file to 2.11 or 3.04"),
        (text_of([system]), "a.rnx:1: satellite system 'Q' is none of"),
        (text_of(header_2()[:-1]), "a.rnx:3: the header does not end: 'END OF HEADER' is missing"),
    ):
        with pytest.raises(RinexError, match=text):
            parse_observations(content, "a.rnx")


@both
def test_a_header_alone_is_an_empty_recording(build: Build) -> None:
    observations = read(build[0])
    assert len(observations) == 0
    assert observations.issues == ()
    assert observations.first_row.tolist() == [0]


def test_complaints_are_bounded_and_counted() -> None:
    lines = [f"G{satellite:02d}  no number    " for satellite in range(1, 61)]
    epochs = [[f"> 2016 06 06 11 {minute:2d}  0.0000000  0 60", *lines] for minute in range(60)]
    observations = read(header_3(), *epochs, *epochs)
    assert len(observations.issues) == MAX_ISSUES + 1
    assert observations.issues[-1].text == f"and {2 * 60 * 60 - MAX_ISSUES} more issues like these"
