"""Ephemerides of RTCM 3: 1019 GPS, 1020 GLONASS, 1042 BeiDou, 1044 QZSS, 1045 and 1046 Galileo.

Source: RTCM 10403.3, 3.5.9 to 3.5.15.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from schemas.gnss import Ephemeris, KeplerOrbit, StateVectorOrbit
from schemas.gnss_time import GPS_EPOCH_UNIX_S, NS, WEEK_S, unix_ns_from_gps
from services.gnss_receiver.broadcast_elements import (
    GALILEO_FNAV,
    GALILEO_INAV,
    SEMICIRCLES,
    full_week,
    glonass_ephemeris,
    kepler_ephemeris,
    reference_week,
    sisa_index,
    sisa_m,
    ura_index,
    ura_m,
)
from services.gnss_receiver.rtcm_messages import read_fields, write_fields
from services.gnss_receiver.rtcm_time import BDT_BEHIND_MS, DAY_MS, MOSCOW_MS, gps_ms_from_unix_ns, nearest

GPS, GLONASS, BEIDOU, QZSS, GALILEO_F, GALILEO_I = 1019, 1020, 1042, 1044, 1045, 1046
EPHEMERIDES: Final = frozenset({GPS, GLONASS, BEIDOU, QZSS, GALILEO_F, GALILEO_I})
_SYSTEM: Final = {GPS: "G", BEIDOU: "C", QZSS: "J", GALILEO_F: "E", GALILEO_I: "E"}
_BEHIND_S: Final = BDT_BEHIND_MS // 1000
_BDT_FIRST_WEEK: Final = 1356
_GST_FIRST_WEEK: Final = 1024
"""GPS weeks of week 0 of BeiDou (BDS-SIS-ICD-B1I 3.0, 3.3) and Galileo (OS SIS ICD 2.1, 5.1.2)."""
_NS: Final = 1e-9
_GLONASS_TAU_S: Final = 2.0**-30
_GLONASS_GAMMA: Final = 2.0**-40
"""Scales of DF124 and DF121, which pyrtcm leaves as whole numbers."""
_TB_S: Final = 900
_CHANNEL_ZERO: Final = 7
_MOSCOW_S: Final = MOSCOW_MS // 1000
_DAY_S: Final = DAY_MS // 1000
_UNHEALTHY_6: Final = 63
_UNHEALTHY_QZSS: Final = 62
_GPS_FIT_HALF_S: Final = 7200.0

_ELEMENTS: Final = ("crs", "delta_n", "m0", "cuc", "e", "cus", "sqrt_a", "toe", "cic", "omega0", "cis", "i0", "crc")
_TURNING: Final = ("omega", "omega_dot")
_NUMBERS: Final = {
    # satellite, week, accuracy index, i_dot, issue, toc, af2, af1, af0, first element
    GPS: (9, 76, 77, 79, 71, 81, 82, 83, 84, 86),
    BEIDOU: (488, 489, 490, 491, 492, 493, 494, 495, 496, 498),
    QZSS: (429, 452, 453, 450, 434, 430, 431, 432, 433, 435),
    GALILEO_F: (252, 289, 291, 292, 290, 293, 294, 295, 296, 297),
    GALILEO_I: (252, 289, 286, 292, 290, 293, 294, 295, 296, 297),
}
_HEADS: Final = ("satellite", "week", "index", "i_dot", "issue", "toc", "af2", "af1", "af0")


def _fields(number: int) -> dict[str, str]:
    """Field of the standard for every figure of a message of Keplerian elements."""
    *heads, first = _NUMBERS[number]
    elements = (*_ELEMENTS, *_TURNING)
    names = dict(zip(_HEADS, heads, strict=True)) | {name: first + at for at, name in enumerate(elements)}
    return {name: f"DF{field:03d}" for name, field in names.items()}


_FIELDS: Final = {number: _fields(number) for number in _NUMBERS}


def read_ephemeris(number: int, message: bytes, near_ns: int) -> Ephemeris:
    """Ephemeris of a message; `near_ns`, UTC, lies within some years of it (a day for GLONASS).

    Raises ValueError, which says what is missing or cannot be.
    """
    fields = read_fields(message)
    if number == GLONASS:
        return _read_glonass(fields, near_ns)
    near_s = gps_ms_from_unix_ns(near_ns) / 1000.0
    return _read_kepler(number, fields, near_s)


def _read_kepler(number: int, fields: Mapping[str, float], near_s: float) -> Ephemeris:
    system, names = _SYSTEM[number], _FIELDS[number]
    named = {name: float(fields[field]) for name, field in names.items()}
    for name in SEMICIRCLES:
        named[name] *= math.pi
    week, named["toe"] = _week_of_toe(system, int(named["week"]), named["toe"], near_s)
    _read_rest(number, fields, named)
    return kepler_ephemeris(system, int(named["satellite"]), week, named["toc"], named)


def _week_of_toe(system: str, week: int, toe_s: float, near_s: float) -> tuple[int, float]:
    """Week of a record, counted from 1980, and the reference time within it."""
    near_week = int(near_s // WEEK_S)
    match system:
        case "C":
            return reference_week(week + _BDT_FIRST_WEEK, toe_s, near_s - _BEHIND_S), toe_s
        case "E":
            return reference_week(full_week(week + _GST_FIRST_WEEK, 4096, near_week), toe_s, near_s), toe_s
        case _:
            return reference_week(full_week(week, 1024, near_week), toe_s, near_s), toe_s


def _read_rest(number: int, fields: Mapping[str, float], named: dict[str, float]) -> None:
    """Accuracy, health, delays and fit of a message, into `named`."""
    index = int(named["index"])
    named["accuracy"] = sisa_m(index) if number in (GALILEO_F, GALILEO_I) else ura_m(index)
    match number:
        case 1019:
            named |= {"health": fields["DF102"], "delay_a": fields["DF101"], "fit_or_clock_issue": fields["DF137"]}
        case 1044:
            named |= {"health": fields["DF454"], "delay_a": fields["DF455"], "fit_or_clock_issue": fields["DF457"]}
        case 1042:
            named |= {"health": fields["DF515"], "fit_or_clock_issue": fields["DF497"]}
            named |= {"delay_a": _NS * round(fields["DF513"], 1), "delay_b": _NS * round(fields["DF514"], 1)}
        case 1045:
            health = int(fields["DF315"]) << 3 | int(fields["DF314"]) << 4
            named |= {"health": health, "delay_a": fields["DF312"], "source": GALILEO_FNAV}
        case _:
            first = int(fields["DF288"]) | int(fields["DF287"]) << 1
            health = first | int(fields["DF317"]) << 6 | int(fields["DF316"]) << 7
            named |= {"health": health, "source": GALILEO_INAV}
            named |= {"delay_a": fields["DF312"], "delay_b": fields["DF313"]}


def _read_glonass(fields: Mapping[str, float], near_ns: int) -> Ephemeris:
    near_utc_ms = (near_ns - GPS_EPOCH_UNIX_S * NS) // 1_000_000
    tb_s = int(fields["DF110"]) * _TB_S
    utc_s = nearest(1000 * tb_s - MOSCOW_MS, DAY_MS, near_utc_ms) // 1000
    frame = int(fields["DF107"])
    sent_s = (frame >> 7) * 3600 + (frame >> 1 & 0x3F) * 60 + (frame & 1) * 30 - _MOSCOW_S
    figures = {
        "tau_n": fields["DF124"] * _GLONASS_TAU_S,
        "gamma_n": fields["DF121"] * _GLONASS_GAMMA,
        "sent": float(nearest(sent_s, _DAY_S, utc_s) % WEEK_S),
        "health": fields["DF108"],
        "channel": fields["DF040"] - _CHANNEL_ZERO,
    }
    for axis, first in zip("xyz", (111, 114, 117), strict=True):
        figures |= {f"{axis}_kmps": fields[f"DF{first}"], f"{axis}_km": fields[f"DF{first + 1}"]}
        figures[f"{axis}_kmps2"] = fields[f"DF{first + 2}"]
    return glonass_ephemeris(int(fields["DF038"]), float(utc_s), figures)


def write_ephemeris(ephemeris: Ephemeris) -> bytes:
    """Message of an ephemeris: 1019, 1020, 1042, 1044 or 1046 (Galileo is taken for I/NAV).

    Raises ValueError for a system without a message and for what a field cannot hold.
    """
    orbit = ephemeris.orbit
    if isinstance(orbit, StateVectorOrbit):
        return _write_glonass(ephemeris, orbit)
    numbers = {"G": GPS, "C": BEIDOU, "J": QZSS, "E": GALILEO_I}
    system = ephemeris.satellite[0]
    if system not in numbers:
        msg = f"{ephemeris.satellite}: RTCM 3 has no ephemeris of system {system}"
        raise ValueError(msg)
    number = numbers[system]
    names = _FIELDS[number]
    named = _named(ephemeris, orbit)
    values = {names[name]: value for name, value in named.items() if name in names}
    return write_fields(number, values | _rest(number, ephemeris))


def _named(ephemeris: Ephemeris, orbit: KeplerOrbit) -> dict[str, float]:
    """Figures of an ephemeris as its message counts them."""
    system = ephemeris.satellite[0]
    behind_s = _BEHIND_S if system == "C" else 0
    over, toe_s = divmod(ephemeris.toe_s - behind_s, WEEK_S)
    week = ephemeris.gps_week + int(over)
    week -= {"C": _BDT_FIRST_WEEK, "E": _GST_FIRST_WEEK}.get(system, 0)
    index = sisa_index(ephemeris.accuracy_m) if system == "E" else ura_index(ephemeris.accuracy_m)
    angles = {
        "delta_n": orbit.delta_n_radps,
        "m0": orbit.m0_rad,
        "omega0": orbit.omega0_rad,
        "i0": orbit.i0_rad,
        "omega": orbit.omega_rad,
        "omega_dot": orbit.omega_dot_radps,
        "i_dot": orbit.i_dot_radps,
    }
    return {
        "satellite": int(ephemeris.satellite[1:]),
        "week": week % {"C": 8192, "E": 4096}.get(system, 1024),
        "index": index,
        "issue": ephemeris.issue,
        "toe": toe_s,
        "toc": (ephemeris.toc_s - behind_s) % WEEK_S,
        "af0": ephemeris.clock_bias_s,
        "af1": ephemeris.clock_drift,
        "af2": ephemeris.clock_drift_rate_per_s,
        "crs": orbit.crs_m,
        "crc": orbit.crc_m,
        "cuc": orbit.cuc_rad,
        "cus": orbit.cus_rad,
        "cic": orbit.cic_rad,
        "cis": orbit.cis_rad,
        "e": orbit.eccentricity,
        "sqrt_a": orbit.sqrt_a,
    } | {name: _semicircles(angle) for name, angle in angles.items()}


def _semicircles(angle_rad: float) -> float:
    """Part of pi between -1 and 1, as far as it is an angle; rates are far below."""
    parts = angle_rad / math.pi
    return parts if -1.0 <= parts < 1.0 else (parts + 1.0) % 2.0 - 1.0


def _rest(number: int, ephemeris: Ephemeris) -> dict[str, float]:
    """Health, delay, fit and clock issue, by the fields of the standard."""
    delay_s, sick = ephemeris.group_delay_s, not ephemeris.healthy
    match number:
        case 1019:
            long_fit = ephemeris.fit_interval_s > _GPS_FIT_HALF_S
            health = {"DF102": _UNHEALTHY_6 * sick, "DF137": int(long_fit)}
            return {"DF101": delay_s, "DF085": ephemeris.issue, "DF078": 1} | health
        case 1044:
            return {"DF455": delay_s, "DF456": ephemeris.issue, "DF454": _UNHEALTHY_QZSS * sick}
        case 1042:
            return {"DF513": delay_s / _NS, "DF497": 0, "DF515": int(sick)}
        case _:
            return {"DF313": delay_s, "DF288": int(sick), "DF287": int(sick)}


def _write_glonass(ephemeris: Ephemeris, orbit: StateVectorOrbit) -> bytes:
    utc_s = unix_ns_from_gps(ephemeris.gps_week, ephemeris.toe_s) // NS
    sent_s = (ephemeris.t_ns // NS + _MOSCOW_S) % _DAY_S
    values = {
        "DF038": int(ephemeris.satellite[1:]),
        "DF040": orbit.frequency_channel + _CHANNEL_ZERO,
        "DF107": sent_s // 3600 << 7 | sent_s % 3600 // 60 << 1 | sent_s % 60 // 30,
        "DF108": int(not ephemeris.healthy),
        "DF110": (utc_s + _MOSCOW_S) % _DAY_S // _TB_S,
        "DF121": ephemeris.clock_drift / _GLONASS_GAMMA,
        "DF124": -ephemeris.clock_bias_s / _GLONASS_TAU_S,
    }
    rows = zip(orbit.velocity_mps, orbit.position_m, orbit.acceleration_mps2, strict=True)
    for first, (speed_mps, place_m, pull_mps2) in zip((111, 114, 117), rows, strict=True):
        values |= {f"DF{first}": speed_mps / 1e3, f"DF{first + 1}": place_m / 1e3, f"DF{first + 2}": pull_mps2 / 1e3}
    return write_fields(GLONASS, values)
