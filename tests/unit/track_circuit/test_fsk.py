"""Frequency-coded circuits: every code comes back, neighbours and bare tones do not pass, noise is silent."""

from __future__ import annotations

import numpy as np
import pytest

from services.track_circuit.code_table import CODES_HZ, Code, CodeTable, table_for
from services.track_circuit.fsk import band_level_db, comb, decode, keyed, strongest
from services.track_circuit.profile import Profile

RATE_HZ = 8000.0
COUNT = 16_000
TABLE = CodeTable()


@pytest.mark.parametrize("offset_hz", [0.0, 1.4, -1.3])
def test_every_code_on_every_carrier_is_decoded(offset_hz: float) -> None:
    for number, code_hz in enumerate(CODES_HZ):
        nominal_hz = TABLE.carriers_hz[number % 4]
        found = decode(
            0.1 * keyed(nominal_hz + offset_hz, code_hz, 11.0, RATE_HZ, COUNT, 0.123), RATE_HZ, nominal_hz, TABLE
        )
        assert (found.state, found.code_hz) == ("good", code_hz)
        # The carrier is sought on a grid of 0.05 Hz.
        assert found.carrier_hz == pytest.approx(nominal_hz + offset_hz, abs=0.051)
        # 0.1 is -23.0 dB; the comb of seven lines leaves out less than 0.1 dB.
        assert found.level_db == pytest.approx(-23.01, abs=0.1)


def test_the_lines_of_a_coded_carrier_hold_its_power() -> None:
    for code_hz in CODES_HZ:
        # Seven lines hold all but what lies beyond the third: under 1 % down to a code of 10.3 Hz.
        assert sum(abs(line) ** 2 for line in comb(11.0, code_hz)) == pytest.approx(1.0, abs=0.01)


def test_a_slow_code_swings_between_two_carriers() -> None:
    # With shift = code the phase turns by half a turn per half period: c_0 = 2 / (pi) j, from the integral.
    assert abs(comb(11.0, 11.0)[3]) == pytest.approx(2.0 / np.pi, abs=1e-3)


def test_a_bare_tone_is_no_code() -> None:
    tone = 0.1 * np.cos(2.0 * np.pi * 2301.4 * np.arange(COUNT) / RATE_HZ)
    noise = np.random.default_rng(1).normal(0.0, 0.01, COUNT)
    for samples in (tone, tone + noise):
        found = decode(samples, RATE_HZ, 2300.0, TABLE)
        assert (found.state, found.code_hz) == ("doubtful", None)


def test_a_code_between_two_of_the_table_is_named_as_unknown() -> None:
    found = decode(keyed(2301.4, 16.35, 11.0, RATE_HZ, COUNT), RATE_HZ, 2300.0, TABLE)
    assert found.state == "unknown_code"
    assert found.code_hz == pytest.approx(16.35, abs=0.06)


def test_a_carrier_between_those_of_the_table_is_doubtful() -> None:
    assert decode(keyed(2302.6, 16.9, 11.0, RATE_HZ, COUNT), RATE_HZ, 2300.0, TABLE).state == "doubtful"


def test_noise_decodes_to_nothing() -> None:
    rng = np.random.default_rng(2)
    states = [decode(rng.normal(0.0, 0.1, COUNT), RATE_HZ, 1700.0, TABLE).state for _ in range(40)]
    # About one window in 200 has a line of 12 times the noise, which is doubtful; a good one has odds of 2e-8.
    assert states.count("good") == 0
    assert states.count("no_signal") >= 36


def test_in_strong_noise_nothing_wrong_is_said() -> None:
    rng = np.random.default_rng(3)
    for power in (1.0, 4.0):
        for number in range(12):
            code_hz = CODES_HZ[(5 * number) % 18]
            noise = rng.normal(0.0, np.sqrt(20.0 * power), COUNT)
            found = decode(keyed(2301.4, code_hz, 11.0, RATE_HZ, COUNT, rng.random()) + noise, RATE_HZ, 2300.0, TABLE)
            assert found.state != "good" or found.code_hz == code_hz


def test_a_neighbour_on_the_next_carrier_may_be_much_louder() -> None:
    ours = 0.01 * keyed(2001.4, 20.2, 11.0, RATE_HZ, COUNT)
    theirs = 0.8 * keyed(2298.7, 13.6, 11.0, RATE_HZ, COUNT)
    found = decode(ours + theirs, RATE_HZ, 2000.0, TABLE)
    assert (found.state, found.code_hz) == ("good", 20.2)
    both = [decode(ours + theirs, RATE_HZ, hz, TABLE) for hz in TABLE.carriers_hz]
    assert strongest(both).code_hz == 13.6


def test_mains_harmonics_around_the_carrier_do_no_harm() -> None:
    t_s = np.arange(COUNT) / RATE_HZ
    comb_50 = sum(0.05 * np.cos(2.0 * np.pi * 50.0 * k * t_s + k) for k in range(1, 60))
    found = decode(0.1 * keyed(1701.4, 11.4, 11.0, RATE_HZ, COUNT) + comb_50, RATE_HZ, 1700.0, TABLE)
    assert (found.state, found.code_hz) == ("good", 11.4)


def test_short_windows_and_slow_rates_are_refused() -> None:
    with pytest.raises(ValueError, match="too short"):
        decode(np.zeros(8000), RATE_HZ, 1700.0, TABLE)
    with pytest.raises(ValueError, match="cannot carry"):
        decode(np.zeros(8000), 4000.0, 2000.0, TABLE)


def test_silence_is_no_signal() -> None:
    assert decode(np.zeros(COUNT), RATE_HZ, 1700.0, TABLE).state == "no_signal"


def test_level_of_the_band_is_the_carriers() -> None:
    samples = 0.5 * keyed(2301.4, 16.9, 11.0, RATE_HZ, 2000) + 0.5 * np.cos(
        2.0 * np.pi * 1000.0 * np.arange(2000) / RATE_HZ
    )
    # 0.5 is -9.03 dB; a quarter of a second holds four swings, which moves the weighted mean by some tenths.
    assert band_level_db(samples, RATE_HZ, 2300.0, 90.0) == pytest.approx(-9.03, abs=0.3)


def test_tables_are_checked_and_keep_meanings() -> None:
    with pytest.raises(ValueError, match="closer"):
        CodeTable(codes=(Code(hz=10.0), Code(hz=10.4)))
    table = CodeTable(codes=tuple(Code(hz=hz, meaning="stop" if hz == 29.0 else "") for hz in CODES_HZ))
    assert table.meaning_of(28.9) == "stop"
    own = table_for(Profile(scheme="fsk", tones_hz=(29.0, 40.0), carriers_hz=(500.0,), shift_hz=8.0), table)
    assert [code.meaning for code in own.codes] == ["stop", ""]
    assert (own.carriers_hz, own.shift_hz) == ((500.0,), 8.0)
