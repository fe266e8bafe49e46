"""Satellites that lead the robust filter astray from the start: covered by the bound, then found and left out."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from schemas.gnss import Epoch, Fix
from services.gnss_correction.fix_messages import fixes_of
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.robust_doubt import TOLD_M
from services.gnss_correction.robust_hypotheses import CLEAN_S
from services.gnss_correction.settings import Config
from services.gnss_receiver.observations import satellite_code
from services.numerics.geodesy import enu_about
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, PLACE_M, START_S, constellation, measured

GPS = constellation()
NORTH = np.array(
    [
        -np.sin(np.radians(PLACE_DEG[0])) * np.cos(np.radians(PLACE_DEG[1])),
        -np.sin(np.radians(PLACE_DEG[0])) * np.sin(np.radians(PLACE_DEG[1])),
        np.cos(np.radians(PLACE_DEG[0])),
    ]
)
"""Northwards at the place, Earth-fixed."""
EPOCHS = 40


def town(strong: int, epochs: int = EPOCHS) -> list[Epoch]:
    """A standing receiver at 1 Hz among buildings: one satellite is strong, the others are weak and late by metres."""
    generator = np.random.default_rng(7)
    made = []
    for k in range(epochs):
        epoch = measured(GPS, START_S + k, clocks_m={"G": 20_000.0 + 6.0 * k})
        cn0_dbhz = np.full(len(epoch.satellites), 38.0)
        cn0_dbhz[strong] = 50.0
        late_m = np.abs(generator.normal(0.0, 4.0, len(epoch.satellites)))
        late_m[strong] = 0.0
        made.append(msgspec.structs.replace(epoch, pseudorange_m=epoch.pseudorange_m + late_m, cn0_dbhz=cn0_dbhz))
    return made


def late(epoch: Epoch, satellite: int, by_m: float) -> Epoch:
    pseudorange_m = epoch.pseudorange_m.copy()
    pseudorange_m[satellite] += by_m
    return msgspec.structs.replace(epoch, pseudorange_m=pseudorange_m)


def solved(epochs: list[Epoch]) -> tuple[list[Fix], Correction]:
    made = Correction(Config(), ("robust",))
    for one in GPS:
        made.add(one)
    return [fixes_of(made.epoch(epoch), "robust")[0] for epoch in epochs], made


def off_by_m(fix: Fix) -> float:
    place = enu_about(PLACE_DEG, fix.lat_deg or 0.0, fix.lon_deg or 0.0, fix.h_m or 0.0)
    return float(np.hypot(place[0], place[1]))


def bound_of(fix: Fix) -> float:
    assert fix.bound_m is not None
    return fix.bound_m


@pytest.mark.parametrize("satellite", [0, 2, 5])
@pytest.mark.parametrize("late_m", [30.0, 100.0, 300.0, -100.0])
def test_a_strong_satellite_that_is_late_from_the_first_epoch_on(satellite: int, late_m: float) -> None:
    fixes, _ = solved([late(epoch, satellite, late_m) for epoch in town(satellite)])
    assert all(off_by_m(fix) < bound_of(fix) for fix in fixes)


@pytest.mark.parametrize("pair", [(0, 3), (1, 4)])
def test_two_satellites_that_are_late_from_the_first_epoch_on(pair: tuple[int, int]) -> None:
    fixes, _ = solved([late(late(epoch, pair[0], 100.0), pair[1], -100.0) for epoch in town(pair[0])])
    assert all(off_by_m(fix) < bound_of(fix) for fix in fixes)


@pytest.mark.parametrize("rate_mps", [0.5, 2.0])
def test_a_satellite_that_is_led_away_slowly(rate_mps: float) -> None:
    fixes, _ = solved([late(epoch, 2, rate_mps * k) for k, epoch in enumerate(town(2))])
    assert all(off_by_m(fix) < bound_of(fix) for fix in fixes)


def test_a_satellite_left_out_is_taken_back_once_it_agrees() -> None:
    clean = town(2, 2 * EPOCHS)
    epochs = [late(epoch, 2, 0.0 if k > EPOCHS else 300.0) for k, epoch in enumerate(clean)]
    made = Correction(Config(), ("robust",))
    for one in GPS:
        made.add(one)
    code = satellite_code(epochs[0].satellites[2])
    memory = made._robust._memory
    memory.excluded[code] = 1
    excluded = []
    for epoch in epochs:
        made.epoch(epoch)
        # A start forgets what was left out; from then on the filter decides.
        memory.excluded[code] = 1 if epoch is epochs[0] else memory.excluded[code]
        excluded.append(int(memory.excluded[code]))
    assert excluded[: EPOCHS + 1] == [1] * (EPOCHS + 1)
    back = excluded.index(0) - EPOCHS - 1
    # At 1 Hz, by the receiver's own clock; some of the late pseudoranges disagree by chance.
    assert CLEAN_S - 1.0 <= back <= CLEAN_S + 2.0


def test_all_pseudoranges_led_away_slowly_against_doppler_are_told_and_covered() -> None:
    epochs = [
        measured(GPS, START_S + k, clocks_m={"G": 20_000.0}, place_m=PLACE_M + NORTH * 2.0 * max(k - 30, 0))
        for k in range(110)
    ]
    fixes, _ = solved(epochs)
    told = [k for k, fix in enumerate(fixes) if "against Doppler" in fix.reason]
    assert told
    # At two metres a second the limit is passed after 25 s, and the sum forgets a part of it.
    assert 30.0 + TOLD_M / 2.0 - 5.0 < told[0] < 90.0
    assert all(bound_of(fix) > off_by_m(fix) for fix in fixes[told[0] :])


def test_the_bound_of_a_clean_sky_is_not_spoilt_by_the_hypotheses() -> None:
    epochs = [measured(GPS, START_S + k, clocks_m={"G": 20_000.0}) for k in range(60)]
    fixes, made = solved(epochs)
    assert int(np.sum(made._robust._memory.excluded)) == 0
    assert bound_of(fixes[-1]) < 45.0
