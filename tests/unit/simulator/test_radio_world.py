"""What a train's device hears of the radios of a line: repeatable by place, and disturbed where something is wrong."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from services.simulator.radio_faults import Befalls, RadioFault, RadioFaultKind
from services.simulator.radio_passes import RadioPass, begin_s, radio_pass, radio_passes, world_of
from services.simulator.radio_scenario import DatedFault, Passes, RadioScenario, Straight
from services.simulator.radio_settings import RadioSettings
from services.simulator.radio_world import Journey, RadioWorld
from services.simulator.scenario_file import radio_line_for, read_any_scenario

Floats = NDArray[np.float64]
STRAIGHT = Straight()
HARD = RadioScenario(name="hard", straight=STRAIGHT, radio=RadioSettings(period_s=1.0), passes=Passes(days=10))
WORLD = world_of(HARD, STRAIGHT.line())
STILL = RadioSettings(
    period_s=1.0, pass_db=0.0, daily_db=0.0, season_db=0.0, fading="none", reading_db=0.0, samples=10**9,
    snow_db_per_mm_h=0.0,
)  # fmt: skip
"""Nothing changes from pass to pass."""


def still(**fields: object) -> tuple[RadioScenario, RadioWorld]:
    scenario = RadioScenario(
        name="still", straight=STRAIGHT, radio=msgspec.structs.replace(STILL, **fields), passes=Passes(days=10)
    )
    return scenario, world_of(scenario, STRAIGHT.line())


def column(one: RadioPass, link: int, name: str = "channel_power_dbm") -> tuple[Floats, Floats]:
    """Places, rising, and what was measured there of a radio."""
    rows = np.flatnonzero(one.link == link)
    rows = rows[np.argsort(one.axis_m[rows])]
    return one.axis_m[rows], one.measured[name][rows]


def fault(kind: RadioFaultKind, magnitude: float, **where: float | str) -> RadioFault:
    return RadioFault(kind, magnitude, msgspec.convert(where, Befalls))


def test_table_2_is_free_space() -> None:
    scenario = read_any_scenario("radio_table2")
    assert isinstance(scenario, RadioScenario)
    line, chainage = radio_line_for(scenario)
    assert chainage is None
    assert [site.axis_m for site in line.sites] == [1000.0, 3000.0, 5000.0, 7000.0, 9000.0]
    assert scenario.passes.speed_mps * 3.6 == 45.0
    one = radio_pass(scenario, world_of(scenario, line), 0)
    axis_m, dbm = column(one, 2)
    distance_m = np.sqrt((axis_m - 5000.0) ** 2 + 5.0**2 + 4.0**2)
    expected = 20.0 + 6.0 + 2.0 - (20.0 * np.log10(distance_m) + 40.046)
    # White noise at -105 dBm: at -92 dBm the mean is 0.2 dB higher, and ten samples scatter by 10 % in amplitude.
    assert np.abs(dbm - expected).mean() < 0.3
    assert np.abs(dbm - expected)[distance_m < 1000.0].max() < 0.5
    assert (one.measured["received_ratio"] == 1.0).all()


def test_a_place_has_the_same_shadows_on_every_pass() -> None:
    scenario, world = still()
    first, third = (column(radio_pass(scenario, world, number), 1)[1] for number in (0, 2))
    assert first == pytest.approx(third, abs=1e-3)
    smooth, uneven = still(shadowing_db=0.0, direction_db=0.0), column(radio_pass(scenario, world, 0), 1)
    shadows = uneven[1] - column(radio_pass(*smooth, 0), 1)[1]
    # 5 dB of the place and 1.5 dB of the direction, over 60 independent stretches.
    assert shadows.std() == pytest.approx(5.2, abs=1.5)
    other = still(seed=2)
    assert np.abs(column(radio_pass(*other, 0), 1)[1] - uneven[1]).mean() > 2.0


def test_directions_differ_a_little() -> None:
    scenario, world = still(antennas="isotropic")
    up_m, up = column(radio_pass(scenario, world, 0), 2)
    down_m, down = column(radio_pass(scenario, world, 1), 2)
    differing = np.interp(up_m, down_m, down) - up
    # Two shares of 1.5 dB.
    assert differing.std() == pytest.approx(1.5 * np.sqrt(2.0), abs=0.7)


def test_passes_differ_as_days_fading_and_devices_do() -> None:
    sections: list[Floats] = []
    for number in range(0, 20, 2):
        axis_m, dbm = column(radio_pass(HARD, WORLD, number), 1)
        inside = (axis_m > 2000.0) & (axis_m < 4000.0)
        sections.append(np.array([dbm[inside & (axis_m // 100 == k)].mean() for k in range(20, 40)]))
    spread = np.std(sections, axis=0, ddof=1).mean()
    # A day's offset, a pass's own, leaves: √(1 + 1) dB and what averaging leaves of fading.
    assert 0.8 < spread < 2.2


def test_a_pass_is_the_same_whatever_else_is_taken_and_however_it_is_cut() -> None:
    alone = radio_pass(HARD, WORLD, 3)
    again = list(radio_passes(HARD, world_of(HARD, STRAIGHT.line())))[3]
    assert alone.pass_id == again.pass_id == "T1-20260106T150000Z-down"
    for name, values in alone.measured.items():
        assert np.array_equal(values, again.measured[name], equal_nan=True)
    rows = np.flatnonzero(alone.link == 2)
    t_s, axis_m = alone.t_ns[rows] / 1e9, alone.axis_m[rows]
    for row in (0, 50, len(rows) - 1):
        journey = Journey(
            HARD.seed * 1_000_003 + 3, rises=False, t_s=t_s[row : row + 1], axis_m=axis_m[row : row + 1],
            speed_mps=np.array([12.5]),
        )  # fmt: skip
        (reading,) = [one for link, one in WORLD.measure(journey) if link.site == 2]
        # The start is a whole second; adding half seconds to it is exact to a few 100 ns.
        assert reading.channel_power_dbm[0] == pytest.approx(alone.measured["channel_power_dbm"][rows[row]], abs=1e-3)


def test_only_radios_within_reach_are_heard_and_a_standing_train_hears_the_same_fading() -> None:
    for one in radio_passes(msgspec.structs.replace(HARD, passes=Passes(days=1)), WORLD):
        sites = np.array([site.axis_m for site in WORLD.line.sites])
        assert np.abs(one.axis_m - sites[one.link]).max() <= HARD.radio.reach_m
    quiet = still(fading="rice")[1]
    standing = Journey(1, rises=True, t_s=np.arange(20.0), axis_m=np.full(20, 1500.0), speed_mps=np.zeros(20))
    for _, reading in quiet.measure(standing):
        assert np.ptp(reading.channel_power_dbm) < 0.01


def test_an_obstruction_takes_from_both_powers_in_its_stretch_alone() -> None:
    scenario, world = still()
    clean = radio_pass(scenario, world, 0)
    blocked = radio_pass(
        scenario, world, 0, None, (fault("radio_obstruction", 8.0, start_axis_m=2400, end_axis_m=2700),)
    )
    axis_m, before = column(clean, 1)
    for name in ("channel_power_dbm", "decoded_power_dbm"):
        lower = column(clean, 1, name)[1] - column(blocked, 1, name)[1]
        inside = (axis_m >= 2400.0) & (axis_m < 2700.0)
        # Far above the noise both fall by the whole of it.
        assert lower[inside & (before > -80.0)] == pytest.approx(8.0, abs=0.1)
        assert not np.nan_to_num(lower[~inside]).any()


def test_an_interferer_raises_the_channel_lowers_what_is_decoded_and_takes_frames() -> None:
    scenario, world = still()
    place = {"start_axis_m": 4000.0}
    clean = radio_pass(scenario, world, 0)
    loud = radio_pass(scenario, world, 0, None, (fault("radio_interference", 30.0, **place),))
    axis_m, ratio = column(loud, 1, "received_ratio")
    near = np.abs(axis_m - 4000.0) < 200.0
    raised = column(loud, 1)[1] - column(clean, 1)[1]
    assert raised[near].min() > 3.0
    assert ratio[near].mean() < 0.5
    decoded = column(loud, 1, "decoded_power_dbm")[1]
    still_decoded = near & np.isfinite(decoded)
    assert (decoded - column(clean, 1, "decoded_power_dbm")[1])[still_decoded].max(initial=-99.0) < -3.0
    # Where nothing is decoded nothing is said of what is decoded.
    assert np.array_equal(np.isnan(decoded), ratio == 0.0)
    elsewhere = radio_pass(scenario, world, 0, None, (fault("radio_interference", 30.0, channel="f4", **place),))
    assert np.array_equal(column(elsewhere, 1)[1], column(clean, 1)[1])
    total = still(decoded_power="total")
    # A sender of 0.01 mW: most frames are still decoded.
    heard = radio_pass(*total, 0, None, (fault("radio_interference", -20.0, **place),))
    higher = column(heard, 1, "decoded_power_dbm")[1] - column(clean, 1, "decoded_power_dbm")[1]
    assert np.isfinite(higher[near]).mean() > 0.5
    assert np.nanmin(higher[near]) > 0.0


def test_snow_degradation_and_dead_radios() -> None:
    scenario, world = still()
    clean = radio_pass(scenario, world, 6)
    snowed = radio_pass(scenario, world, 6, None, (fault("radio_snow", 5.0, start_axis_m=2500.0, end_axis_m=5500.0),))
    for link, lost in ((0, 0.0), (1, 5.0), (2, 5.0), (3, 0.0)):
        middle = np.abs(column(clean, link)[0] - 1000.0 - 2000.0 * link) < 900.0
        lower = (column(clean, link)[1] - column(snowed, link)[1])[middle]
        assert lower == pytest.approx(lost, abs=0.3)
    start_s = begin_s(scenario, 0)
    ageing = replace(fault("radio_degradation", 2.0, radio="R02"), since_s=start_s)
    weaker = radio_pass(scenario, world, 6, None, (ageing,))
    near = np.abs(column(clean, 1)[0] - 3000.0) < 900.0
    lower = (column(clean, 1)[1] - column(weaker, 1)[1])[near]
    assert lower == pytest.approx(6.0, abs=0.3)  # the seventh pass begins three days after the first
    told = column(clean, 1, "tx_power_dbm")[1] - column(weaker, 1, "tx_power_dbm")[1]
    assert told[near] == pytest.approx(6.0, abs=0.05)
    assert np.array_equal(column(clean, 3)[1], column(weaker, 3)[1])
    dead = radio_pass(scenario, world, 6, None, (fault("radio_dead", 1.0, radio="R02"),))
    assert not column(dead, 1, "received_ratio")[1].any()
    # What is left is noise: -105 dBm.
    assert column(dead, 1)[1] == pytest.approx(-105.0, abs=0.1)
    silent = radio_pass(scenario, world, 6, None, (fault("radio_dead", 1.0),))
    assert len(silent.t_ns) == 0


def test_faults_of_a_scenario_last_from_day_to_day() -> None:
    scenario, world = still()
    dated = DatedFault(kind="radio_dead", from_day=2.0, to_day=4.0, radio="R03")
    faulty = msgspec.structs.replace(scenario, faults=(dated,))
    gone = [not column(radio_pass(faulty, world, number), 2, "received_ratio")[1].any() for number in range(0, 12, 2)]
    assert gone == [False, False, True, True, False, False]


def test_the_demo_line_is_well_covered() -> None:
    scenario = read_any_scenario("radio_passes")
    assert isinstance(scenario, RadioScenario)
    line, chainage = radio_line_for(scenario)
    assert chainage is not None
    world = world_of(scenario, line)
    for number in (0, 1):
        one = radio_pass(scenario, world, number, chainage)
        _, period = np.unique(one.t_ns, return_inverse=True)
        best = np.zeros(period.max() + 1)
        np.maximum.at(best, period, one.measured["received_ratio"])
        # A line that loses trains without any fault would be no line to look for faults on.
        assert (best >= 0.9).mean() > 0.99
        assert one.chainage_m[0] == pytest.approx(float(chainage.at(one.axis_m[0])))
    assert one.direction == "down"
    assert (np.diff(one.axis_m) <= 0.0).all()
