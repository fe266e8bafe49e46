from __future__ import annotations

import pytest

from schemas.radio import Cause, Weather
from services.radio_anomaly.cause import Circumstances, cause_of, snowing

SNOW = Weather(t_ns=0, axis_m=0.0, temperature_c=-2.0, snow_mm_per_h=1.0)
DRY = Weather(t_ns=0, axis_m=0.0, temperature_c=8.0)


@pytest.mark.parametrize(
    ("seen", "cause"),
    [
        (Circumstances(kind="above", length_m=500.0), "interference"),
        (Circumstances(kind="above", length_m=500.0, power_db=9.0, decoded_db=-6.0), "interference"),
        (Circumstances(kind="above", length_m=500.0, power_db=9.0, decoded_db=9.0), "unknown"),
        (Circumstances(kind="above", length_m=500.0, power_db=9.0, transmit_db=8.0), "device"),
        (Circumstances(kind="below", length_m=500.0, power_db=-9.0, decoded_db=-9.0), "obstruction"),
        (Circumstances(kind="below", length_m=500.0, power_db=-0.5, decoded_db=-8.0), "interference"),
        (
            Circumstances(kind="missing", length_m=500.0, power_db=0.5, received_ratio=0.4, normal_ratio=1.0),
            "interference",
        ),
        (
            Circumstances(kind="missing", length_m=500.0, received_ratio=0.4, normal_ratio=1.0, strength_db=20.0),
            "interference",
        ),
        (
            Circumstances(kind="missing", length_m=500.0, received_ratio=0.4, normal_ratio=1.0, strength_db=1.0),
            "obstruction",
        ),
        (Circumstances(kind="missing", length_m=500.0, received_ratio=0.0), "unknown"),
        (Circumstances(kind="below", length_m=4000.0, power_db=-8.0, weather=SNOW), "snow"),
        (Circumstances(kind="below", length_m=4000.0, power_db=-8.0, weather=DRY), "unknown"),
        (Circumstances(kind="below", length_m=200.0, power_db=-8.0, weather=SNOW), "obstruction"),
        (Circumstances(kind="below", length_m=4000.0, radio_share=0.95, radio_sections=40), "device"),
        (Circumstances(kind="below", length_m=4000.0, radio_share=0.95, radio_sections=4), "unknown"),
        (Circumstances(kind="below", length_m=9000.0, whole_line=True), "device"),
        (Circumstances(kind="below", length_m=100.0, at_site=True, other_share=0.9, other_radios=20), "interference"),
        (Circumstances(kind="below", length_m=100.0, at_site=True, other_share=0.1, other_radios=20), "unknown"),
        (Circumstances(kind="below", length_m=9000.0, power_db=-6.0, transmit_db=-6.0), "device"),
        (Circumstances(kind="above", length_m=1000.0, quantity="temperature"), "device"),
        (Circumstances(kind="above", length_m=1000.0, quantity="frequency"), "device"),
        (Circumstances(kind="below", length_m=1000.0, quantity="bits", power_db=0.2, decoded_db=-0.3), "interference"),
        (Circumstances(kind="below", length_m=1000.0, quantity="bits", power_db=-4.0, decoded_db=-4.0), "obstruction"),
        (Circumstances(kind="below", length_m=9e3, quantity="bits", power_db=0.0, whole_line=True), "device"),
        # At the edge of its range a radio loses frames by two decibels, and a fall of power explains its own losses.
        (
            Circumstances(kind="missing", length_m=200.0, power_db=-2.0, received_ratio=0.7, normal_ratio=0.9),
            "obstruction",
        ),
        (
            Circumstances(
                kind="below",
                length_m=9e3,
                decoded_db=-7.0,
                received_ratio=0.8,
                normal_ratio=1.0,
                strength_db=8.0,
                whole_line=True,
            ),
            "device",
        ),
    ],
)
def test_causes(seen: Circumstances, cause: Cause) -> None:
    found, words = cause_of(seen)
    assert found == cause
    assert words


def test_the_words_for_every_radio_falling_name_the_train() -> None:
    seen = Circumstances(
        kind="below", length_m=4000.0, radio_share=0.9, radio_sections=40, other_share=0.9, other_radios=4
    )
    assert "train" in cause_of(seen)[1]


def test_cold_rain_is_snow_and_warm_rain_is_not() -> None:
    cold = Weather(t_ns=0, axis_m=0.0, temperature_c=0.5, rain_mm_per_h=2.0)
    warm = Weather(t_ns=0, axis_m=0.0, temperature_c=6.0, rain_mm_per_h=2.0)
    assert snowing(cold)
    assert not snowing(warm)
    assert not snowing(None)
