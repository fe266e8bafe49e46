"""A base and a rover under one made-up sky: what they share cancels, what is wrong is refused."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from schemas.gnss import Corrections, Ephemeris, Epoch, Fix, Method, SatelliteVerdict
from services.gnss_correction.differential import CorrectionTable
from services.gnss_correction.fix_messages import fixes_of
from services.gnss_correction.pipeline import Correction, block_of
from services.gnss_correction.settings import Config
from services.gnss_correction.station_sight import station_at
from services.gnss_correction.verdict_messages import verdicts_of
from services.gnss_reference.reference_correction import ReferenceStation, StationSettings
from services.numerics.geodesy import enu_about
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, START_S, constellation, measured

SKY = constellation() + constellation("E")
BASE_DEG = (PLACE_DEG[0] + 0.01, PLACE_DEG[1] - 0.01, PLACE_DEG[2] + 5.0)
"""1.4 km away."""
BASE_M = station_at(*BASE_DEG).place_m
CLOCKS_S = 1e-3
"""Both receivers stamp by their own clocks, which are microseconds off."""
EXACT_M = 0.02
"""The made-up atmosphere is that of the rover's place for both; over 1.4 km its slant differs by millimetres."""


def shared_m(epoch: Epoch) -> np.ndarray:
    """Errors that the satellites have for everybody: some metres each, the same at every epoch."""
    return np.array([8.0 * np.sin(7.0 * int(name[1:]) + ord(name[0])) for name in epoch.satellites])


def spoiled(epoch: Epoch, extra_m: dict[str, float] | None = None) -> Epoch:
    extra = np.array([(extra_m or {}).get(name, 0.0) for name in epoch.satellites])
    return msgspec.structs.replace(epoch, pseudorange_m=epoch.pseudorange_m + shared_m(epoch) + extra)


def rover(t_s: float) -> Epoch:
    return spoiled(measured(SKY, t_s, clocks_m={"G": 3_000.0, "E": 3_040.0}))


def base(t_s: float, extra_m: dict[str, float] | None = None) -> Epoch:
    return spoiled(measured(SKY, t_s, place_m=BASE_M, clocks_m={"G": -700.0, "E": -650.0}), extra_m)


def corrections(
    t_s: float,
    *,
    place_deg: tuple[float, float, float] = BASE_DEG,
    sky: list[Ephemeris] = SKY,
    extra_m: dict[str, float] | None = None,
) -> Corrections:
    station = ReferenceStation("W1", place_deg, StationSettings(smooth_s=0.0))
    for one in sky:
        station.add(one)
    (made,) = station.block(block_of(base(t_s, extra_m)))
    return made


def informed(method: Method = "original", sky: list[Ephemeris] = SKY, **settings: Any) -> Correction:  # noqa: ANN401 - any setting
    correction = Correction(Config(method=method, compare=(), **settings))
    for one in sky:
        correction.add(one)
    return correction


def answer(correction: Correction, epoch: Epoch) -> tuple[Fix, dict[str, SatelliteVerdict]]:
    corrected = correction.epoch(epoch)
    (fix,) = fixes_of(corrected, correction.config.method)
    (verdicts,) = verdicts_of(corrected)
    return fix, {one.satellite: one for one in verdicts.satellites}


def off_m(fix: Fix) -> float:
    return float(np.linalg.norm(enu_about(PLACE_DEG, fix.lat_deg or 0.0, fix.lon_deg or 0.0, fix.h_m or 0.0)))


@pytest.mark.parametrize("method", ["original", "remove", "adjust", "robust"])
def test_what_both_places_share_cancels(method: Method) -> None:
    plain, corrected = informed(method), informed(method)
    assert corrected.correct_by(corrections(START_S)) == ""
    fix, verdicts = answer(corrected, rover(START_S))
    assert off_m(answer(plain, rover(START_S))[0]) > 1.0
    # The filter's own first position is as good as the single epoch that it starts from.
    assert off_m(fix) < EXACT_M
    assert fix.satellites_corrected == fix.satellites_used > 8
    assert max(one.correction_age_s or 0.0 for one in verdicts.values()) < CLOCKS_S
    assert all(one.correction_age_s is not None for one in verdicts.values() if one.used)


