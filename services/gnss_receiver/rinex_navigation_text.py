"""Ephemerides as the lines of a RINEX 3.04 navigation file.

Source: RINEX 3.04 (IGS/RTCM 2018), tables A5 to A14.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta

from schemas.gnss import Ephemeris, Ionosphere, KeplerOrbit, StateVectorOrbit
from schemas.gnss_time import GPS_EPOCH_UNIX_S, NS, WEEK_S, gps_from_unix_ns, unix_ns_from_gps
from services.gnss_receiver.observations import Navigation

_GPS_EPOCH = datetime(1980, 1, 6)  # noqa: DTZ001 - the scale is the satellite system's own
_BDT_BEHIND_S = 14
_BDT_FIRST_WEEK = 1356
_UNHEALTHY = {"G": 63.0, "E": float(0b001_001_001), "C": 1.0, "J": 62.0}
"""All bits; data validity of all three Galileo signals; SatH1; all bits but that of L1C/B."""
_INAV = 517.0
"""Data sources E1-B and E5b-I, clock for E5b and E1 (table A8)."""
_KM = 1000.0
_SMALLEST = 1e-99
"""What needs three digits of exponent does not fit, and is nothing."""

Figures = Sequence[float | None]


def navigation_lines(navigation: Navigation) -> Iterator[str]:
    """Lines of a RINEX 3.04 navigation file with all ephemerides and the ionosphere.

    Galileo is written as I/NAV. Fit intervals other than those of GPS have no place in the format.
    Raises ValueError for a satellite system that has no record here, and for a reference time of
    the clock that is no whole second.
    """
    yield _header(f"{'3.04':>9}{'':11}{'N: GNSS NAV DATA':20}{'M: MIXED':20}", "RINEX VERSION / TYPE")
    yield _header("kirotei", "PGM / RUN BY / DATE")
    if navigation.ionosphere is not None:
        yield from _ionosphere(navigation.ionosphere)
    yield _header("", "END OF HEADER")
    for ephemeris in navigation.ephemerides:
        match ephemeris.orbit:
            case KeplerOrbit():
                yield from _kepler(ephemeris, ephemeris.orbit)
            case StateVectorOrbit():
                yield from _glonass(ephemeris, ephemeris.orbit)


def _ionosphere(ionosphere: Ionosphere) -> Iterator[str]:
    for name, coefficients in (("GPSA", ionosphere.alpha), ("GPSB", ionosphere.beta)):
        yield _header(f"{name} " + "".join(f"{value:12.4E}" for value in coefficients), "IONOSPHERIC CORR")


def _kepler(ephemeris: Ephemeris, orbit: KeplerOrbit) -> Iterator[str]:
    system = ephemeris.satellite[0]
    if system not in _UNHEALTHY:
        msg = f"{ephemeris.satellite}: no Keplerian record for system {system}"
        raise ValueError(msg)
    behind_s = _BDT_BEHIND_S if system == "C" else 0
    over, toe_of_week_s = divmod(ephemeris.toe_s - behind_s, WEEK_S)
    week = ephemeris.gps_week + over
    sent_week, sent_of_week_s = gps_from_unix_ns(ephemeris.t_ns)
    sent_s = sent_of_week_s - behind_s + (sent_week - week) * WEEK_S
    toc_s = ephemeris.gps_week * WEEK_S + ephemeris.toc_s - behind_s
    delay_s, issue = ephemeris.group_delay_s, float(ephemeris.issue)
    delays = {"E": (None, delay_s), "C": (delay_s, None)}.get(system, (delay_s, issue))
    last = {"G": ephemeris.fit_interval_s * 2 / 3600, "E": None, "C": issue, "J": 0.0}[system]
    source = {"E": _INAV, "C": None}.get(system, 0.0)
    yield _first(ephemeris, toc_s, (ephemeris.clock_bias_s, ephemeris.clock_drift, ephemeris.clock_drift_rate_per_s))
    yield _line((issue, orbit.crs_m, orbit.delta_n_radps, orbit.m0_rad))
    yield _line((orbit.cuc_rad, orbit.eccentricity, orbit.cus_rad, orbit.sqrt_a))
    yield _line((toe_of_week_s, orbit.cic_rad, orbit.omega0_rad, orbit.cis_rad))
    yield _line((orbit.i0_rad, orbit.crc_m, orbit.omega_rad, orbit.omega_dot_radps))
    yield _line((orbit.i_dot_radps, source, week - (_BDT_FIRST_WEEK if system == "C" else 0), None))
    yield _line((ephemeris.accuracy_m, 0.0 if ephemeris.healthy else _UNHEALTHY[system], *delays))
    yield _line((sent_s, last))


def _glonass(ephemeris: Ephemeris, orbit: StateVectorOrbit) -> Iterator[str]:
    utc_ns = unix_ns_from_gps(ephemeris.gps_week, ephemeris.toe_s)
    sent_s = (ephemeris.t_ns - GPS_EPOCH_UNIX_S * NS) % (WEEK_S * NS) / NS
    rows = zip(orbit.position_m, orbit.velocity_mps, orbit.acceleration_mps2, strict=True)
    last = (0.0 if ephemeris.healthy else 1.0, float(orbit.frequency_channel), 0.0)
    yield _first(
        ephemeris,
        utc_ns / NS - GPS_EPOCH_UNIX_S,
        (ephemeris.clock_bias_s, ephemeris.clock_drift, sent_s),
    )
    for vector, figure in zip(rows, last, strict=True):
        yield _line((*(part / _KM for part in vector), figure))


def _first(ephemeris: Ephemeris, epoch_s: float, clock: Figures) -> str:
    """First line of a record; `epoch_s` counts from the GPS epoch on the system's own scale."""
    if epoch_s != round(epoch_s):
        msg = f"{ephemeris.satellite}: the clock's reference time is {ephemeris.toc_s} s, not a whole second"
        raise ValueError(msg)
    moment = _GPS_EPOCH + timedelta(seconds=round(epoch_s))
    return f"{ephemeris.satellite} {moment:%Y %m %d %H %M %S}" + "".join(map(_figure, clock))


def _line(figures: Figures) -> str:
    return f"    {''.join(map(_figure, figures))}".rstrip()


def _figure(value: float | None) -> str:
    """Figure in nineteen columns, blank when there is none."""
    if value is None:
        return " " * 19
    return f"{value if abs(value) >= _SMALLEST else 0.0:19.12E}"


def _header(content: str, label: str) -> str:
    return f"{content:60.60}{label}"
