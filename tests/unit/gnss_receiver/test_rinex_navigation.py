"""Navigation files: every system's time scale, health, group delay and age, and damaged records."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.gnss import Ephemeris, StateVectorOrbit
from schemas.gnss_time import unix_ns_from_gps
from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.rinex_navigation import parse_navigation
from services.gnss_receiver.rinex_navigation_records import figure as read_figure
from tests.unit.gnss_receiver.navigation_samples import (
    EXPECTED_GPS,
    FORMS,
    GLONASS,
    GPS,
    MIDNIGHT,
    Figures,
    changed,
    header_2,
    header_3,
    record_2,
    record_3,
)
from tests.unit.gnss_receiver.navigation_samples import figure as write_figure
from tests.unit.gnss_receiver.samples import header_line, text_of


def read(*parts: list[str]) -> Navigation:
    return parse_navigation([("a.nav", text_of(*parts))])


def one(name: str, figures: Figures, calendar: str = MIDNIGHT) -> Ephemeris:
    navigation = read(header_3(), record_3(name, calendar, figures))
    assert navigation.issues == ()
    (ephemeris,) = navigation.ephemerides
    return ephemeris


def complaint(*parts: list[str]) -> str:
    navigation = read(*parts)
    assert navigation.ephemerides == ()
    (issue,) = navigation.issues
    return str(issue)


@pytest.mark.parametrize("form", [*FORMS, ".D"])
def test_gps_in_every_exponent_form(form: str) -> None:
    for content in (
        text_of(header_3(), record_3("G01", MIDNIGHT, GPS, form)),
        text_of(header_2(), record_2(1, "16  6  6  0  0  0.0", GPS, form)),
    ):
        navigation = parse_navigation([("a.nav", content)])
        assert navigation.issues == ()
        assert navigation.ephemerides == (EXPECTED_GPS,)


@given(st.floats(-1e12, 1e12, allow_subnormal=False), st.sampled_from([*FORMS, ".D"]))
def test_figures_keep_what_is_written(value: float, form: str) -> None:
    value = value if abs(value) > 1e-90 else 0.0
    # Eleven digits at least are written; half a unit in the last of them.
    assert read_figure(write_figure(value, form)) == pytest.approx(value, rel=5.1e-12, abs=0.0)


@pytest.mark.parametrize("text", ["nan", "inf", "1_000", "0x1", "1.0E", "--1", "1 2", "1e300", "1,5"])
def test_what_is_no_figure_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"is no number|beyond every figure"):
        read_figure(text)


@pytest.mark.parametrize(
    ("written", "half_s"),
    [(0.0, 7200.0), (None, 7200.0), (4.0, 7200.0), (1.0, 10800.0), (6.0, 10800.0), (26.0, 46800.0), (999.0, 7200.0)],
)
def test_gps_fit_interval_in_hours_or_as_a_flag(written: float | None, half_s: float) -> None:
    assert one("G01", changed(GPS, 7, 1, written)).fit_interval_s == half_s


@pytest.mark.parametrize("written", [None, 0.9999e9, -9999.0, 500_000.0])
def test_an_unknown_transmission_time_gives_the_reference_time(written: float | None) -> None:
    assert one("G01", changed(GPS, 7, 0, written)).t_ns == unix_ns_from_gps(1900, 86400.0)


def test_reference_times_across_the_end_of_a_week() -> None:
    # The clock's reference is the last 16 s of week 1900, the orbit's the start of 1901.
    figures = changed(changed(changed(GPS, 3, 0, 0.0), 5, 2, 1901.0), 7, 0, 600_000.0)
    ephemeris = one("G01", figures, "2016 06 11 23 59 44")
    assert (ephemeris.gps_week, ephemeris.toe_s, ephemeris.toc_s) == (1901, 0.0, -16.0)
    assert ephemeris.t_ns == unix_ns_from_gps(1900, 600_000.0)
    # Sent before the end, so that the time is negative in the week of the record.
    assert one("G01", changed(figures, 7, 0, -4800.0), "2016 06 11 23 59 44") == ephemeris


@pytest.mark.parametrize("week", [1900.0, 876.0, 1901.0, 1899.0, None])
def test_weeks_may_be_modulo_1024_or_one_beside(week: float | None) -> None:
    assert one("G01", changed(GPS, 5, 2, week)) == EXPECTED_GPS


@pytest.mark.parametrize(
    ("system", "week", "gps_week", "toe_s"),
    [
        ("E", 1900.0, 1900, 86400.0),
        ("E", 876.0, 1900, 86400.0),
        ("J", 1900.0, 1900, 86400.0),
        ("C", 544.0, 1900, 86414.0),  # BeiDou weeks count from 1356; its time is 14 s behind
        ("C", 1900.0, 1900, 86414.0),
    ],
)
def test_reference_times_come_onto_gps_time(system: str, week: float, gps_week: int, toe_s: float) -> None:
    ephemeris = one(f"{system}05", changed(GPS, 5, 2, week))
    assert (ephemeris.gps_week, ephemeris.toe_s, ephemeris.toc_s) == (gps_week, toe_s, toe_s)
    assert ephemeris.t_ns == unix_ns_from_gps(1900, 83310.0 + (14 if system == "C" else 0))


def test_beidou_at_the_end_of_its_week() -> None:
    figures = changed(changed(changed(GPS, 3, 0, 604_790.0), 5, 2, 544.0), 7, 0, 604_790.0)
    ephemeris = one("C05", figures, "2016 06 11 23 59 50")
    assert (ephemeris.gps_week, ephemeris.toe_s, ephemeris.toc_s) == (1901, 4.0, 4.0)


@pytest.mark.parametrize(("system", "half_s"), [("E", 14400.0), ("C", 7200.0), ("J", 7200.0)])
def test_use_of_other_systems_is_limited(system: str, half_s: float) -> None:
    assert one(f"{system}05", changed(GPS, 5, 2, None)).fit_interval_s == half_s


@pytest.mark.parametrize(
    ("system", "source", "word", "healthy"),
    [
        ("G", 1.0, 0.0, True),
        ("G", 1.0, 63.0, False),
        ("G", 1.0, 1.0, False),
        ("J", 1.0, 0.0, True),
        ("J", 1.0, 1.0, True),  # L1C/B is not sent, and said to be unhealthy
        ("J", 1.0, 16.0, True),  # L1C/B is sent instead of L1C/A
        ("J", 1.0, 33.0, False),  # neither is well
        ("J", 1.0, 4.0, False),
        ("C", 0.0, 1.0, False),
        ("E", 517.0, 0.0, True),
        ("E", 517.0, 1.0, False),  # E1-B data not valid
        ("E", 517.0, 130.0, False),  # E1-B and E5b out of service
        ("E", 517.0, 16.0, True),  # E5a out of service
        ("E", 258.0, 16.0, False),
        ("E", 258.0, 1.0, True),
    ],
)
def test_health(system: str, source: float, word: float, healthy: bool) -> None:  # noqa: FBT001 - a parameter of the test
    figures = changed(changed(changed(GPS, 5, 1, source), 5, 2, None), 6, 1, word)
    assert one(f"{system}05", figures).healthy is healthy


@pytest.mark.parametrize(
    ("written", "accuracy_m", "healthy"),
    [(3.12, 3.12, True), (107.0, 3.12, True), (49.0, 0.49, True), (-1.0, None, False), (255.0, None, False)],
)
def test_galileo_accuracy_in_metres_or_as_an_index(written: float, accuracy_m: float | None, healthy: bool) -> None:  # noqa: FBT001 - a parameter of the test
    ephemeris = one("E05", changed(changed(GPS, 5, 1, 517.0), 6, 0, written))
    assert ephemeris.accuracy_m == accuracy_m
    assert ephemeris.healthy is healthy


def test_group_delays() -> None:
    delays = changed(changed(changed(GPS, 6, 2, 1e-9), 6, 3, 2e-9), 5, 2, None)
    assert one("J05", delays).group_delay_s == 1e-9
    assert one("C05", delays).group_delay_s == 1e-9
    assert one("E05", changed(delays, 5, 1, 517.0)).group_delay_s == 2e-9
    assert one("E05", changed(delays, 5, 1, 258.0)).group_delay_s == 1e-9


def test_inav_is_preferred_for_each_galileo_satellite() -> None:
    inav, fnav = changed(GPS, 5, 1, 517.0), changed(GPS, 5, 1, 258.0)
    other = changed(inav, 3, 0, 87000.0)
    navigation = read(
        header_3(),
        record_3("E05", MIDNIGHT, fnav),
        record_3("E05", MIDNIGHT, inav),
        record_3("E05", "2016 06 06 00 10 00", other),
        record_3("E07", MIDNIGHT, fnav),
    )
    found = [(each.satellite, each.toe_s, each.group_delay_s) for each in navigation.ephemerides]
    assert found == [("E05", 86400.0, 24.0), ("E05", 87000.0, 24.0), ("E07", 86400.0, GPS[6][2])]


@pytest.mark.parametrize("extra", [(), ((0.0, 0.0, 2.0, 0.0),)])
def test_glonass(extra: Figures) -> None:
    expected = Ephemeris(
        t_ns=unix_ns_from_gps(1900, 86430.0 + 17),
        satellite="R02",
        gps_week=1900,
        toe_s=87300.0 + 17,  # leap seconds in June 2016
        toc_s=87300.0 + 17,
        clock_bias_s=1.94282270968e-04,
        clock_drift=1.81898940355e-12,
        issue=13,  # 0:15 UTC is 3:15 in Moscow, the thirteenth quarter of an hour
        healthy=True,
        fit_interval_s=1800.0,
        orbit=StateVectorOrbit(
            position_m=(1000 * 5695.44824219, 1000 * 11500.3408203, 1000 * 22079.1704102),
            velocity_mps=(1000 * -1.38595867157, 1000 * 2.67567634582, 1000 * -1.04189395905),
            acceleration_mps2=(1000 * -9.31322574616e-10, 1000 * -9.31322574616e-10, 1000 * -2.79396772385e-09),
            frequency_channel=-4,
        ),
    )
    within_day = changed(GLONASS, 0, 2, 30.0)
    for content in (
        text_of(header_3(version="3.05"), record_3("R02", "2016 06 06 00 15 00", [*GLONASS, *extra])),
        text_of(header_2("G"), record_2(2, "16  6  6  0 15  0.0", within_day)),
    ):
        navigation = parse_navigation([("a.nav", content)])
        assert navigation.issues == ()
        assert navigation.ephemerides == (expected,)


@pytest.mark.parametrize(("written", "channel"), [(-7.0, -7), (6.0, 6), (252.0, -4)])
def test_glonass_channels_may_be_unsigned_bytes(written: float, channel: int) -> None:
    orbit = one("R02", changed(GLONASS, 2, 3, written), "2016 06 06 00 15 00").orbit
    assert isinstance(orbit, StateVectorOrbit)
    assert orbit.frequency_channel == channel


def test_glonass_health_is_bn() -> None:
    assert not one("R02", changed(GLONASS, 1, 3, 1.0), "2016 06 06 00 15 00").healthy


def test_sbas_and_navic_are_passed_over() -> None:
    navigation = read(
        header_3(), record_3("S33", MIDNIGHT, GLONASS), record_3("I02", MIDNIGHT, GPS), record_3("G01", MIDNIGHT, GPS)
    )
    assert navigation.issues == ()
    assert navigation.ephemerides == (EXPECTED_GPS,)


def test_an_ephemeris_that_stands_twice_is_given_once_and_the_worse_health_counts() -> None:
    again = record_3("G01", MIDNIGHT, GPS)
    sick = record_3("G01", MIDNIGHT, changed(GPS, 6, 1, 63.0))
    assert read(header_3(), again, again).ephemerides == (EXPECTED_GPS,)
    for records in ((again, sick), (sick, again)):
        files = [(f"{index}.nav", text_of(header_3(), record)) for index, record in enumerate(records)]
        (ephemeris,) = parse_navigation(files).ephemerides
        assert not ephemeris.healthy


ALPHA, BETA = (6.519e-09, 2.235e-08, -5.96e-08, -1.192e-07), (86020.0, 98300.0, -65540.0, -524300.0)
OTHER = (1e-9, 0.0, 0.0, 0.0)


def correction(name: str, values: tuple[float, ...]) -> str:
    return header_line(f"{name} " + "".join(f"{value:12.4E}" for value in values), "IONOSPHERIC CORR")


def test_klobuchar_of_gps_is_preferred() -> None:
    old = [
        header_line("  " + "".join(f"{value:12.4E}".replace("E", "D") for value in values), label)
        for values, label in ((ALPHA, "ION ALPHA"), (BETA, "ION BETA"))
    ]
    gps, bds = (
        [correction("GPSA", ALPHA), correction("GPSB", BETA)],
        [correction("BDSA", OTHER), correction("BDSB", OTHER)],
    )
    qzs = [correction("QZSA", BETA), correction("QZSB", ALPHA)]
    zero = [correction("GPSA", (0.0,) * 4), correction("GPSB", (0.0,) * 4)]
    for records, alpha, beta in (
        (gps, ALPHA, BETA),
        ([*bds, *qzs, *gps], ALPHA, BETA),
        ([*bds, *qzs], BETA, ALPHA),
        ([*zero, *bds], OTHER, OTHER),
        ([correction("GAL ", ALPHA), *bds], OTHER, OTHER),
    ):
        ionosphere = read(header_3(*records)).ionosphere
        assert ionosphere is not None
        assert (ionosphere.alpha, ionosphere.beta) == (alpha, beta)
    from_old = read(header_2("N", *old)).ionosphere
    assert from_old is not None
    assert (from_old.alpha, from_old.beta) == (ALPHA, BETA)
    for records in ([], zero, gps[:1], [correction("GAL ", ALPHA)]):
        assert read(header_3(*records)).ionosphere is None


def test_a_broken_ionosphere_is_reported() -> None:
    navigation = read(header_3(correction("GPSA", ALPHA).replace("6.5190E-09", "6.51?0E-09"), correction("GPSB", BETA)))
    assert navigation.ionosphere is None
    assert str(navigation.issues[0]) == "a.nav:2: the ionosphere is left out: '6.51?0E-09' is no number"