def test_a_correction_is_carried_forward_by_its_rate() -> None:
    made = corrections(START_S)
    moving = msgspec.structs.replace(
        made,
        satellites=tuple(
            msgspec.structs.replace(one, correction_m=one.correction_m - 10.0 * k * 0.1, rate_mps=0.1 * k)
            for k, one in enumerate(made.satellites)
        ),
    )
    correction = informed()
    correction.correct_by(moving)
    assert off_m(answer(correction, rover(START_S + 10.0))[0]) < EXACT_M


def test_old_corrections_are_not_used() -> None:
    correction = informed(longest_correction_age_s=20.0)
    correction.correct_by(corrections(START_S))
    fresh, _ = answer(correction, rover(START_S + 19.9))
    assert (fresh.satellites_corrected > 0, fresh.reason) == (True, "")
    stale, verdicts = answer(correction, rover(START_S + 21.0))
    assert stale.satellites_corrected == 0
    assert stale.reason == "no corrections: the last are 21 s old"
    assert all(one.correction_age_s is None for one in verdicts.values())


def test_corrections_of_the_future_are_not_used() -> None:
    correction = informed()
    correction.correct_by(corrections(START_S + 5.0))
    fix, _ = answer(correction, rover(START_S))
    assert (fix.satellites_corrected, fix.reason) == (0, "no corrections yet")
    assert answer(correction, rover(START_S + 5.0))[0].satellites_corrected > 0


def renewed(sky: list[Ephemeris], satellites: tuple[str, ...]) -> list[Ephemeris]:
    """The sky with another issue, and another clock, for some satellites."""
    return [
        msgspec.structs.replace(one, issue=one.issue + 1, clock_bias_s=one.clock_bias_s + 1e-8)
        if one.satellite in satellites
        else one
        for one in sky
    ]


def test_a_correction_for_another_ephemeris_is_not_used() -> None:
    names = base(START_S).satellites[:2]
    correction = informed(sky=renewed(SKY, names))
    correction.correct_by(corrections(START_S))
    fix, verdicts = answer(correction, rover(START_S))
    assert off_m(fix) < EXACT_M
    for name in names:
        assert verdicts[name].used is False
        assert verdicts[name].reason.endswith("the correction is for ephemeris 7, used is 8")


def test_the_set_before_serves_where_the_new_one_is_for_a_newer_ephemeris() -> None:
    names = base(START_S).satellites[:2]
    correction = informed()
    correction.correct_by(corrections(START_S))
    correction.correct_by(corrections(START_S + 1.0, sky=renewed(SKY, names)))
    fix, verdicts = answer(correction, rover(START_S + 1.0))
    assert off_m(fix) < EXACT_M
    ages = {name: one.correction_age_s for name, one in verdicts.items() if one.used}
    assert all(ages[name] == pytest.approx(1.0, abs=CLOCKS_S) for name in names)
    assert ages[base(START_S).satellites[2]] == pytest.approx(0.0, abs=CLOCKS_S)


def test_a_correction_of_another_signal_is_not_used() -> None:
    made = corrections(START_S)
    first, *others = made.satellites
    correction = informed()
    correction.correct_by(
        msgspec.structs.replace(made, satellites=(msgspec.structs.replace(first, signal="1X"), *others))
    )
    _, verdicts = answer(correction, rover(START_S))
    assert verdicts[first.satellite].reason.endswith("corrected is 1X, measured 1C")


def found_m(reason: str) -> float:
    """Distance in a reason."""
    return float(reason.split("stand ")[1].split(" m", maxsplit=1)[0])


@pytest.mark.parametrize("east_deg", [0.0011, -0.0011])
def test_a_station_that_is_a_hundred_metres_away_corrects_nothing(east_deg: float) -> None:
    elsewhere = (BASE_DEG[0], BASE_DEG[1] + east_deg, BASE_DEG[2])
    made = corrections(START_S, place_deg=elsewhere)
    assert made.satellites == ()
    assert found_m(next(one.reason for one in made.refused if "seems" in one.reason)) == pytest.approx(100.0, abs=5.0)


def carried_off(made: Corrections, north_m: float) -> Corrections:
    """Corrections of a station that believes itself elsewhere and does not notice."""
    lat_deg = made.lat_deg + np.degrees(north_m / 6.36e6)
    place_m = station_at(float(lat_deg), made.lon_deg, made.h_m).place_m
    ranges = [
        np.linalg.norm(position - place_m) - np.linalg.norm(position - BASE_M) for position in satellite_places(made)
    ]
    satellites = tuple(
        msgspec.structs.replace(one, correction_m=one.correction_m + longer)
        for one, longer in zip(made.satellites, ranges, strict=True)
    )
    return msgspec.structs.replace(made, satellites=satellites, lat_deg=lat_deg)


