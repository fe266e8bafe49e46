from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.codec import encode
from schemas.gnss import Ephemeris, Fix, Ionosphere
from schemas.gnss_time import NS, WEEK_S, unix_ns_from_gps
from services.gnss_correction.atmosphere import LIGHT_MPS
from services.gnss_receiver.observations import Observations, observations_of
from services.numerics.geodesy import enu_about
from services.simulator.receiver import WAVELENGTH_M
from services.simulator.scenario import Scenario
from services.simulator.simulation import Instant, Simulation

Solve = Callable[[Observations, Sequence[Ephemeris], Ionosphere], list[Fix]]
START_NS = (2412 * WEEK_S + 190_800) * NS


def simulation(scenario: Scenario, seed: int = 7, start_ns: int = START_NS) -> Simulation:
    return Simulation(scenario, start_ns, np.random.default_rng(seed))


def take(scenario: Scenario, count: int, seed: int = 7) -> list[Instant]:
    one = simulation(scenario, seed)
    return [one.step() for _ in range(count)]


def fixes_of(solve: Solve, scenario: Scenario, instants: Sequence[Instant]) -> list[Fix]:
    sky = simulation(scenario).sky
    epochs = observations_of(instant.epoch for instant in instants)
    return solve(epochs, sky.ephemerides(START_NS), sky.ionosphere(START_NS))


def apart_m(fixes: Sequence[Fix], instants: Sequence[Instant]) -> NDArray[np.float64]:
    """East, north, up of the fixes from the truth."""
    first = instants[0].truth
    here, there = (
        enu_about((first.lat_deg, first.lon_deg, first.h_m), *zip(*places, strict=True))
        for places in (
            [(fix.lat_deg or 0.0, fix.lon_deg or 0.0, fix.h_m or 0.0) for fix in fixes],
            [(i.truth.lat_deg, i.truth.lon_deg, i.truth.h_m) for i in instants],
        )
    )
    return np.asarray(here - there)


@pytest.mark.parametrize("systems", ["G", "GE"])
def test_without_errors_the_solver_finds_the_truth(ideal: Scenario, solve: Solve, systems: str) -> None:
    scenario = msgspec.structs.replace(ideal, sky=msgspec.structs.replace(ideal.sky, systems=systems))
    # From the station at rest into the cruise: 300 epochs, a minute.
    instants = take(scenario, 300)
    fixes = fixes_of(solve, scenario, instants)
    # Both sides use one set of formulas; what differs is that the solver takes the atmosphere's delay for travel
    # time of the orbit (1e-4 m) and converges to 1e-4 m.
    assert np.abs(apart_m(fixes, instants)).max() < 1e-3


def test_doppler_gives_the_trains_velocity(ideal: Scenario, solve: Solve) -> None:
    instants = take(ideal, 400)
    fixes = fixes_of(solve, ideal, instants)
    east = [(fix.ve_mps or 0.0) - i.truth.ve_mps for fix, i in zip(fixes, instants, strict=True)]
    north = [(fix.vn_mps or 0.0) - i.truth.vn_mps for fix, i in zip(fixes, instants, strict=True)]
    # The air's share of the rates, up to 4 cm/s at 5 degrees of elevation, is not in the Dopplers.
    assert np.abs([east, north]).max() < 0.05
    assert instants[-1].truth.speed_mps == pytest.approx(18.0)


def test_doppler_is_how_fast_pseudorange_and_carrier_change(ideal: Scenario) -> None:
    instants = take(ideal, 300)
    for before, here, after in zip(instants, instants[1:], instants[2:], strict=False):
        assert before.epoch.satellites == here.epoch.satellites == after.epoch.satellites
        code = (after.epoch.pseudorange_m - before.epoch.pseudorange_m) / 0.4
        carrier = (after.epoch.carrier_phase_cycles - before.epoch.carrier_phase_cycles) / 0.4
        # The air as above; at the moments when acceleration sets in or ends a central difference over 0.4 s
        # is off by 0.7 m/s^2 times 0.05 s, and the clock's drift walks by 6e-11 times the speed of light.
        assert np.abs(code + here.epoch.doppler_hz * WAVELENGTH_M).max() < 0.1
        assert np.abs(carrier * WAVELENGTH_M + here.epoch.doppler_hz * WAVELENGTH_M).max() < 0.1


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(canyon: Scenario) -> None:
    first, again = (b"".join(encode(i.epoch) + encode(i.truth) for i in take(canyon, 150)) for _ in range(2))
    assert first == again
    assert encode(take(canyon, 1, seed=8)[0].epoch) != encode(take(canyon, 1)[0].epoch)


