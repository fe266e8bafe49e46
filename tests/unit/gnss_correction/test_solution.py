"""Positions and velocities from measurements whose truth is known."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.gnss import Ephemeris, Epoch, Fix
from services.gnss_correction.fix_messages import fixes_of
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.settings import Config
from services.gnss_correction.verdict_messages import verdicts_of
from services.gnss_correction.weighting import cn0_variance_m2, elevation_variance_m2
from services.numerics.geodesy import ecef_from_geodetic, enu_about, enu_from_ecef_rotation
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, START_S, constellation, ephemeris, measured

GPS = constellation()
GALILEO = constellation("E", 24)
BEIDOU = constellation("C", 24)
EXACT_M = 2e-3
"""Sagnac to first order errs by 0.2 mm, delays at the wrong height by less; the rest is convergence to 0.1 mm."""


def informed(ephemerides: list[Ephemeris], config: Config | None = None) -> Correction:
    correction = Correction(config or Config(), ("original",))
    for one in ephemerides:
        correction.add(one)
    return correction


def fix_of(correction: Correction, epoch: Epoch) -> Fix:
    (fix,) = fixes_of(correction.epoch(epoch), "original")
    return fix


def off_by_m(fix: Fix, reference: tuple[float, float, float] = PLACE_DEG) -> float:
    assert fix.lat_deg is not None
    assert fix.lon_deg is not None
    assert fix.h_m is not None
    return float(np.linalg.norm(enu_about(reference, fix.lat_deg, fix.lon_deg, fix.h_m)))


def without(epoch: Epoch, keep: list[int]) -> Epoch:
    return msgspec.structs.replace(
        epoch,
        satellites=tuple(epoch.satellites[i] for i in keep),
        signals=tuple(epoch.signals[i] for i in keep),
        pseudorange_m=epoch.pseudorange_m[keep],
        carrier_phase_cycles=epoch.carrier_phase_cycles[keep],
        doppler_hz=epoch.doppler_hz[keep],
        cn0_dbhz=epoch.cn0_dbhz[keep],
        lock_lost=epoch.lock_lost[keep],
    )


@pytest.mark.parametrize("weights", ["cn0", "elevation"])
def test_exact_measurements_give_the_exact_place_from_the_centre_of_the_earth(weights: str) -> None:
    config = msgspec.convert({"weights": weights}, Config)
    fix = fix_of(informed(GPS, config), measured(GPS, START_S, clocks_m={"G": 12_345.6}))
    assert fix.status == "fix"
    assert off_by_m(fix) < EXACT_M
    assert fix.clock_bias_m == pytest.approx(12_345.6, abs=EXACT_M)
    assert fix.satellites_used >= 7
    assert fix.hdop is not None
    assert 0.5 < fix.hdop < 3.0
    assert fix.bound_m is None


@given(lat_deg=st.floats(-80.0, 80.0), lon_deg=st.floats(-180.0, 180.0), clock_m=st.floats(-2.9e5, 2.9e5))
@settings(max_examples=25)
def test_it_finds_any_place_on_earth(lat_deg: float, lon_deg: float, clock_m: float) -> None:
    place = np.array(ecef_from_geodetic(math.radians(lat_deg), math.radians(lon_deg), 0.0))
    epoch = measured(GPS, START_S, place_m=place, clocks_m={"G": clock_m})
    fix = fix_of(informed(GPS), epoch)
    if fix.status == "none":
        assert len(epoch.satellites) < 4 or "PDOP" in fix.reason
    else:
        # The made-up delays are those of PLACE_DEG: night ionosphere is alike everywhere, the troposphere differs by
        # its latitude term and height, centimetres at the mask, decimetres through the worst geometry.
        assert off_by_m(fix, (lat_deg, lon_deg, 0.0)) < 1.0


def test_velocity_from_doppler() -> None:
    rotation = enu_from_ecef_rotation(math.radians(PLACE_DEG[0]), math.radians(PLACE_DEG[1]))
    velocity = np.array([20.0, -10.0, 0.5])
    fix = fix_of(informed(GPS), measured(GPS, START_S, velocity_mps=rotation.T @ velocity))
    # Doppler was made by differences over a second, whose error is the orbits' third derivative.
    assert fix.ve_mps == pytest.approx(velocity[0], abs=1e-3)
    assert fix.vn_mps == pytest.approx(velocity[1], abs=1e-3)
    assert fix.vu_mps == pytest.approx(velocity[2], abs=1e-3)


def test_without_doppler_there_is_a_place_and_no_velocity() -> None:
    epoch = measured(GPS, START_S)
    silent = msgspec.structs.replace(epoch, doppler_hz=np.full(len(epoch.satellites), np.nan))
    fix = fix_of(informed(GPS), silent)
    assert fix.status == "fix"
    assert (fix.ve_mps, fix.vn_mps, fix.vu_mps) == (None, None, None)


def test_constellations_may_keep_different_times() -> None:
    everything = GPS + GALILEO + BEIDOU
    # 30 m are 100 ns: the receiver's stamp moves by less than a satellite moves in a micrometre.
    epoch = measured(everything, START_S, clocks_m={"G": 0.0, "E": 30.0, "C": -75.0})
    fix = fix_of(informed(everything), epoch)
    assert off_by_m(fix) < EXACT_M
    assert fix.satellites_used == len(epoch.satellites)


def test_a_satellite_alone_in_its_system_neither_helps_nor_harms() -> None:
    alone = [one for one in GALILEO if one.satellite in measured(GALILEO, START_S).satellites][:1]
    epoch = measured(GPS, START_S)
    both = measured(GPS + alone, START_S, clocks_m={"E": 5_000.0})
    plain, mixed = fix_of(informed(GPS), epoch), fix_of(informed(GPS + alone), both)
    assert mixed.lat_deg == plain.lat_deg
    assert mixed.satellites_used == plain.satellites_used
    (verdicts,) = verdicts_of(informed(GPS + alone, Config(method="original")).epoch(both))
    last = {one.satellite: one for one in verdicts.satellites}[alone[0].satellite]
    assert (last.used, last.reason) == (False, "alone in its system")


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (0, "0 usable of 0 satellites, 4 needed"),
        (1, "0 usable of 1 satellites, 4 needed (1 alone in its system)"),
        (2, "2 usable of 2 satellites, 4 needed"),
        (3, "3 usable of 3 satellites, 4 needed"),
    ],
)
def test_fewer_than_four_satellites_make_no_fix(count: int, words: str) -> None:
    fix = fix_of(informed(GPS), without(measured(GPS, START_S), list(range(count))))
    assert fix.status == "none"
    assert fix.reason == words
    assert (fix.lat_deg, fix.clock_bias_m, fix.sigma_horizontal_m, fix.satellites_used) == (None, None, None, 0)


def test_four_satellites_make_a_fix() -> None:
    epoch = measured(GPS, START_S)
    best = min(
        (fix_of(informed(GPS), without(epoch, [0, a, b, c])) for a in (1, 2) for b in (3, 4) for c in (5, 6)),
        key=lambda fix: fix.hdop or math.inf,
    )
    assert best.satellites_used == 4
    assert off_by_m(best) < 10 * EXACT_M


def low_in_the_south(epoch: Epoch, fix: Correction) -> list[int]:
    (verdicts,) = verdicts_of(fix.epoch(epoch))
    place = {one.satellite: one for one in verdicts.satellites}
    azimuths = [place[name].azimuth_rad or 0.0 for name in epoch.satellites]
    return sorted(range(len(azimuths)), key=lambda i: abs(azimuths[i] - math.pi))[:4]


def test_weak_geometry_makes_no_fix_and_says_so() -> None:
    epoch = measured(GPS, START_S)
    huddled = without(epoch, low_in_the_south(epoch, informed(GPS, Config(method="original"))))
    fix = fix_of(informed(GPS, Config(most_pdop=2.0)), huddled)
    assert fix.status == "none"
    assert fix.reason.startswith("weak geometry: PDOP ")
    assert fix.reason.endswith("over the limit of 2")


def test_weak_geometry_is_helped_by_a_height_that_is_not_too_old() -> None:
    config = Config(most_pdop=5.0, longest_height_hold_s=30.0)
    keep = low_in_the_south(measured(GPS, START_S), informed(GPS, Config(method="original")))
    for age_s, held in ((10.0, True), (31.0, False)):
        correction = informed(GPS, config)
        assert fix_of(correction, measured(GPS, START_S)).status == "fix"
        fix = fix_of(correction, without(measured(GPS, START_S + age_s), keep))
        if held:
            assert fix.status == "fix"
            assert fix.reason.endswith(f"height held from {age_s:.1f} s before")
            assert off_by_m(fix) < 0.1, "the height held is the true one, as are the measurements"
        else:
            assert (fix.status, fix.reason[:13]) == ("none", "weak geometry")


def test_a_singular_geometry_makes_no_fix() -> None:
    one = GPS[0]
    twins = [ephemeris(f"G{number:02d}", one.orbit) for number in range(1, 6)]
    place = measured([one], START_S, lowest_rad=-2.0)
    epoch = measured(twins, START_S, lowest_rad=-2.0)
    assert len(place.satellites) == 1
    fix = fix_of(informed(twins), epoch)
    assert fix.status == "none"


def test_the_mask_leaves_low_satellites_out() -> None:
    epoch = measured(GPS, START_S)
    config = Config(method="original", elevation_mask_deg=30.0)
    (verdicts,) = verdicts_of(informed(GPS, config).epoch(epoch))
    for one in verdicts.satellites:
        assert one.elevation_rad is not None
        assert one.used == (one.elevation_rad >= math.radians(30.0))
        assert one.used or one.reason == (f"elevation {math.degrees(one.elevation_rad):.1f}° below the mask of 30°")


def test_weak_signals_are_left_out() -> None:
    epoch = measured(GPS, START_S)
    cn0 = epoch.cn0_dbhz.copy()
    cn0[2] = 20.0
    correction = informed(GPS, Config(method="original", cn0_mask_dbhz=25.0))
    (verdicts,) = verdicts_of(correction.epoch(msgspec.structs.replace(epoch, cn0_dbhz=cn0)))
    assert verdicts.satellites[2].reason == "20 dB-Hz below the mask of 25 dB-Hz"
    assert sum(not one.used for one in verdicts.satellites) == 1


def test_a_weak_signal_counts_for_less() -> None:
    epoch = measured(GPS, START_S)
    pseudorange, cn0 = epoch.pseudorange_m.copy(), epoch.cn0_dbhz.copy()
    pseudorange[3] += 40.0
    cn0[3] = 22.0
    reflected = msgspec.structs.replace(epoch, pseudorange_m=pseudorange, cn0_dbhz=cn0)
    by_cn0 = off_by_m(fix_of(informed(GPS, Config(weights="cn0")), reflected))
    by_elevation = off_by_m(fix_of(informed(GPS, Config(weights="elevation")), reflected))
    assert by_cn0 < 0.1 * by_elevation


def test_one_pseudorange_kilometres_off_is_found_and_left_out() -> None:
    epoch = measured(GPS, START_S)
    pseudorange = epoch.pseudorange_m.copy()
    pseudorange[4] -= 389_000.0
    correction = informed(GPS, Config(method="original"))
    corrected = correction.epoch(msgspec.structs.replace(epoch, pseudorange_m=pseudorange))
    (fix,), (verdicts,) = fixes_of(corrected, "original"), verdicts_of(corrected)
    assert off_by_m(fix) < EXACT_M
    assert verdicts.satellites[4].reason == "contradicts the other satellites by 389.0 km"
    assert fix.satellites_used == len(epoch.satellites) - 1


def test_contradictions_that_nobody_can_resolve_make_no_fix() -> None:
    epoch = measured(GPS, START_S)
    five = without(epoch, [0, 1, 3, 4, 6])
    pseudorange = five.pseudorange_m.copy()
    pseudorange[2] += 400_000.0
    fix = fix_of(informed(GPS), msgspec.structs.replace(five, pseudorange_m=pseudorange))
    assert fix.status == "none"
    assert fix.reason.startswith("pseudoranges contradict each other")


def test_the_standard_deviation_is_that_of_the_weights_and_grows_with_the_residuals() -> None:
    epoch = measured(GPS, START_S)
    clean = fix_of(informed(GPS), epoch)
    noise = np.random.default_rng(1).normal(0.0, 20.0, len(epoch.satellites))
    noisy = fix_of(informed(GPS), msgspec.structs.replace(epoch, pseudorange_m=epoch.pseudorange_m + noise))
    assert clean.sigma_horizontal_m is not None
    assert noisy.sigma_horizontal_m is not None
    # At 45 dB-Hz a pseudorange is good for a metre or two; 20 m of noise are more than ten times that.
    assert 0.3 < clean.sigma_horizontal_m < 3.0
    assert noisy.sigma_horizontal_m > 5.0 * clean.sigma_horizontal_m


def test_errors_spread_as_the_standard_deviation_says() -> None:
    rng = np.random.default_rng(7)
    epoch = measured(GPS, START_S)
    (verdicts,) = verdicts_of(informed(GPS, Config(method="original")).epoch(epoch))
    sigma = np.sqrt([cn0_variance_m2(one.elevation_rad or 0.0, 45.0) for one in verdicts.satellites])
    squares, said = [], []
    for _ in range(300):
        noise = sigma * rng.standard_normal(sigma.size)
        fix = fix_of(informed(GPS), msgspec.structs.replace(epoch, pseudorange_m=epoch.pseudorange_m + noise))
        east, north, _up = enu_about(PLACE_DEG, fix.lat_deg or 0.0, fix.lon_deg or 0.0, fix.h_m or 0.0)
        squares.append(east**2 + north**2)
        said.append((fix.sigma_horizontal_m or 0.0) ** 2)
    # The factor of the residuals is never below one, so that what is said is a little more than what is.
    assert 0.9 < np.mean(said) / np.mean(squares) < 2.0


def test_variances_fall_with_elevation_and_strength() -> None:
    for low, high in ((0.1, 0.5), (0.5, 1.5)):
        assert elevation_variance_m2(low) > elevation_variance_m2(high)
        assert cn0_variance_m2(low, 40.0) > cn0_variance_m2(high, 40.0)
    assert cn0_variance_m2(math.pi / 2, 40.0) == pytest.approx(1.0)
    assert cn0_variance_m2(math.pi / 2, 30.0) == pytest.approx(10.0)
    assert cn0_variance_m2(1.0, math.nan) == cn0_variance_m2(1.0, 35.0)


def test_a_moved_receiver_is_found_again() -> None:
    correction = informed(GPS)
    assert fix_of(correction, measured(GPS, START_S)).status == "fix"
    elsewhere = (-33.0, 151.0, 20.0)
    place = np.array(ecef_from_geodetic(math.radians(elsewhere[0]), math.radians(elsewhere[1]), elsewhere[2]))
    fix = fix_of(correction, measured(GPS, START_S + 60.0, place_m=place))
    # Troposphere of another latitude: see above.
    assert off_by_m(fix, elsewhere) < 1.0
