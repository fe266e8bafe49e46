"""Models folded to fit into a message: nothing lost, new normals kept apart, weights hardly changed."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import msgspec
import pytest

from schemas.radio import RadioAcceptance
from services.cloud_analyzer.model_folding import fitting, folded
from services.cloud_analyzer.model_rows import packed_model
from services.radio_anomaly.file_analysis import learn
from services.radio_anomaly.radio_model import monitor_of
from services.radio_anomaly.radio_model_file import read_model
from services.radio_anomaly.settings import Settings
from tests.unit.radio_anomaly.made_up import BEGIN_NS, DAY_NS, one_pass

MODEL = learn((one for n in range(32) for one in one_pass(n)), Settings(), "line", "", Counter())


def test_sums_of_days_add_up_and_predict_what_they_did() -> None:
    weekly = folded(MODEL, 8)
    assert len(weekly.sums) < len(MODEL.sums) / 3
    for name in ("n", "sum", "sum_squares"):
        whole = sum(getattr(one, name) for one in MODEL.sums)
        assert sum(getattr(one, name) for one in weekly.sums) == pytest.approx(whole, rel=1e-12)
    before, after = (
        monitor_of(one).streams[("W1", "ch1")].baseline("power", 120.0, None).predict("up", 7, "")
        for one in (MODEL, weekly)
    )
    # A week against a half-life of 120 days: weights change by 4 %, and with them means by a part of their spread.
    assert after.mean == pytest.approx(before.mean, abs=0.1)
    assert after.variance == pytest.approx(before.variance, rel=0.05)


def test_days_before_and_after_a_new_normal_stay_apart() -> None:
    word = RadioAcceptance(
        t_ns=0,
        acceptance_id="a",
        radio="W1",
        section_start_m=0.0,
        section_end_m=500.0,
        since_ns=BEGIN_NS + 5 * DAY_NS,
        by="Sato",
    )
    accepted = msgspec.structs.replace(MODEL, acceptances=(word,))
    days = {one.day for one in folded(accepted, 64).sums}
    assert min(days) <= "2026-01-09"
    assert {day >= "2026-01-10" for day in days} == {True, False}


def test_a_model_is_folded_until_it_fits_and_read_as_a_file(tmp_path: Path) -> None:
    whole = packed_model(MODEL)
    assert fitting(MODEL, len(whole)) == (whole, 1)
    packed, width_days = fitting(MODEL, len(whole) // 2)
    assert len(packed) <= len(whole) // 2
    assert width_days > 1
    (tmp_path / "current").write_bytes(packed)
    assert read_model(tmp_path / "current") == folded(MODEL, width_days)
    with pytest.raises(ValueError, match="more than a message carries"):
        fitting(MODEL, 100)
