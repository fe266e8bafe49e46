"""Ephemerides from the records of a navigation file, all on the GPS time scale.

Sources: IS-GPS-200N; Galileo OS SIS ICD 2.1 and OS SDD; BDS-SIS-ICD-B1I 3.0; IS-QZSS-PNT-006;
GLONASS ICD 5.1; their layout in RINEX 3.05, tables A6 to A14.
"""

from __future__ import annotations

import math

from schemas.gnss import Ephemeris, KeplerOrbit, StateVectorOrbit
from schemas.gnss_time import GPS_EPOCH_UNIX_S, WEEK_S, gps_from_calendar, leap_seconds, unix_ns_from_gps
from services.gnss_receiver.rinex_navigation_records import NavigationRecord

_DAY_S = 86_400
_BDT_BEHIND_S = 14
"""GPS time minus BeiDou time (BDS-SIS-ICD-2.1, 3.3)."""
_BDT_FIRST_WEEK = 1356
"""GPS week of 2006-01-01, week 0 of BeiDou (the same)."""
_GPS_WEEKS = 1024
_FIT_HALF_S = {"E": 4 * 3600.0, "C": 2 * 3600.0, "J": 2 * 3600.0}
"""Galileo: at most 4 h (OS SDD); BeiDou: renewed hourly, one missed; QZSS: IS-QZSS-PNT, fit of 2 h."""
_GLONASS_FIT_S = 1800.0
"""Renewed every 30 min for the 15 min around tb (GLONASS ICD 5.1, word tb); one missed record is bridged."""
_GPS_FIT_HOURS = 4.0
_GPS_EXTENDED_HOURS = 6.0
"""Shortest interval that a raised fit interval flag can mean (IS-GPS-200N, 20.3.4.4)."""
_GPS_LONGEST_HOURS = 146.0
_INAV_E1, _FNAV = 0b111, 0b111000
_FNAV_CLOCK = 1 << 8
_QZSS_EITHER = 0b010001
"""L1C/A and L1C/B: a satellite sends one of them and calls the other unhealthy; the highest bit judges the one sent."""
_SISA_STEPS_M = ((50, 0.0, 0.01), (75, 0.5, 0.02), (100, 1.0, 0.04), (126, 2.0, 0.16))
"""Galileo OS SIS ICD 2.1, SISA index: below this index, from this figure, in steps of this."""
_MOST_SISA_M = 6.0
_UNKNOWN_S = -9999.0
_KM = 1000.0
_MOSCOW_S = 3 * 3600
_TB_S = 900


def ephemeris_of(record: NavigationRecord) -> Ephemeris:
    """Ephemeris in a record of GPS, Galileo, BeiDou, QZSS or GLONASS.

    Raises ValueError, which says what is missing or cannot be, when it is not usable.
    """
    year, month, day, hour, minute, second = record.calendar
    if not (year >= 1980 and 0 <= hour < 24 and 0 <= minute < 60 and 0 <= second <= 60):  # noqa: PLR2004
        msg = f"{year}-{month}-{day} {hour}:{minute}:{second} is no time"
        raise ValueError(msg)
    week, tow_s = gps_from_calendar(year, month, day, hour, minute, second)
    return _glonass(record, week, tow_s) if record.system == "R" else _kepler(record, week, tow_s)


def _required(record: NavigationRecord, index: int, name: str) -> float:
    value = record.values[index] if index < len(record.values) else None
    if value is None:
        msg = f"{name} is missing"
        raise ValueError(msg)
    return value


def _optional(record: NavigationRecord, index: int) -> float | None:
    return record.values[index] if index < len(record.values) else None


def _periods(within_s: float, period_s: int, near_s: float) -> int:
    """Number of periods that bring `within_s` nearest to `near_s`."""
    return round((near_s - within_s) / period_s)


