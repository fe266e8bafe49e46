"""Samples of curvature: what makes them unusable, and when the train was there."""

from __future__ import annotations

import math

import pytest

from services.landmark_matching.reading import Reading, Sample, SampleMaker


def steady(k: int, **changes: object) -> Reading:
    """15 m/s; curvature and distance averaged over 2 s."""
    t_s = 0.1 * k
    plain = {"curvature_per_m": 2e-3, "curvature_distance_m": 15.0 * (t_s - 1.0), "slip": False, "healthy": True}
    plain |= {"t_s": t_s, "distance_m": 15.0 * t_s, "speed_mps": 15.0}
    return Reading(**(plain | changes))  # type: ignore[arg-type]  # the names are those of the fields


def fed(readings: list[Reading]) -> list[Sample]:
    maker = SampleMaker(2.0, 10.0 / 3.6, 0.35, 4.0)
    return [sample for reading in readings if (sample := maker.take(reading)) is not None]


def test_a_sample_is_about_the_place_a_second_ago_at_its_own_time() -> None:
    sample = fed([steady(k) for k in range(60)])[-1]
    assert sample.fault == ""
    assert sample.t_s == pytest.approx(4.9, abs=1e-9)
    assert sample.distance_m == pytest.approx(15.0 * 4.9)
    assert sample.window_m == pytest.approx(30.0)


def test_a_slip_spoils_everything_whose_window_touches_it() -> None:
    samples = fed([steady(k, slip=k == 40) for k in range(80)])
    assert [k for k, sample in enumerate(samples) if sample.fault == "slip"] == list(range(40, 61))
    assert all(math.isnan(sample.curvature_per_m) for sample in samples if sample.fault)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"speed_mps": 2.0}, "low speed"),
        ({"speed_mps": -3.0}, "reverse running"),
        ({"healthy": False}, "gap"),
        ({"curvature_per_m": math.nan}, "no curvature"),
        ({"speed_mps": 17.1}, "leap"),
        ({"speed_mps": 12.9}, "leap"),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, object], fault: str) -> None:
    assert fed([*(steady(k) for k in range(60)), steady(60, **changes)])[-1].fault == fault


def test_a_speed_that_no_train_reaches_spoils_a_window_and_what_trains_do_does_not() -> None:
    # 3 m/s more than a wheel's circumference tells: a spin that the odometry has not seen, begun and ended at once.
    spun = fed([steady(k, speed_mps=18.0 if 40 <= k < 60 else 15.0) for k in range(100)])
    assert [k for k, sample in enumerate(spun) if sample.fault == "leap"] == list(range(40, 85))
    braked = fed([steady(k, speed_mps=15.0 - 0.15 * max(k - 40, 0)) for k in range(80)])
    assert not [sample.fault for sample in braked[30:] if sample.fault]


def test_after_a_gap_a_whole_window_must_pass() -> None:
    samples = fed([steady(k) for k in range(80) if not 40 <= k < 45])
    assert [sample.fault for sample in samples[40:60]] == ["gap"] * 20
    assert samples[-1].fault == ""


@pytest.mark.parametrize("changes", [{"t_s": 3.0}, {"distance_m": math.nan}, {"speed_mps": math.inf}])
def test_repeated_and_impossible_readings_are_left_out(changes: dict[str, object]) -> None:
    maker = SampleMaker(2.0, 10.0 / 3.6, 0.35, 4.0)
    for k in range(40):
        maker.take(steady(k))
    assert maker.take(steady(40, **changes)) is None
