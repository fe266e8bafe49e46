"""landmarks.json and matches.csv: round trips, and what a bad file says."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from schemas.line import LandmarkDatabase
from services.landmark_matching.landmarks_file import LandmarksFileError, read_landmarks, write_landmarks
from services.landmark_matching.matcher import Match
from services.landmark_matching.matches_file import COLUMNS, write_matches
from tests.unit.landmark_matching.test_curve_shape import TABLE_1

DATABASE = LandmarkDatabase(version="v1", line="demo", line_version="2026-1", origin="by hand", landmarks=(TABLE_1,))


def test_a_database_comes_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "landmarks.json"
    write_landmarks(path, DATABASE)
    assert read_landmarks(path) == DATABASE
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"landmarks": [{"id": "C1"}]}, r"direction.*\$\.landmarks\[0\]"),
        ({"landmarks": ["twice"]}, "id 'C1' occurs twice"),
        ({"landmarks": ["backwards"]}, r"\$\.landmarks\[0\]: landmark C1: its places are not in the order"),
        ({"landmarks": ["misspelt"]}, r"\$\.landmarks\[0\]: landmarks have no field 'acuracy_m'"),
        ({"landmarks": []}, "it holds no landmarks"),
        ({"line_version": 3}, "Expected `str`"),
    ],
)
def test_a_bad_database_is_refused_by_place(tmp_path: Path, change: dict[str, object], words: str) -> None:
    row = msgspec.to_builtins(TABLE_1)
    if change.get("landmarks") == ["twice"]:
        change = {"landmarks": [row, row]}
    if change.get("landmarks") == ["backwards"]:
        change = {"landmarks": [row | {"direction": "down"}]}
    if change.get("landmarks") == ["misspelt"]:
        change = {"landmarks": [row | {"acuracy_m": 30.0}]}
    path = tmp_path / "landmarks.json"
    path.write_bytes(msgspec.json.encode(msgspec.to_builtins(DATABASE) | change))
    with pytest.raises(LandmarksFileError, match=words):
        read_landmarks(path)


@pytest.mark.parametrize("text", [b"\xff\x00{", b'{"origin":' + b"[" * 100_000])
def test_bytes_that_are_no_json_are_refused_by_name(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "landmarks.json"
    path.write_bytes(text)
    with pytest.raises(LandmarksFileError, match=r"landmarks\.json"):
        read_landmarks(path)


def test_matches_are_rows_with_the_front_end_s_place(tmp_path: Path) -> None:
    path = tmp_path / "matches.csv"
    refused = Match(
        landmark=TABLE_1,
        accepted=False,
        kind="slip",
        reason="slip in the curve",
        t_s=20.0,
        distance_m=500.0,
        axis_m=960.0,
        correction_m=0.0,
        bound_m=0.0,
    )
    accepted = replace(refused, accepted=True, t_s=12.3456, axis_m=953.0, correction_m=-3.25, bound_m=11.5)
    write_matches(path, [accepted, refused], 8.0)
    rows = list(csv.DictReader(path.read_text("utf-8").splitlines()))
    assert tuple(rows[0]) == COLUMNS
    assert [rows[0][name] for name in ("t_s", "accepted", "correction_m", "axis_m", "bound_m")] == [
        "12.346",
        "1",
        "-3.250",
        "961.000",
        "11.500",
    ]
    assert (rows[1]["accepted"], rows[1]["reason"], rows[1]["bound_m"]) == ("0", "slip in the curve", "")
