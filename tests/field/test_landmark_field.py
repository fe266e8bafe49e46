"""Motion logs from elsewhere against the demo line: a train that runs on another line is never placed on this one."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from services.landmark_matching.log_run_file import read_run
from services.landmark_matching.run_matching import PlaceError, Start, match_run
from services.landmark_matching.settings import MatchSettings
from tests.unit.landmark_matching.demo_runs import demo_landmarks

FIELD = os.environ.get("KIROTEI_FIELD_DATA")
pytestmark = pytest.mark.skipif(not FIELD, reason="KIROTEI_FIELD_DATA names no folder of recorded runs")
LOGS = ("sim_a1", "sim_b1")


@pytest.mark.parametrize("name", LOGS)
def test_a_log_of_another_line_has_no_place_here(name: str) -> None:
    run = read_run(Path(FIELD or "") / "motion" / name, "paper")
    assert any(reading.curvature_per_m == reading.curvature_per_m for reading in run.readings)
    with pytest.raises(PlaceError):
        match_run(run.readings, demo_landmarks(), None, MatchSettings(), run.share)


@pytest.mark.parametrize("name", LOGS)
@pytest.mark.parametrize("axis_m", [250.0, 6100.0])
def test_a_log_of_another_line_matches_nothing_from_a_wrong_start(name: str, axis_m: float) -> None:
    run = read_run(Path(FIELD or "") / "motion" / name, "paper")
    found = match_run(run.readings, demo_landmarks(), Start("", "up", axis_m, 20.0), MatchSettings(), run.share)
    assert not [match for match in found.matches if match.accepted]
