"""Occupied or clear: trains are seen in any weather, rain is no train, and what is not known is occupied."""

from __future__ import annotations

import numpy as np
import pytest

from services.track_circuit.occupancy import Occupancy, OccupancySettings
from services.track_circuit.occupancy_trials import pair_trials, ramp_trials, train_trials
from services.track_circuit.rail import Rail, level_db, transfer

SETTINGS = OccupancySettings()
STEP_S = 0.2


def fed(one: Occupancy, level: float | None, begin_s: float, seconds: float, *, telegrams: bool = True) -> float:
    """Feed a level for some time; gives the time at the end."""
    count = round(seconds / STEP_S)
    for k in range(count):
        t_s = begin_s + k * STEP_S
        if telegrams:
            one.telegram(t_s)
        one.level(level, t_s)
    return begin_s + count * STEP_S


def clear_circuit(reference_db: float = -20.0) -> tuple[Occupancy, float]:
    one = Occupancy(SETTINGS, 0.0)
    one.confirm_clear(reference_db, 0.0)
    t_s = fed(one, reference_db, 0.0, 4.0)
    assert one.verdict(t_s).state == "clear"
    return one, t_s


def test_an_unknown_start_is_occupied_for_ever() -> None:
    one = Occupancy(SETTINGS, 0.0)
    assert one.verdict(0.0).state == "occupied"
    t_s = fed(one, -20.0, 0.0, 60.0)
    verdict = one.verdict(t_s)
    assert (verdict.state, verdict.reason) == ("occupied", "the clear circuit's level is not known")


def test_drop_is_quick_and_pick_up_slow() -> None:
    one, t_s = clear_circuit()
    begin_s = t_s
    while one.verdict(t_s).state == "clear":
        t_s = fed(one, -45.0, t_s, STEP_S)
    assert t_s - begin_s <= SETTINGS.drop_s + 2 * STEP_S
    t_s = fed(one, -45.0, t_s, 20.0)
    back_s = t_s
    while one.verdict(t_s).state == "occupied":
        t_s = fed(one, -20.0, t_s, STEP_S)
    assert SETTINGS.pick_up_s <= t_s - back_s <= SETTINGS.pick_up_s + 2 * STEP_S


def test_a_short_dip_is_no_train() -> None:
    one, t_s = clear_circuit()
    t_s = fed(one, -45.0, t_s, STEP_S)
    t_s = fed(one, -20.0, t_s, 1.0)
    assert one.verdict(t_s).state == "clear"


def test_silence_and_missing_telegrams_are_occupied() -> None:
    one, t_s = clear_circuit()
    assert one.verdict(t_s + 0.5).state == "clear"
    quiet = one.verdict(t_s + 1.5)
    assert (quiet.state, quiet.reason, quiet.most_restrictive) == ("occupied", "no samples", True)
    other, t_s = clear_circuit()
    t_s = fed(other, -20.0, t_s, 4.0, telegrams=False)
    verdict = other.verdict(t_s)
    assert (verdict.state, verdict.reason, verdict.most_restrictive) == ("occupied", "no telegram in time", True)


def test_a_level_of_long_ago_is_none_to_go_by() -> None:
    one, t_s = clear_circuit()
    assert one.fresh_level_db(t_s) == -20.0
    assert one.fresh_level_db(t_s + 5.0) is None


def test_no_signal_is_occupied() -> None:
    one, t_s = clear_circuit()
    t_s = fed(one, None, t_s, 1.0)
    assert one.verdict(t_s).reason == "no signal"


def test_samples_that_pause_do_not_keep_an_old_clear() -> None:
    one, t_s = clear_circuit()
    one.telegram(t_s + 30.0)
    one.level(-20.0, t_s + 30.0)
    assert one.verdict(t_s + 30.0).state == "occupied"


def test_a_level_before_the_last_one_is_left_out() -> None:
    one, t_s = clear_circuit()
    one.level(-60.0, t_s - 10.0)
    assert one.verdict(t_s).level_db == -20.0


def test_two_hours_of_rain_are_no_train_and_trains_in_it_are_seen() -> None:
    rail, rng = Rail(), np.random.default_rng(4)
    ballast = np.geomspace(0.01, 0.5, 7200)
    levels = level_db(transfer(rail, 12_000.0, 1.0, ballast))
    shunted = level_db(transfer(rail, 12_000.0, 1.0, ballast, shunt_ohm=0.06, shunt_km=0.4))
    one = Occupancy(OccupancySettings(silence_s=2.0), 0.0)
    one.confirm_clear(float(levels[0]), 0.0)
    for second in range(7200):
        train = second % 900 > 860
        one.telegram(float(second))
        one.level(float((shunted if train else levels)[second]) + rng.normal(0.0, 0.2), float(second))
        state = one.verdict(float(second)).state
        inside, just_left = second % 900 > 862, second > 5 and second % 900 < 6
        if inside:
            assert state == "occupied", second
        if not train and second > 5 and not just_left:
            assert state == "clear", second