def _kepler(record: NavigationRecord, week: int, toc_s: float) -> Ephemeris:
    """Ephemeris of Keplerian elements; `toc_s` of `week` is the clock's time on the system's own scale."""
    toe_s = _required(record, 11, "toe")
    weeks = _periods(toe_s, WEEK_S, toc_s)
    week, toc_s = week + weeks, toc_s - weeks * WEEK_S
    if abs(toe_s - toc_s) > _DAY_S:
        msg = f"its toe lies {abs(toe_s - toc_s) / 3600:.1f} h from its epoch"
        raise ValueError(msg)
    _require_week(record, week)
    sqrt_a, eccentricity = _required(record, 10, "sqrt(A)"), _required(record, 8, "eccentricity")
    if not (1_000.0 < sqrt_a < 10_000.0 and 0.0 <= eccentricity < 0.5):  # noqa: PLR2004 - no navigation satellite is there
        msg = f"no orbit has sqrt(A) {sqrt_a} and eccentricity {eccentricity}"
        raise ValueError(msg)
    sent_s = _sent(_optional(record, 27), WEEK_S, toe_s)
    if record.system == "C":
        toe_s, toc_s, sent_s = toe_s + _BDT_BEHIND_S, toc_s + _BDT_BEHIND_S, sent_s + _BDT_BEHIND_S
    t_ns = unix_ns_from_gps(week, sent_s)
    over, toe_of_week_s = divmod(toe_s, WEEK_S)
    return Ephemeris(
        t_ns=t_ns,
        satellite=f"{record.system}{record.number:02d}",
        gps_week=week + int(over),
        toe_s=toe_of_week_s,
        toc_s=toc_s - over * WEEK_S,
        clock_bias_s=_required(record, 0, "clock bias"),
        clock_drift=_required(record, 1, "clock drift"),
        clock_drift_rate_per_s=_required(record, 2, "clock drift rate"),
        group_delay_s=_group_delay_s(record),
        issue=round(_required(record, 3, "issue of data")),
        healthy=_healthy(record),
        accuracy_m=_accuracy_m(record),
        fit_interval_s=_fit_half_s(record),
        orbit=_elements(record, sqrt_a, eccentricity),
    )


def _elements(record: NavigationRecord, sqrt_a: float, eccentricity: float) -> KeplerOrbit:
    return KeplerOrbit(
        sqrt_a=sqrt_a,
        eccentricity=eccentricity,
        crs_m=_required(record, 4, "Crs"),
        delta_n_radps=_required(record, 5, "delta n"),
        m0_rad=_required(record, 6, "M0"),
        cuc_rad=_required(record, 7, "Cuc"),
        cus_rad=_required(record, 9, "Cus"),
        cic_rad=_required(record, 12, "Cic"),
        omega0_rad=_required(record, 13, "OMEGA0"),
        cis_rad=_required(record, 14, "Cis"),
        i0_rad=_required(record, 15, "i0"),
        crc_m=_required(record, 16, "Crc"),
        omega_rad=_required(record, 17, "omega"),
        omega_dot_radps=_required(record, 18, "OMEGA DOT"),
        i_dot_radps=_required(record, 19, "IDOT"),
    )


def _require_week(record: NavigationRecord, week: int) -> None:
    """Raise ValueError when the week of the record cannot be the week of its epoch and toe.

    Weeks are written continuous, modulo 1024 or from the system's own start, and sometimes as the
    week of transmission, one beside.
    """
    written = _optional(record, 21)
    if written is None:
        return
    starts = (0, _BDT_FIRST_WEEK) if record.system == "C" else (0,)
    if not any((round(written) + start - week + 1) % _GPS_WEEKS <= 2 for start in starts):  # noqa: PLR2004 - one beside
        msg = f"week {written:.0f} does not fit its epoch, which lies in GPS week {week}"
        raise ValueError(msg)


def _sent(written_s: float | None, period_s: int, reference_s: float) -> float:
    """Transmission time nearest to the reference time; that itself where none is written or it cannot be.

    Both times count within one week. Unknown is 0.9999E9 (RINEX 3.05, table A6), -9999 or blank.
    """
    if written_s is None or written_s == _UNKNOWN_S or abs(written_s) > 2 * WEEK_S:
        return reference_s
    sent_s = written_s + period_s * _periods(written_s, period_s, reference_s)
    return sent_s if abs(sent_s - reference_s) < _DAY_S else reference_s


def is_fnav(record: NavigationRecord) -> bool:
    """Whether a Galileo record comes from F/NAV (clock for E5a, E1) and not from I/NAV (E5b, E1).

    Bits of the data sources: RINEX 3.05, table A8. Without them it is taken for I/NAV.
    """
    return record.system == "E" and bool(round(_optional(record, 20) or 0.0) & _FNAV_CLOCK)


def _group_delay_s(record: NavigationRecord) -> float:
    """TGD of GPS and QZSS, TGD1 of BeiDou; BGD E5a/E1 with F/NAV and E5b/E1 with I/NAV clocks."""
    index = 26 if record.system == "E" and not is_fnav(record) else 25
    return _optional(record, index) or 0.0