def test_a_clock_jump_moves_every_satellite_alike(canyon: Scenario) -> None:
    receiver = msgspec.structs.replace(canyon.receiver, clock_bias_s=4.99e-4, clock_drift=1e-6)
    instants = take(msgspec.structs.replace(canyon, receiver=receiver), 20)
    changes = [
        np.diff([before.epoch.pseudorange_m, after.epoch.pseudorange_m], axis=0)[0]
        for before, after in pairwise(instants)
    ]
    jumps = [i for i, change in enumerate(changes) if np.median(change) < -LIGHT_MPS * 0.9e-3]
    assert len(jumps) == 1
    at = jumps[0]
    both = [instants[at].epoch, instants[at + 1].epoch]
    # Within 0.2 s ranges change by less than 200 m, noise by some metres.
    assert np.abs(changes[at] + LIGHT_MPS * 1e-3).max() < 300.0
    assert np.abs(changes[at] - changes[at - 1] + LIGHT_MPS * 1e-3).max() < 5.0
    # Carrier and pseudorange jump together, the Doppler does not.
    carrier = (both[1].carrier_phase_cycles - both[0].carrier_phase_cycles) * WAVELENGTH_M
    assert np.abs(carrier - changes[at]).max() < 5.0
    assert np.abs(both[1].doppler_hz - both[0].doppler_hz).max() < 5.0


def test_among_buildings_signals_are_hidden_reflected_and_come_back(canyon: Scenario) -> None:
    instants = take(canyon, 700)
    street = [i for i in instants if i.truth.surroundings == "street canyon"]
    seen = {reception for i in street for reception in i.reception}
    assert seen == {"line_of_sight", "multipath", "reflected_only", "blocked"}
    # Before the first building comes within reach of a reflection.
    fields = [i for i in instants if i.truth.axis_m < 300.0]
    assert all(set(i.reception) == {"line_of_sight"} for i in fields)
    reflected = [
        error
        for i in street
        for satellite, error in zip(i.epoch.satellites, i.code_error_m, strict=True)
        if i.reception[i.visible.index(satellite)] == "reflected_only"
    ]
    # Reflections come late, but for the noise of weak signals (a metre) and for moments in which two of them
    # nearly cancel and pull the loop to either side.
    assert np.mean(reflected) > 3.0
    assert np.mean(np.array(reflected) > -3.0) > 0.97


def test_the_truth_is_where_the_train_is_on_the_axis(canyon: Scenario) -> None:
    one = simulation(canyon)
    for _ in range(600):
        instant = one.step()
    lat_deg, lon_deg, _ = one.plane.geodetic_deg(
        np.array([one.axis.at(instant.truth.axis_m).x_m[0], one.axis.at(instant.truth.axis_m).y_m[0], 4.0])
    )
    assert (instant.truth.lat_deg, instant.truth.lon_deg) == (float(lat_deg), float(lon_deg))
    assert instant.truth.t_ns == instant.epoch.t_ns == unix_ns_from_gps(2412, 190_800 + 599 * 0.2)
    assert np.hypot(instant.truth.ve_mps, instant.truth.vn_mps) == pytest.approx(abs(instant.truth.speed_mps))


def test_skipped_epochs_are_missing_and_nothing_else_is_wrong(ideal: Scenario, solve: Solve) -> None:
    one = simulation(ideal)
    one.step()
    assert one.skip_until(START_NS + 60 * NS) == 299
    assert one.skip_until(START_NS) == 0
    late = [one.step() for _ in range(5)]
    assert late[0].epoch.tow_s == 190_860.0
    fixes = fixes_of(solve, ideal, late)
    assert np.abs(apart_m(fixes, late)).max() < 1e-3  # as above


def test_epochs_cross_the_end_of_a_week(ideal: Scenario) -> None:
    one = simulation(ideal, start_ns=2413 * WEEK_S * NS - NS)
    epochs = [one.step().epoch for _ in range(7)]
    assert [(e.gps_week, e.tow_s) for e in epochs[4:6]] == [(2412, 604_799.8), (2413, 0.0)]
    satellites = set(epochs[0].satellites)
    assert all(set(e.satellites) == satellites for e in epochs)
    changes = np.diff([e.pseudorange_m for e in epochs], axis=0)
    # Range rates change by less than 0.2 m/s per second.
    assert np.abs(np.diff(changes, axis=0)).max() < 0.02
