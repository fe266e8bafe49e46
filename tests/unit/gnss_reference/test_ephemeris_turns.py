"""A station whose satellites change their ephemerides: trains with either are corrected without a gap."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import msgspec
import numpy as np
import pytest

from schemas.gnss import Corrections, Ephemeris, SatelliteCorrection
from services.gnss_correction.atmosphere import LIGHT_MPS
from services.gnss_correction.fix_messages import fixes_of
from services.gnss_correction.pipeline import Correction, block_of
from services.gnss_correction.settings import Config
from services.gnss_correction.station_sight import station_at
from services.gnss_reference.ephemeris_turns import HOLD_S, EphemerisTurns
from services.gnss_reference.reference_correction import ReferenceStation, StationSettings
from services.numerics.geodesy import enu_about
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, START_S, WEEK, constellation, measured

SKY = constellation()
SEEN = measured(SKY, START_S).satellites
RENEWED = SEEN[:3]
EARLIER_S = 1e-8
DIFFERENCE_M = LIGHT_MPS * EARLIER_S
GPS_S = WEEK * 604_800.0 + START_S


def renewed(names: Iterable[str] = RENEWED, **changes: float) -> list[Ephemeris]:
    """New issues for some satellites, sent half a minute later: another clock, unless told otherwise."""
    return [
        msgspec.structs.replace(
            one,
            **({"clock_bias_s": one.clock_bias_s + EARLIER_S} | changes),
            issue=one.issue + 1,
            t_ns=one.t_ns + 30 * 10**9,
        )
        for one in SKY
        if one.satellite in names
    ]


def station(*, in_turns: bool = True) -> ReferenceStation:
    made = ReferenceStation("W1", PLACE_DEG, StationSettings(smooth_s=0.0), in_turns=in_turns)
    for one in SKY:
        made.add(one)
    return made


def said(at: ReferenceStation, seconds: Iterable[float]) -> list[Corrections]:
    """What a station says at seconds after START_S."""
    return [next(at.block(block_of(measured(SKY, START_S + second)))) for second in seconds]


def of(message: Corrections, name: str) -> SatelliteCorrection:
    (found,) = (one for one in message.satellites if one.satellite == name)
    return found


def issues(messages: Sequence[Corrections], name: str) -> list[int]:
    return [of(one, name).issue for one in messages]


def test_both_issues_take_turns_after_a_change() -> None:
    at = station()
    assert issues(said(at, range(2)), SEEN[0]) == [7, 7]
    for one in renewed():
        at.add(one)
    messages = said(at, range(2, 8))
    for name in RENEWED:
        assert issues(messages, name) == [7, 8, 7, 8, 7, 8]
    assert set(issues(messages, SEEN[5])) == {7}
    old, new = of(messages[0], RENEWED[0]), of(messages[1], RENEWED[0])
    later = messages[2]
    assert (old.toe_week, old.toe_s) == (WEEK, START_S)
    between = 0.5 * (old.correction_m + of(later, RENEWED[0]).correction_m) - new.correction_m
    # Between two corrections for the old issue; air and clocks change by millimetres in a second.
    assert between == pytest.approx(DIFFERENCE_M, abs=0.01)


def test_the_old_issue_is_given_up_after_a_while() -> None:
    at = station()
    said(at, range(2))
    for one in renewed():
        at.add(one)
    assert set(issues(said(at, range(2, 8)), RENEWED[0])) == {7, 8}
    assert set(issues(said(at, np.arange(1.0, 6.0) + HOLD_S + 1.0), RENEWED[0])) == {8}


def test_files_know_no_turns() -> None:
    at = station(in_turns=False)
    said(at, range(2))
    for one in renewed():
        at.add(one)
    assert issues(said(at, range(2, 8)), RENEWED[0]) == [8] * 6


@pytest.mark.parametrize("known", [SKY, renewed(SEEN), SKY + renewed(SEEN)], ids=["old", "new", "both"])
def test_trains_with_either_issue_stay_corrected(known: list[Ephemeris]) -> None:
    at = station()
    said(at, range(2))
    for one in renewed(SEEN):
        at.add(one)
    train = Correction(Config(method="original", compare=()))
    for one in known:
        train.add(one)
    # A train that passes here: all errors are shared.
    for second in range(2, 12):
        (message,) = said(at, [second])
        assert train.correct_by(message) == ""
        (fix,) = fixes_of(train.epoch(measured(SKY, START_S + second)), "original")
        if second > 2:
            assert fix.satellites_corrected == fix.satellites_used > 6
            place = enu_about(PLACE_DEG, fix.lat_deg or 0.0, fix.lon_deg or 0.0, fix.h_m or 0.0)
            # Corrections are a second old at most; without carrier phases their rates are unknown, and the air above
            # moves them by a centimetre.
            assert float(np.linalg.norm(place)) < 0.05


def test_the_newest_is_spoken_of_as_long_as_it_is_not_the_nearest() -> None:
    """GPS sends an ephemeris an hour before it is the nearest: a train that has just been started knows no other."""
    at = station()
    said(at, range(2))
    # The same elements two hours later are another orbit: too far from the first to be believed.
    for one in renewed(toe_s=START_S + 7_200.0, toc_s=START_S + 7_200.0, clock_bias_s=0.0):
        at.add(one)
    assert set(issues(said(at, range(2, 8)), RENEWED[0])) == {7}
    turns = EphemerisTurns(station_at(*PLACE_DEG), "G")
    first, second = SKY[0], msgspec.structs.replace(SKY[0], issue=8, toe_s=START_S + 7_200.0, t_ns=SKY[0].t_ns + 1)
    turns.add(first, GPS_S)
    turns.add(second, GPS_S + 1.0)
    for later_s in (2.0, HOLD_S, 3_000.0):
        assert turns.other(first.satellite, (WEEK, START_S, 7), GPS_S + later_s) == second
    # Once it is the nearest, the old one is held for a while after it was heard, which is over.
    assert turns.other(first.satellite, (WEEK, START_S + 7_200.0, 8), GPS_S + 4_000.0) is None


def test_what_is_no_choice_is_not_offered() -> None:
    turns = EphemerisTurns(station_at(*PLACE_DEG), "G")
    used = (WEEK, START_S, 7)
    assert turns.other("G01", used, GPS_S) is None
    turns.add(SKY[0], GPS_S)
    assert turns.other("G01", used, GPS_S) is None
    turns.add(msgspec.structs.replace(SKY[0], issue=8, t_ns=SKY[0].t_ns + 1, healthy=False), GPS_S)
    assert turns.other("G01", used, GPS_S) is None
    assert turns.other("G01", (WEEK, START_S, 99), GPS_S) is None
    turns.add(msgspec.structs.replace(SKY[0], issue=9, t_ns=SKY[0].t_ns + 2, toe_s=START_S - 9_000.0), GPS_S)
    assert turns.other("G01", used, GPS_S) is None


def test_ephemerides_before_the_first_epoch_are_no_change() -> None:
    at = station()
    for one in renewed():
        at.add(one)
    assert issues(said(at, range(4)), RENEWED[0]) == [8] * 4


def test_the_difference_has_a_rate() -> None:
    at = station()
    said(at, range(2))
    drift = 2e-11
    for one in renewed(clock_drift=1e-11 + drift):
        at.add(one)
    messages = said(at, range(2, 8))
    plain, other = of(messages[4], RENEWED[0]), of(messages[5], RENEWED[0])
    # Correction for the old issue less that for the new one: c times the difference of the clocks, which grows.
    assert (plain.issue, other.issue) == (7, 8)
    assert plain.rate_mps - other.rate_mps == pytest.approx(LIGHT_MPS * drift, rel=1e-3)


def test_many_ephemerides_do_not_pile_up() -> None:
    turns = EphemerisTurns(station_at(*PLACE_DEG), "E")
    one = msgspec.structs.replace(SKY[0], satellite="E01")
    for issue in range(200):
        turns.add(
            msgspec.structs.replace(one, issue=issue, toe_s=START_S + 600.0 * issue, t_ns=issue * 10**9),
            GPS_S + 600.0 * issue,
        )
    found = turns.other("E01", (WEEK, START_S + 600.0 * 199, 199), GPS_S + 600.0 * 199 + 10.0)
    assert found is not None
    assert found.issue == 198
