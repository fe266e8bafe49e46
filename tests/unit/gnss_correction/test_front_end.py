"""One front end from several antennas."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.gnss import Fix, FixStatus, FrontEnd
from services.gnss_correction.front_end import Antenna, FrontEndFinder

ANTENNAS = {"front": Antenna(behind_front_m=5.0), "rear": Antenna(behind_front_m=105.0)}
METRES_PER_DEGREE = 111_319.5


def fix(
    t_s: float,
    chainage_m: float | None,
    bound_m: float | None = 10.0,
    speed_mps: float | None = 0.0,
    status: FixStatus = "fix",
    east_m: float = 0.0,
) -> Fix:
    return Fix(
        t_ns=round(t_s * 1e9),
        gps_week=2400,
        tow_s=t_s,
        method="line",
        status=status,
        lat_deg=0.0,
        lon_deg=east_m / METRES_PER_DEGREE,
        h_m=0.0,
        ve_mps=0.0,
        vn_mps=0.0,
        satellites_used=8,
        satellites_flagged=0,
        bound_m=bound_m,
        chainage_m=chainage_m,
        chainage_bound_m=None if chainage_m is None else bound_m,
        speed_along_mps=speed_mps,
    )


def both(finder: FrontEndFinder, front: Fix, rear: Fix) -> FrontEnd:
    finder.take("rear", rear)
    found = finder.take("front", front)
    assert found is not None
    return found


@given(st.floats(0.0, 5000.0), st.sampled_from([1.0, -1.0]), st.floats(0.5, 40.0), st.floats(0.5, 40.0))
def test_two_antennas_tell_the_front_end_and_its_direction(
    front_end_m: float, sign: float, front_bound_m: float, rear_bound_m: float
) -> None:
    found = both(
        FrontEndFinder(ANTENNAS),
        fix(1.0, front_end_m - sign * 5.0, front_bound_m),
        fix(1.0, front_end_m - sign * 105.0, rear_bound_m),
    )
    assert (found.agreement, found.facing) == ("agree", "up" if sign > 0.0 else "down")
    assert found.chainage_m == pytest.approx(front_end_m, abs=1e-6)
    # The better antenna's bound, not a smaller one: their errors may be the same.
    assert found.chainage_bound_m == min(front_bound_m, rear_bound_m)


def test_antennas_that_contradict_each_other_are_both_covered() -> None:
    finder = FrontEndFinder(ANTENNAS)
    both(finder, fix(1.0, 995.0), fix(1.0, 895.0))
    found = both(finder, fix(1.2, 995.0), fix(1.2, 935.0))
    assert found.agreement == "disagree"
    assert found.difference_m == pytest.approx(40.0)
    assert found.allowed_m == pytest.approx(20.0)
    assert "60.0 m apart, 100.0 m on the train" in found.reason
    assert found.chainage_m is not None
    assert found.chainage_bound_m is not None
    for claim_m in (995.0 + 5.0, 935.0 + 105.0):
        assert abs(claim_m - found.chainage_m) + 10.0 <= found.chainage_bound_m + 1e-9


def test_while_the_bounds_leave_the_direction_open_no_front_end_is_given() -> None:
    found = both(FrontEndFinder(ANTENNAS), fix(1.0, 995.0, 60.0), fix(1.0, 895.0, 60.0))
    assert (found.agreement, found.chainage_m, found.facing) == ("agree", None, None)
    assert "direction of the front is not known" in found.reason


def test_a_direction_once_found_stays() -> None:
    finder = FrontEndFinder(ANTENNAS)
    both(finder, fix(1.0, 995.0), fix(1.0, 895.0))
    found = both(finder, fix(1.2, 996.0, 60.0), fix(1.2, 896.0, 60.0))
    assert found.chainage_m == pytest.approx(1001.0)


def test_one_antenna_needs_the_configured_direction() -> None:
    alone = FrontEndFinder(ANTENNAS).take("front", fix(1.0, 500.0))
    told = FrontEndFinder(ANTENNAS, "down").take("front", fix(1.0, 500.0))
    assert alone is not None
    assert told is not None
    assert (alone.agreement, alone.chainage_m) == ("unknown", None)
    assert (told.chainage_m, told.chainage_bound_m) == (495.0, 10.0)


def test_an_older_fix_is_moved_on_by_its_speed_and_trusted_less() -> None:
    finder = FrontEndFinder(ANTENNAS, "up")
    finder.take("rear", fix(1.0, 895.0, 1.0, 20.0))
    found = finder.take("front", fix(1.5, 1005.0, 1.0, 20.0))
    assert found is not None
    assert found.difference_m == pytest.approx(0.0, abs=1e-9)
    # 1 m each, and half a second at 1.5 m/s.
    assert found.allowed_m == pytest.approx(2.75)


def test_a_fix_that_is_too_old_or_from_the_future_is_left_out() -> None:
    for rear_s in (0.0, 3.0):
        finder = FrontEndFinder(ANTENNAS, "up")
        finder.take("rear", fix(rear_s, 0.0))
        found = finder.take("front", fix(1.5, 1005.0))
        assert found is not None
        assert found.devices == ("front",)


def test_without_a_line_a_curve_may_shorten_the_train() -> None:
    straight = both(FrontEndFinder(ANTENNAS), fix(1.0, None, 1.0), fix(1.0, None, 1.0, east_m=100.0))
    curved_m = 200.0 * math.sin(0.5)
    curved = both(FrontEndFinder(ANTENNAS), fix(1.0, None, 1.0), fix(1.0, None, 1.0, east_m=curved_m))
    torn = both(FrontEndFinder(ANTENNAS), fix(1.0, None, 1.0), fix(1.0, None, 1.0, east_m=104.0))
    assert (straight.agreement, curved.agreement, torn.agreement) == ("agree", "agree", "disagree")
    assert straight.chainage_m is None


def test_fixes_without_a_bound_vouch_for_nothing() -> None:
    finder = FrontEndFinder(ANTENNAS, "up")
    for unusable in (fix(1.0, 995.0, None), fix(1.0, None, None, status="none")):
        found = finder.take("front", unusable)
        assert found is not None
        assert (found.agreement, found.devices, found.chainage_m) == ("unknown", (), None)


def test_a_receiver_without_lever_arm_takes_no_part() -> None:
    assert FrontEndFinder(ANTENNAS).take("roof", fix(1.0, 0.0)) is None
