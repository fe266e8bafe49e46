"""An optimum is never dearer than the run whose limits it keeps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.run_history.driving_advice import advice_of
from services.run_history.observed_limits import same_limits
from services.run_history.optimum import Optimum, optimum
from services.run_history.optimum_values import BRAKE, COAST, FULL, LIMIT
from services.run_history.report_reasons import in_language
from services.run_history.speed_trace import SpeedTrace
from services.run_history.trace_store import TraceStore
from services.run_history.traction_energy import traction_energy
from services.run_history.vehicle import Vehicle
from tests.unit.run_history.made_runs import TRAIN, WAY, Floats

START_M = 1000.0


def driven(rise_mps2: float, fall_mps2: float, speeds_mps: tuple[float, ...]) -> SpeedTrace:
    """A run of 3 km and its braking that holds one speed after the other for a while each, with ramps between."""
    v, way, time = 0.0, 0.0, 0.0
    rows = [(0.0, 0.0, 0.0)]
    for number, wanted in enumerate((*speeds_mps, 0.0)):
        last = number == len(speeds_mps)
        end_m = 3000.0 * (number + 1) / len(speeds_mps)
        while v > 0.0 if last else way < end_m:
            after = min(v + rise_mps2 * 0.5, wanted) if v < wanted else max(v - fall_mps2 * 0.5, wanted)
            way, time, v = way + 0.25 * (v + after), time + 0.5, after
            rows.append((way, time, v))
    table = np.array(rows)
    return SpeedTrace("r", 0.0, table[:, 0], table[:, 1], table[:, 2])


def energy_kwh(trace: SpeedTrace, vehicle: Vehicle) -> float:
    """As legs are told."""
    t: Floats = trace.time_s
    force = vehicle.track_force_n(*(np.zeros(len(t)),) * 2)
    slope = np.gradient(trace.speed_mps, t)
    return traction_energy(vehicle, t, trace.speed_mps, slope, np.zeros(len(t)), force).traction_kwh


@settings(max_examples=25)
@given(
    rise=st.floats(0.3, 1.3),
    fall=st.floats(0.4, 1.2),
    speeds=st.lists(st.floats(10.0, 28.0), min_size=1, max_size=3),
)
def test_the_optimum_is_never_dearer_than_the_run(rise: float, fall: float, speeds: list[float]) -> None:
    trace = driven(rise, fall, tuple(speeds))
    limits = same_limits(WAY, TRAIN, [trace], 0, START_M, 1.0)
    assert limits.observed_share == 1.0  # the made line states no limit
    found = optimum(limits.section, limits.vehicle, float(trace.time_s[-1]))
    assert found.running_time_s <= float(trace.time_s[-1]) + 0.2
    # A run that fills its limits is the only one within them; the grid of 10 m tells it to a fifth of a per cent.
    assert found.traction_kwh <= 1.002 * energy_kwh(trace, TRAIN)


def test_a_run_s_own_place_speed_and_effort_become_limits() -> None:
    trace, other = driven(1.3, 1.2, (18.0, 25.0)), driven(0.5, 0.5, (22.0,))
    found = same_limits(WAY, TRAIN, [trace, other], 0, START_M, 1.0)
    assert found.section.axis_m[0] == pytest.approx(START_M)
    assert found.section.axis_m[-1] == pytest.approx(START_M + trace.way_m[-1])
    middle = np.searchsorted(found.section.axis_m, START_M + 1000.0)
    # 95 % of two runs lie between them, nearer to the faster one.
    assert 18.0 < found.section.limit_mps[middle] <= 22.0
    assert found.vehicle.max_acceleration_mps2 == pytest.approx(1.3, abs=0.05)
    assert found.vehicle.service_brake_mps2 == pytest.approx(1.2, abs=0.05)
    assert any(one.startswith("max_acceleration_mps2") for one in found.beyond)
    assert (
        same_limits(WAY, TRAIN, [other], 0, START_M, 1.0).vehicle.max_acceleration_mps2 == TRAIN.max_acceleration_mps2
    )


def profile(control: list[int], speed: list[float]) -> Optimum:
    n = len(speed)
    seconds = np.arange(n, dtype=np.float64)
    return Optimum(10.0 * seconds, np.array(speed), seconds, np.array([*control, BRAKE]), float(n - 1), 1.0, 1.0)


def test_advice_tells_a_short_braking_and_leaves_slight_ones_out() -> None:
    speed = [0.0, *np.linspace(5.0, 20.0, 8), *np.linspace(19.9, 19.0, 8), 18.0, 17.0, 16.0, *np.linspace(15.9, 15, 8)]
    short = [FULL] * 8 + [COAST] * 8 + [BRAKE] * 3 + [COAST] * 8
    told = advice_of(profile(short, speed))
    assert [one.what for one in told] == ["accelerate", "coast", "brake", "coast"]
    brake = told[2]
    assert (brake.length_m, brake.from_kmh, brake.until_kmh) == pytest.approx((30.0, 19.0 * 3.6, 16.0 * 3.6))
    flat = [*speed[:17], *np.linspace(18.9, 18.0, 11)]
    assert [one.what for one in advice_of(profile(short, flat))] == ["accelerate", "coast"]


def test_a_limit_that_falls_is_told_as_braking() -> None:
    speed = [0.0, *np.linspace(5.0, 20.0, 8), *np.full(8, 20.0), 18.0, 16.0, 14.0, *np.full(8, 14.0)]
    told = advice_of(profile([FULL] * 8 + [LIMIT] * 19, speed))
    assert [one.what for one in told] == ["accelerate", "hold", "brake", "hold"]


def test_traces_come_back_from_disk_as_they_went() -> None:
    one, other = driven(0.5, 0.5, (20.0,)), driven(0.8, 0.5, (15.0, 20.0))
    with TraceStore() as store:
        for trace in (one, other):
            store.put("A", "B / ..", trace)
        store.put("B / ..", "A", other)
        back = store.of("A", "B / ..")
        assert [len(trace.time_s) for trace in back] == [len(one.time_s), len(other.time_s)]
        for trace, found in zip((one, other), back, strict=True):
            for column in ("way_m", "time_s", "speed_mps"):
                assert np.array_equal(getattr(trace, column), getattr(found, column))
        assert len(store.of("B / ..", "A")) == 1
        assert store.of("A", "C") == []


@pytest.mark.parametrize(
    ("english", "japanese"),
    [
        ("a gap of 20 s; held between stations", "測位の欠測20秒;駅間で抑止"),
        ("30% of its speeds contradict its places", "速度の30%が位置と矛盾"),
        ("speeds and places disagree by 310 m of way", "速度と位置の走行距離が310 m不一致"),
        ("R-1a: no speeds in the log: derived from places", "R-1a:速度の記録なし:位置から算出"),
        ("no faster than 120.5 s within limits, traction and brakes", None),
        ("something new", "something new"),
    ],
)
def test_reasons_speak_the_report_s_language(english: str, japanese: str | None) -> None:
    assert in_language(english, "en") == english
    if japanese is not None:
        assert in_language(english, "ja") == japanese
    else:
        assert "120.5" in in_language(english, "ja")
