"""Line files: both kinds read, and everything wrong named by file and spot."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.line.line_file import LineFileError, read_line

HEADER = "chainage_m,lat_deg,lon_deg,h_ell_m\n"
PLAIN = '{"id": "a", "name": "A", "axis": [[0, 0, 0], [0.1, 0, 0]], '


def test_a_polyline_has_its_own_kilometrage(tmp_path: Path) -> None:
    path = tmp_path / "main.csv"
    path.write_text(HEADER + "5000,0,0,10\n5110,0,0.001,10\n4990,0,0.001,10\n5100,0,0.002,10\n")
    line = read_line(path)
    assert line.id == "main"
    assert line.axis.length_m == pytest.approx(222.64, abs=0.01)
    assert float(line.chainage.at(0.0)) == 5000.0
    assert float(line.chainage.at(line.axis.axis_m[1])) == 4990.0
    assert float(line.chainage.at(line.axis.axis_m[1] - 1e-6)) == pytest.approx(5110.0, abs=1e-3)


def test_a_line_file_may_leave_the_kilometrage_out(tmp_path: Path) -> None:
    path = tmp_path / "line.json"
    path.write_text('{"id": "a", "name": "A", "axis": [[0, 0, 0], [0.001, 0, 0]], "stations": []}')
    line = read_line(path)
    assert float(line.chainage.at(50.0)) == 50.0
    path.write_text(
        '{"id": "a", "name": "A", "axis": [[0, 0, 0], [0.001, 0, 0]],'
        '"chainage": [{"axis_m": 0, "chainage_m": 7000}, {"axis_m": 100, "chainage_m": 6900}]}'
    )
    assert float(read_line(path).chainage.at(50.0)) == 6950.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no column chainage_m"),
        (HEADER, "needs two points"),
        (HEADER + "0,0,0,0\n1,0,x,0\n", r":3: lon_deg is 'x'"),
        (HEADER + "0,0,0,0\n1,0\n", r":3: lon_deg is ''"),
        (HEADER + "0,0,0,0\n1,99,0,0\n", r":3: latitude 99"),
        (HEADER + "0,0,0,0\n0,0,0.001,0\n", "stands still"),
        ("{", "Input data was truncated"),
        ('{"id": "a", "name": "A"}', "axis"),
        ('{"id": "a", "name": "A", "axis": [[0, 0, 0], [0, "n", 0]]}', r"\$\.axis\[1\]\[1\]"),
        ('{"id": "a", "name": "A", "axis": [[0, 0, 0], [0, 0, 0]]}', r"\$\.axis\[0\]: an axis needs"),
        (
            '{"id": "a", "name": "", "axis": [[0, 0, 0], [0.1, 0, 0]], "chainage": [{"axis_m": 0, "chainage_m": 1}]}',
            r"\$\.chainage\[0\]: a kilometrage needs",
        ),
        # Longitude and latitude exchanged.
        (
            '{"id": "a", "name": "A", "axis": [[35, 135, 0], [35, 136, 0]]}',
            r"a vertex is \[longitude, latitude, height\]",
        ),
        ('{"id": "a", "name": "A", "more": ' + "[" * 5000, "nested too deeply"),
        (
            PLAIN + '"curves": [{"start_axis_m": 1, "end_axis_m": 9, "radius_m": 5e-324}]}',
            r"\$\.curves\[0\]: no curve",
        ),
        (
            PLAIN
            + '"branches": [{"id": "b", "name": "", "leaves_axis_m": 0, "side": "left", "axis": [[0,0,0], [1,0,0]]}]}',
            r"\$\.branches\[0\]\.leaves_axis_m: a branch leaves beyond",
        ),
    ],
)
def test_what_is_no_line_is_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "line.csv"
    path.write_text(text)
    with pytest.raises(LineFileError, match=words) as raised:
        read_line(path)
    assert str(path) in str(raised.value)


def test_a_branch_that_leaves_towards_falling_axis_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "line.json"
    branch = '{"id": "b", "name": "B", "leaves_axis_m": 111, "side": "left", "axis": [[0.001, 0, 0], [%s, 0.0001, 0]]}'
    text = '{"id": "a", "name": "A", "axis": [[0, 0, 0], [0.002, 0, 0]], "branches": [%s]}'
    path.write_text(text % (branch % "0.002"))
    assert read_line(path).axis.length_m == pytest.approx(222.64, abs=0.01)
    path.write_text(text % (branch % "0.000"))
    with pytest.raises(LineFileError, match=r"\$\.branches\[0\]\.axis: the branch leaves towards falling axis_m"):
        read_line(path)


@pytest.mark.parametrize("folder", [False, True])
def test_what_lies_in_the_folder_does_not_hide_a_line_that_comes_with_kirotei(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    folder: bool,  # noqa: FBT001 - a case
) -> None:
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "demo"
    if folder:
        own.mkdir()
    else:
        own.write_text(HEADER + "0,0,0,0\n1,0,0.001,0\n")
    assert read_line(Path("demo")).axis.length_m > 20_000.0
    if not folder:
        assert read_line(own).axis.length_m < 200.0


def test_bytes_that_are_no_text_are_named(tmp_path: Path) -> None:
    path = tmp_path / "line.csv"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(LineFileError, match="not a text file"):
        read_line(path)
