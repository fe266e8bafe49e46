"""Navigation files written figure by figure, and the ephemerides that they hold."""

from __future__ import annotations

from collections.abc import Sequence

from schemas.gnss import Ephemeris, KeplerOrbit
from schemas.gnss_time import unix_ns_from_gps
from tests.unit.gnss_receiver.samples import header_line

# A GPS satellite: toe 86400 s of week 1900, sent 83310 s.
GPS = (
    (2.27009877562e-05, 1.25055521494e-12, 0.0),
    (24.0, 2.125, 4.43732768965e-09, 2.37002107609),
    (9.12696123123e-08, 5.53706113715e-03, 1.08145177364e-05, 5153.64817619),
    (86400.0, -1.75088644028e-07, -2.40868609163, -8.00937414169e-08),
    (0.964506218435, 173.8125, 0.466179717411, -7.76853787650e-09),
    (6.22525930704e-10, 1.0, 1900.0, 0.0),
    (2.0, 0.0, 5.12227416039e-09, 24.0),
    (83310.0, 4.0),
)
GLONASS = (
    (1.94282270968e-04, 1.81898940355e-12, 86430.0),
    (5695.44824219, -1.38595867157, -9.31322574616e-10, 0.0),
    (11500.3408203, 2.67567634582, -9.31322574616e-10, -4.0),
    (22079.1704102, -1.04189395905, -2.79396772385e-09, 0.0),
)
FORMS = ("E", "e", "D", "d")
Figures = Sequence[Sequence[float | None]]


def figure(value: float | None, form: str = "E") -> str:
    """Figure in nineteen columns; form '.D' leaves out the zero before the point, as some converters do."""
    if value is None:
        return " " * 19
    if form in FORMS:
        return f"{value:19.12E}".replace("E", form)
    mantissa, exponent = f"{abs(value):.11E}".split("E")
    power = int(exponent) + 1 if value else 0
    sign = "-" if value < 0 else ""
    return f"{sign}.{mantissa.replace('.', '')}D{power:+03d}".rjust(19)


def record_3(name: str, calendar: str, figures: Figures, form: str = "E") -> list[str]:
    """Record of RINEX 3; `calendar` as '2016 06 06 00 00 00'."""
    lines = [f"{name} {calendar}" + "".join(figure(value, form) for value in figures[0])]
    return [*lines, *("    " + "".join(figure(value, form) for value in row) for row in figures[1:])]


def record_2(number: int, calendar: str, figures: Figures, form: str = "D") -> list[str]:
    """Record of RINEX 2; `calendar` as '16  6  6  0  0  0.0'."""
    lines = [f"{number:2d} {calendar}" + "".join(figure(value, form) for value in figures[0])]
    return [*lines, *("   " + "".join(figure(value, form) for value in row) for row in figures[1:])]


def header_3(*records: str, version: str = "3.04") -> list[str]:
    first = header_line(f"{version:>9}{'':11}{'N: GNSS NAV DATA':20}M: MIXED", "RINEX VERSION / TYPE")
    return [first, *records, header_line("", "END OF HEADER")]


def header_2(kind: str = "N", *records: str) -> list[str]:
    first = header_line(f"{'2.11':>9}{'':11}{kind:20}", "RINEX VERSION / TYPE")
    return [first, *records, header_line("", "END OF HEADER")]


def changed(figures: Figures, row: int, column: int, value: float | None) -> Figures:
    """The same with one figure exchanged."""
    copy = [list(line) for line in figures]
    copy[row][column] = value
    return copy


MIDNIGHT = "2016 06 06 00 00 00"
"""Monday, 86400 s of GPS week 1900."""
EXPECTED_GPS = Ephemeris(
    t_ns=unix_ns_from_gps(1900, 83310.0),
    satellite="G01",
    gps_week=1900,
    toe_s=86400.0,
    toc_s=86400.0,
    clock_bias_s=2.27009877562e-05,
    clock_drift=1.25055521494e-12,
    clock_drift_rate_per_s=0.0,
    group_delay_s=5.12227416039e-09,
    issue=24,
    healthy=True,
    accuracy_m=2.0,
    fit_interval_s=7200.0,
    orbit=KeplerOrbit(
        sqrt_a=5153.64817619,
        eccentricity=5.53706113715e-03,
        m0_rad=2.37002107609,
        delta_n_radps=4.43732768965e-09,
        omega0_rad=-2.40868609163,
        omega_dot_radps=-7.76853787650e-09,
        omega_rad=0.466179717411,
        i0_rad=0.964506218435,
        i_dot_radps=6.22525930704e-10,
        cuc_rad=9.12696123123e-08,
        cus_rad=1.08145177364e-05,
        crc_m=173.8125,
        crs_m=2.125,
        cic_rad=-1.75088644028e-07,
        cis_rad=-8.00937414169e-08,
    ),
)