def _healthy(record: NavigationRecord) -> bool:
    """Whether the satellite says that its first frequency may be used.

    GPS: all health bits zero (IS-GPS-200N, 20.3.3.3.1.4). QZSS: likewise, but for those of L1C/A and L1C/B
    (IS-QZSS-PNT-006, 4.1.2.3). BeiDou: SatH1. Galileo: data validity and signal health of E1-B with I/NAV,
    of E5a with F/NAV (RINEX 3.05, table A8), and an accuracy prediction (OS SDD).
    """
    word = round(_required(record, 24, "health"))
    match record.system:
        case "E":
            sisa_m = _optional(record, 23)
            predicted = sisa_m is None or 0.0 <= sisa_m < 255.0  # noqa: PLR2004 - index of 'no prediction'
            return not word & (_FNAV if is_fnav(record) else _INAV_E1) and predicted
        case "J":
            return not word & ~_QZSS_EITHER
        case _:
            return word == 0


def _accuracy_m(record: NavigationRecord) -> float | None:
    """User range accuracy; older Galileo files hold its index instead of metres."""
    written = _optional(record, 23)
    if written is None or written <= 0.0:
        return None
    if record.system == "E" and written > _MOST_SISA_M:
        below = 0
        for limit, base_m, step_m in _SISA_STEPS_M:
            if written < limit:
                return round(base_m + (written - below) * step_m, 2)
            below = limit
        return None
    return written


def _fit_half_s(record: NavigationRecord) -> float:
    """How far from toe the ephemeris may be used: half of its fit interval.

    GPS: hours, 0 for 4 h; 1 is the flag of IS-GPS-200 itself, an interval longer than 4 h.
    """
    if record.system != "G":
        return _FIT_HALF_S[record.system]
    hours = _optional(record, 28) or 0.0
    if hours == 1.0:
        hours = _GPS_EXTENDED_HOURS
    elif not _GPS_FIT_HOURS <= hours <= _GPS_LONGEST_HOURS:
        hours = _GPS_FIT_HOURS
    return hours * 3600 / 2


def _glonass(record: NavigationRecord, week: int, tb_s: float) -> Ephemeris:
    """GLONASS ephemeris; `tb_s` of `week` is UTC counted as if it were GPS time."""
    if tb_s % _TB_S:
        # Receivers that write GPS time for UTC have come into merged files so; the orbit would be 60 km off.
        msg = f"GLONASS has no reference time {tb_s % _TB_S:g} s behind a quarter of an hour"
        raise ValueError(msg)
    ahead_s = leap_seconds(week * WEEK_S + tb_s + GPS_EPOCH_UNIX_S)
    weeks, toe_s = divmod(tb_s + ahead_s, WEEK_S)
    sent_s = _sent(_optional(record, 2), WEEK_S if record.times_within_week else _DAY_S, tb_s)
    channel = round(_required(record, 10, "frequency channel"))
    if channel >= 128:  # noqa: PLR2004 - written as an unsigned byte
        channel -= 256
    if not -7 <= channel <= 13:  # noqa: PLR2004 - GLONASS ICD 5.1, 3.3.1; above 6 until 2005
        msg = f"GLONASS has no frequency channel {channel}"
        raise ValueError(msg)
    position = _metres(record, 3, "position")
    radius_m = math.hypot(*position)
    if not 20e6 < radius_m < 30e6:  # noqa: PLR2004 - the orbits have 25.5e6 m
        msg = f"no GLONASS orbit has a radius of {radius_m / _KM:.0f} km"
        raise ValueError(msg)
    return Ephemeris(
        t_ns=unix_ns_from_gps(week, sent_s + ahead_s),
        satellite=f"R{record.number:02d}",
        gps_week=week + int(weeks),
        toe_s=toe_s,
        toc_s=toe_s,
        clock_bias_s=_required(record, 0, "-TauN"),
        clock_drift=_required(record, 1, "GammaN"),
        issue=round((tb_s + _MOSCOW_S) % _DAY_S / _TB_S),
        healthy=_required(record, 6, "health") == 0.0,
        fit_interval_s=_GLONASS_FIT_S,
        orbit=StateVectorOrbit(
            position_m=position,
            velocity_mps=_metres(record, 4, "velocity"),
            acceleration_mps2=_metres(record, 5, "acceleration"),
            frequency_channel=channel,
        ),
    )


def _metres(record: NavigationRecord, index: int, name: str) -> tuple[float, float, float]:
    """Vector of which a GLONASS record holds the first component at `index`, in kilometres."""
    return (
        _KM * _required(record, index, f"{name} x"),
        _KM * _required(record, index + 4, f"{name} y"),
        _KM * _required(record, index + 8, f"{name} z"),
    )
