"""Condition over days: trends are slopes, complaints come with what deserves them, and little is no trend."""

from __future__ import annotations

import pytest

from services.track_circuit.circuit_messages import circuit_health
from services.track_circuit.health import RECENT, HealthTrend
from services.track_circuit.rail import Rail, level_db, transfer
from services.track_circuit.settings import CircuitSettings

HOUR_S = 3600.0


def watched(hours: int, slope_db_per_day: float) -> HealthTrend:
    health = HealthTrend()
    for half_hour in range(2 * hours):
        t_s = half_hour * HOUR_S / 2.0
        health.clear_level(-20.0 + slope_db_per_day * t_s / 86_400.0, -15.0, t_s)
    return health


def test_the_trend_is_the_slope() -> None:
    assert watched(72, -2.0).trend_db_per_day() == pytest.approx(-2.0, rel=1e-6)
    assert watched(72, 0.0).trend_db_per_day() == pytest.approx(0.0, abs=1e-9)


def test_half_a_day_is_the_least_for_a_trend() -> None:
    assert watched(12, -2.0).trend_db_per_day() is None


def test_only_two_weeks_are_remembered() -> None:
    health = watched(24, -24.0)
    for hour in range(24, 24 + 15 * 24):
        health.clear_level(-44.0, -15.0, hour * HOUR_S)
    assert health.trend_db_per_day() == pytest.approx(0.0, abs=1e-6)


def test_complaints_name_what_is_wrong() -> None:
    assert watched(72, 0.0).complaints() == {}
    health = watched(72, -2.0)
    for k in range(RECENT):
        health.telegram(crc_ok=k % 3 > 0)
    for _ in range(200):
        health.drifted(0.8)
    found = health.complaints()
    assert sorted(found) == ["checks", "level", "taps"]
    assert "2.0 dB per day" in found["level"]
    assert f"17 of the last {RECENT}" in found["checks"]


def test_a_few_failed_checks_are_no_complaint() -> None:
    health = HealthTrend()
    for _ in range(5):
        health.telegram(crc_ok=False)
    assert health.complaints() == {}
    assert (health.telegrams, health.crc_failures) == (0, 5)


def test_leakage_is_told_where_the_length_is_known() -> None:
    rail = Rail()
    dry, wet = (float(level_db(transfer(rail, 12_000.0, 1.0, ballast))) for ballast in (0.01, 0.1))
    health = HealthTrend()
    for hour in range(3):
        health.clear_level(dry, -15.0, hour * HOUR_S)
    for second in range(2000):
        health.clear_level(wet, -15.0, 3.0 * HOUR_S + second)
    known = circuit_health(CircuitSettings(name="T1", length_m=1000.0), health, 3, 7)
    # Running means have come to within 1e-6 of the wet level; the table is straight between its points: 2 %.
    assert known.ballast_s_per_km == pytest.approx(0.1, rel=0.02)
    assert (known.stored_version, known.t_ns) == (3, 7)
    assert circuit_health(CircuitSettings(name="T1"), health, None, 7).ballast_s_per_km is None
