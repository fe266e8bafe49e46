"""The axes of the Stanford diagram: room for every region, however good or bad a method is."""

from __future__ import annotations

import numpy as np
import pytest

from services.gnss_correction.integrity import BoundedErrors
from services.gnss_correction.stanford_plot import draw_stanford

LIMIT_M = 50.0


def track(error_m: list[float], bound_m: list[float]) -> BoundedErrors:
    return BoundedErrors("method", len(error_m), np.array(error_m), np.array(bound_m))


@pytest.mark.parametrize(
    ("error_m", "bound_m", "top_m"),
    [
        # Small figures: 1.6 alert limits; 1.15 as room.
        ([1.0, 2.0], [5.0, 9.0], 1.15 * 1.6 * LIMIT_M),
        # A bound that spans the whole line does not stretch them beyond four alert limits.
        ([1.0, 2.0], [5.0, 1500.0], 1.15 * 4.0 * LIMIT_M),
        # Errors do: what is misleading must be seen where it is.
        ([400.0, 400.0], [5.0, 9.0], 1.15 * 400.0),
    ],
)
def test_the_scale_follows_errors_and_the_alert_limit(error_m: list[float], bound_m: list[float], top_m: float) -> None:
    panel = draw_stanford([track(error_m, bound_m)], LIMIT_M).axes[0]
    assert panel.get_xlim() == pytest.approx((0.0, top_m))
    assert panel.get_ylim() == pytest.approx((0.0, top_m))


def test_bounds_beyond_the_axes_are_drawn_at_their_end() -> None:
    panel = draw_stanford([track([1.0, 2.0, 3.0], [5.0, 1500.0, 2500.0])], LIMIT_M).axes[0]
    (mesh,) = panel.collections
    drawn = mesh.get_array()
    assert drawn is not None
    counts = np.ma.filled(drawn, 0.0)
    assert counts.sum() == 3.0
    assert counts[-1].sum() == 2.0