def test_ballast_that_dries_under_a_train_does_not_clear_it() -> None:
    rail = Rail()
    ballast = np.geomspace(0.5, 0.01, 7200)
    for shunt_ohm in (0.06, 0.5):
        levels = level_db(transfer(rail, 12_000.0, 1.0, ballast, shunt_ohm=shunt_ohm, shunt_km=0.5))
        one, _ = clear_circuit(float(level_db(transfer(rail, 12_000.0, 1.0, 0.5))))
        for second in range(7200):
            one.telegram(second + 5.0)
            one.level(float(levels[second]), second + 5.0)
            assert second < 2 or one.verdict(second + 5.0).state == "occupied", second
        # Even at the level that the clear circuit once had: only a step shows that the train has left.
        dry = float(level_db(transfer(rail, 12_000.0, 1.0, 0.01)))
        t_s = fed(one, dry, 7210.0, 4.0)
        assert one.verdict(t_s).state == "clear"


def test_the_second_of_two_trains_is_not_forgotten_when_the_ballast_dried_meanwhile() -> None:
    one, t_s = clear_circuit(-20.0)
    t_s = fed(one, -45.0, t_s, 20.0)
    t_s = fed(one, -65.0, t_s, 20.0)
    for k in range(10_800):  # three hours lift the level by 24 dB
        t_s += 1.0
        one.telegram(t_s)
        one.level(-65.0 + 24.0 * k / 10_800, t_s)
    # The first leaves: a step as great as its own entry's, up to where the clear circuit was. The second stands there.
    t_s = fed(one, -16.0, t_s, 60.0)
    assert one.verdict(t_s).state == "occupied"
    t_s = fed(one, 4.0, t_s, 4.0)
    assert one.verdict(t_s).state == "clear"


def test_weather_faster_than_ever_seen_is_no_step() -> None:
    one, t_s = clear_circuit(-20.0)
    t_s = fed(one, -45.0, t_s, 20.0)
    for k in range(1800):  # 30 dB within half an hour
        t_s += 1.0
        one.telegram(t_s)
        one.level(-45.0 + 30.0 * k / 1800, t_s)
        assert one.verdict(t_s).state == "occupied"


def test_after_a_long_gap_in_the_samples_steps_tell_nothing() -> None:
    one, t_s = clear_circuit(-20.0)
    t_s = fed(one, -45.0, t_s, 20.0)
    t_s = fed(one, -20.0, t_s + 900.0, 10.0)
    assert one.verdict(t_s).reason == "the reference is too old to tell"
    one.confirm_clear(-20.0, t_s)
    assert one.verdict(fed(one, -20.0, t_s, 4.0)).state == "clear"


def test_pairs_of_trains_in_drying_circuits() -> None:
    found = pair_trials(12, 3.0, 0.06, np.random.default_rng(3), SETTINGS)
    assert (found.undetected, found.released) == (0, 12)


@pytest.mark.parametrize("shunt_ohm", [0.06, 0.5])
def test_every_train_is_seen_at_any_place_in_any_weather(shunt_ohm: float) -> None:
    found = train_trials(300, shunt_ohm, np.random.default_rng(6), SETTINGS)
    assert found.undetected == 0
    # No place and no weather makes a shunt weaker than this: the threshold of 5 dB lies well below.
    assert found.smallest_drop_db > (20.0 if shunt_ohm < 0.1 else 7.0)


def test_a_deaf_threshold_would_miss_trains() -> None:
    deaf = OccupancySettings(drop_db=30.0)
    assert train_trials(20, 0.5, np.random.default_rng(6), deaf).undetected > 0


def test_ramps_from_dry_to_wet_are_no_trains() -> None:
    assert ramp_trials(3, 2.0, np.random.default_rng(7), SETTINGS).false_occupied == 0


def test_a_broken_rail_reads_as_occupied() -> None:
    for place in (0.0, 0.3, 1.0):
        clear = float(level_db(transfer(Rail(), 12_000.0, 1.0, 0.05)))
        one, t_s = clear_circuit(clear)
        t_s = fed(one, float(level_db(transfer(Rail(), 12_000.0, 1.0, 0.05, broken_km=place))), t_s, 1.0)
        assert one.verdict(t_s).state == "occupied"


def test_a_hysteresis_must_be_one() -> None:
    with pytest.raises(ValueError, match="pick_up_db"):
        OccupancySettings(drop_db=3.0, pick_up_db=3.0)
