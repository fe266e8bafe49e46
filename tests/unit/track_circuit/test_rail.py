"""The rail against closed forms and against measured attenuations."""

from __future__ import annotations

import numpy as np
import pytest

from services.track_circuit.rail import (
    Rail,
    ballast_estimate,
    level_db,
    propagation,
    transfer,
)

RAIL = Rail()


@pytest.mark.parametrize(("ballast", "db_per_km"), [(0.01, 6.0), (0.1, 19.2), (0.5, 43.0)])
def test_attenuation_is_that_of_real_track(ballast: float, db_per_km: float) -> None:
    per_km, _ = propagation(RAIL, 12_000.0, ballast)
    # The figures are rounded, and their inductance to one place: 3 %.
    assert 20.0 / np.log(10.0) * per_km.real == pytest.approx(db_per_km, rel=0.03)


def test_dry_to_wet_and_a_poor_shunt_move_the_level_as_known() -> None:
    dry, wet = level_db(transfer(RAIL, 12_000.0, 1.0, np.array([0.01, 0.5])))
    assert dry - wet == pytest.approx(21.5, abs=0.5)
    low_dry, low_wet = level_db(transfer(RAIL, 2300.0, 1.0, np.array([0.01, 0.5])))
    assert low_dry - low_wet == pytest.approx(6.4, abs=0.2)
    places = np.linspace(0.0, 1.0, 101)
    shunted = level_db(transfer(RAIL, 12_000.0, 1.0, 0.01, shunt_ohm=0.5, shunt_km=places))
    assert (dry - shunted).min() == pytest.approx(9.6, abs=0.2)


def test_without_leakage_the_circuit_is_a_divider() -> None:
    found = transfer(RAIL, 1000.0, 1.0, 1e-12)
    series = 0.9 + 2j * np.pi * 1000.0 * 1.3e-3
    assert complex(found) == pytest.approx(2.0 / (1.0 + 2.0 + series), rel=1e-9)


def test_a_shunt_at_the_receiver_is_parallel_to_it() -> None:
    by_shunt = transfer(RAIL, 5000.0, 0.7, 0.1, shunt_ohm=2.0, shunt_km=0.7)
    by_load = transfer(Rail(receiving_ohm=1.0), 5000.0, 0.7, 0.1)
    assert complex(by_shunt) == pytest.approx(complex(by_load), rel=1e-12)


def test_pieces_of_line_are_one_line() -> None:
    whole = transfer(RAIL, 5000.0, 1.0, 0.1)
    cut = transfer(RAIL, 5000.0, 1.0, 0.1, shunt_ohm=1e12, shunt_km=0.37)
    assert complex(cut) == pytest.approx(complex(whole), rel=1e-9)


def test_a_broken_rail_loses_more_than_any_train() -> None:
    for place in (0.0, 0.5, 1.0):
        loss_db = level_db(transfer(RAIL, 12_000.0, 1.0, 0.1)) - level_db(
            transfer(RAIL, 12_000.0, 1.0, 0.1, broken_km=place)
        )
        assert float(loss_db) > 35.0


def test_tuned_units_put_the_band_edges_down() -> None:
    hz = np.array([9600.0, 12_000.0, 14_400.0])
    plain, tuned = transfer(RAIL, hz, 0.01, 0.01), transfer(Rail(tuned_q=4.0), hz, 0.01, 0.01)
    lower, middle, upper = level_db(tuned / plain)
    # 1 + (Q (f/f0 - f0/f))^2 twice: Q 0.45 = 1.8 below and Q 0.3667 = 1.467 above.
    assert middle == pytest.approx(0.0, abs=1e-9)
    assert lower == pytest.approx(-20.0 * np.log10(1.0 + 1.8**2), abs=1e-6)
    assert upper == pytest.approx(-20.0 * np.log10(1.0 + (4.0 * (1.2 - 1.0 / 1.2)) ** 2), abs=1e-6)


def test_leakage_is_read_off_the_level() -> None:
    dry, wet = level_db(transfer(RAIL, 12_000.0, 1.0, np.array([0.01, 0.2])))
    found = ballast_estimate(RAIL, 12_000.0, 1.0, float(wet), float(dry))
    # Between points of the grid the level is taken as straight: 2 %.
    assert found == pytest.approx(0.2, rel=0.02)
    assert ballast_estimate(RAIL, 12_000.0, 1.0, float(dry) - 60.0, float(dry)) is None


def test_a_second_shunt_at_the_first_ones_place_is_both_in_parallel() -> None:
    hz = np.array([1700.0, 12_000.0])
    both = transfer(RAIL, hz, 1.0, 0.05, shunt_ohm=0.1, shunt_km=0.4, second_ohm=0.1, second_km=0.4)
    np.testing.assert_allclose(both, transfer(RAIL, hz, 1.0, 0.05, shunt_ohm=0.05, shunt_km=0.4), rtol=1e-12)
    apart = transfer(RAIL, hz, 1.0, 0.05, shunt_ohm=0.1, shunt_km=0.4, second_ohm=0.1, second_km=0.1)
    assert np.all(np.abs(apart) < np.abs(transfer(RAIL, hz, 1.0, 0.05, shunt_ohm=0.1, shunt_km=0.4)))
    with pytest.raises(ValueError, match="nearer to the sending end"):
        transfer(RAIL, hz, 1.0, 0.05, shunt_ohm=0.1, shunt_km=0.4, second_ohm=0.1, second_km=0.5)