def satellite_places(made: Corrections) -> np.ndarray:
    corrected = informed().epoch(base(START_S))
    rows = {int(row["satellite"]): row for row in corrected.prepared.rows}
    codes = [100 * "GRECJSI".index(one.satellite[0]) + int(one.satellite[1:]) for one in made.satellites]
    return np.array([[rows[code][name] for name in ("x_m", "y_m", "z_m")] for code in codes])


def test_a_receiver_does_not_believe_a_station_that_moved() -> None:
    correction = informed()
    correction.correct_by(carried_off(corrections(START_S), 100.0))
    fix, _ = answer(correction, rover(START_S))
    assert fix.satellites_corrected == 0
    assert fix.reason.startswith("corrections refused: the station seems to stand ")
    # Some metres of what the satellites' own errors feign.
    assert found_m(fix.reason) == pytest.approx(100.0, abs=5.0)
    # The same corrections with the place at which they hold are believed: it is the place that was wrong.
    correction = informed()
    correction.correct_by(carried_off(corrections(START_S), 0.0))
    assert answer(correction, rover(START_S))[0].satellites_corrected > 8


def test_a_biased_satellite_of_the_base_is_left_out() -> None:
    made = corrections(START_S, extra_m={"G05": 0.0})
    victim = max(made.satellites, key=lambda one: one.elevation_rad)
    biased = corrections(START_S, extra_m={victim.satellite: 60.0})
    assert victim.satellite not in {one.satellite for one in biased.satellites}
    assert "contradicts the other satellites" in next(
        one.reason for one in biased.refused if one.satellite == victim.satellite
    )


def test_a_receiver_leaves_out_a_biased_correction() -> None:
    made = corrections(START_S)
    victim = max(made.satellites, key=lambda one: one.elevation_rad)
    satellites = tuple(
        msgspec.structs.replace(one, correction_m=one.correction_m + 60.0) if one is victim else one
        for one in made.satellites
    )
    correction = informed()
    correction.correct_by(msgspec.structs.replace(made, satellites=satellites))
    fix, verdicts = answer(correction, rover(START_S))
    assert off_m(fix) < EXACT_M
    assert "contradicts the others" in verdicts[victim.satellite].reason


def test_few_corrections_are_not_mixed_with_uncorrected_satellites() -> None:
    made = corrections(START_S)
    correction = informed()
    correction.correct_by(msgspec.structs.replace(made, satellites=made.satellites[:3]))
    fix, _ = answer(correction, rover(START_S))
    assert (fix.status, fix.satellites_corrected) == ("fix", 0)
    assert fix.reason.startswith("corrections refused: too few")


def test_one_station_at_a_time_and_none_twice() -> None:
    table = CorrectionTable(30.0)
    made = corrections(START_S)
    assert table.add(made) == ""
    assert table.add(made) == "repeated or late"
    other = msgspec.structs.replace(made, station="W2", tow_s=made.tow_s + 5.0)
    assert table.add(other) == "station W1 speaks already"
    assert table.add(msgspec.structs.replace(other, tow_s=made.tow_s + 31.0)) == ""


@pytest.mark.parametrize(
    "changes", [{"lat_deg": float("nan")}, {"lat_deg": 91.0}, {"h_m": 1e6}, {"tow_s": float("inf")}]
)
def test_senseless_places_and_times_are_refused(changes: dict[str, float]) -> None:
    made = msgspec.structs.replace(corrections(START_S), **changes)
    assert CorrectionTable(30.0).add(made).startswith("the station")


def test_blocks_and_single_epochs_say_the_same() -> None:
    epochs = [rover(START_S + k) for k in range(4)]
    fixes = []
    for _ in range(2):
        correction = informed("robust")
        for k in range(4):
            correction.correct_by(corrections(START_S + k))
        fixes.append([answer(correction, epoch)[0] for epoch in epochs])
    assert fixes[0] == fixes[1]
    assert all(fix.satellites_corrected > 8 for fix in fixes[0])
