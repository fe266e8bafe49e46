"""A band in which hardly anything is clean does not set its own threshold."""

from __future__ import annotations

import numpy as np
import pytest

from services.gnss_correction.threshold_tuning import Changes, bands_of, joined


def band(elevation_deg: float, judged: int, clean: int, change_m: float) -> Changes:
    """Changes of GPS satellites in one band, all of the same size, the first `clean` of them clean."""
    is_clean = np.zeros(judged)
    is_clean[:clean] = 1.0
    return Changes(np.zeros(judged, np.int64), np.full(judged, elevation_deg), np.full(judged, change_m), is_clean)


@pytest.mark.parametrize(("clean", "basis"), [(250, "band"), (240, "band"), (239, "constellation")])
def test_a_tenth_must_pass_for_clean(clean: int, basis: str) -> None:
    low, high = band(20.0, 2_400, clean, 3.0), band(70.0, 2_400, 2_400, 0.1)
    bands = {one.lowest_deg: one for one in bands_of(joined([low, high]), false_alarms=0.01, window_epochs=5)}
    assert bands[15.0].basis == basis
    # The whole constellation has the median of its high satellites; the quantile of equal changes is their size.
    expected_m = 3.0 if basis == "band" else 0.1 / 0.67449 * 2.5758
    assert bands[15.0].threshold_m == pytest.approx(expected_m, abs=1e-3)
    assert (bands[15.0].judged, bands[15.0].clean) == (2_400, clean)


def test_a_receiver_that_is_hardly_ever_clean_is_tuned_by_what_there_is() -> None:
    (only,) = [one for one in bands_of(band(20.0, 9_000, 300, 0.4), false_alarms=0.01, window_epochs=5) if one.judged]
    assert only.basis == "receiver"
    assert only.threshold_m == pytest.approx(0.4, abs=1e-3)
