"""Ephemerides whose every figure is a whole number of steps of the messages, and messages bit by bit."""

from __future__ import annotations

import math
from collections.abc import Sequence

from schemas.gnss import Ephemeris, KeplerOrbit, StateVectorOrbit
from schemas.gnss_time import unix_ns_from_gps
from services.gnss_receiver.bit_fields import BitWriter
from services.gnss_receiver.crc24q import crc24q_of_bits

WEEK = 2262
NEAR_NS = unix_ns_from_gps(WEEK, 455_618.0)
FIT_S = {"G": 7200.0, "J": 7200.0, "C": 7200.0, "E": 14_400.0}
STEPS = {
    # steps of i_dot, af2, af1, af0, lengths, angle corrections, toe
    "G": (2.0**-43, 2.0**-55, 2.0**-43, 2.0**-31, 2.0**-5, 2.0**-29, 16),
    "J": (2.0**-43, 2.0**-55, 2.0**-43, 2.0**-31, 2.0**-5, 2.0**-29, 16),
    "E": (2.0**-43, 2.0**-59, 2.0**-46, 2.0**-34, 2.0**-5, 2.0**-29, 60),
    "C": (2.0**-43, 2.0**-66, 2.0**-50, 2.0**-33, 2.0**-6, 2.0**-31, 8),
}
DELAYS_S = {"G": 11 * 2.0**-31, "J": -3 * 2.0**-31, "E": 7 * 2.0**-32, "C": -5.1e-9}


def kepler(satellite: str, *, healthy: bool = True, toe_s: float = 453_600.0, week: int = WEEK) -> Ephemeris:
    """Ephemeris of GPS, QZSS, Galileo (I/NAV) or BeiDou; `toe_s` on the system's own scale."""
    system = satellite[0]
    i_dot, af2, af1, af0, length, angle, step_s = STEPS[system]
    assert toe_s % step_s == 0
    ahead_s = 14.0 if system == "C" else 0.0
    pi = math.pi
    return Ephemeris(
        t_ns=unix_ns_from_gps(week, toe_s + ahead_s),
        satellite=satellite,
        gps_week=week,
        toe_s=toe_s + ahead_s,
        toc_s=toe_s + ahead_s,
        clock_bias_s=-123_456 * af0,
        clock_drift=-321 * af1,
        clock_drift_rate_per_s=3 * af2,
        group_delay_s=DELAYS_S[system],
        issue=21,
        healthy=healthy,
        accuracy_m=3.12 if system == "E" else 2.8,
        fit_interval_s=FIT_S[system],
        orbit=KeplerOrbit(
            sqrt_a=2_702_000_001 * 2.0**-19,
            eccentricity=104_857_601 * 2.0**-33,
            m0_rad=-1_000_000_007 * 2.0**-31 * pi,
            delta_n_radps=12_345 * 2.0**-43 * pi,
            omega0_rad=-2_000_000_011 * 2.0**-31 * pi,
            omega_dot_radps=-23_456 * 2.0**-43 * pi,
            omega_rad=1_500_000_003 * 2.0**-31 * pi,
            i0_rad=660_000_013 * 2.0**-31 * pi,
            i_dot_radps=-777 * i_dot * pi,
            cuc_rad=-3_333 * angle,
            cus_rad=4_444 * angle,
            crc_m=7_777 * length,
            crs_m=-2_222 * length,
            cic_rad=55 * angle,
            cis_rad=-66 * angle,
        ),
    )


def glonass(satellite: str = "R09", *, healthy: bool = True) -> Ephemeris:
    """Ephemeris of GLONASS, its tb at 6:15 UTC of the day of NEAR_NS, its frame half an hour before."""
    toe_s = 5 * 86_400 + 6 * 3600 + 15 * 60 + 18.0
    return Ephemeris(
        t_ns=unix_ns_from_gps(WEEK, toe_s - 1800.0),
        satellite=satellite,
        gps_week=WEEK,
        toe_s=toe_s,
        toc_s=toe_s,
        clock_bias_s=98_765 * 2.0**-30,
        clock_drift=-5 * 2.0**-40,
        issue=37,
        healthy=healthy,
        fit_interval_s=1800.0,
        orbit=StateVectorOrbit(
            position_m=(5_695_448 * 2.0**-11 * 1e3, -11_500_341 * 2.0**-11 * 1e3, 50_000_003 * 2.0**-11 * 1e3),
            velocity_mps=(-1_453_281 * 2.0**-20 * 1e3, 2_805_650 * 2.0**-20 * 1e3, -1_092_500 * 2.0**-20 * 1e3),
            acceleration_mps2=(-1 * 2.0**-30 * 1e3, 2 * 2.0**-30 * 1e3, -3 * 2.0**-30 * 1e3),
            frequency_channel=-2,
        ),
    )


def _kepler_of(ephemeris: Ephemeris) -> KeplerOrbit:
    assert isinstance(ephemeris.orbit, KeplerOrbit)
    return ephemeris.orbit


def _angle(value_rad: float, step: float = 2.0**-31) -> int:
    return round(value_rad / math.pi / step)


def _lnav_parity(data: int) -> int:
    """Parity of 26 bits (two of the word before, 24 of data), sum by sum (IS-GPS-200N, table 20-XIV)."""
    sums = (
        (-1, 1, 2, 3, 5, 6, 10, 11, 12, 13, 14, 17, 18, 20, 23),
        (0, 2, 3, 4, 6, 7, 11, 12, 13, 14, 15, 18, 19, 21, 24),
        (-1, 1, 3, 4, 5, 7, 8, 12, 13, 14, 15, 16, 19, 20, 22),
        (0, 2, 4, 5, 6, 8, 9, 13, 14, 15, 16, 17, 20, 21, 23),
        (0, 1, 3, 5, 6, 7, 9, 10, 14, 15, 16, 17, 18, 21, 22, 24),
        (-1, 3, 5, 6, 8, 9, 10, 11, 13, 15, 19, 22, 23, 24),
    )
    parity = 0
    for places in sums:
        # Place -1 is D29*, 0 is D30*, the first two of the 26 bits.
        parity = parity << 1 | sum(data >> (24 - place) & 1 for place in places) % 2
    return parity


def lnav_words(data: bytes) -> list[int]:
    """Ten words of 32 bits, as u-blox gives them, of 240 bits of data."""
    assert len(data) == 30
    words, before = [], 0
    for at in range(0, 30, 3):
        bits = before << 24 | int.from_bytes(data[at : at + 3], "big")
        word = bits << 6 | _lnav_parity(bits)
        words.append(word)
        before = word & 3
    return words


def _lnav_head(writer: BitWriter, kind: int, tow_count: int) -> None:
    writer.uint(0b10001011 << 16, 24)
    writer.uint(tow_count, 17)
    writer.uint(0, 2)
    writer.uint(kind, 3)
    writer.uint(0, 2)


def lnav_subframes(ephemeris: Ephemeris, tow_count: int = 75_936) -> list[list[int]]:
    """Subframes 1 to 3 of a GPS or QZSS ephemeris."""
    orbit = _kepler_of(ephemeris)
    first, second, third = BitWriter(), BitWriter(), BitWriter()
    _lnav_head(first, 1, tow_count)
    for value, width in ((ephemeris.gps_week % 1024, 10), (1, 2), (1, 4), (0 if ephemeris.healthy else 63, 6)):
        first.uint(value, width)
    first.uint(ephemeris.issue >> 8, 2)
    first.uint(0, 88)
    first.sint(round(ephemeris.group_delay_s / 2.0**-31), 8)
    first.uint(ephemeris.issue & 0xFF, 8)
    first.uint(round(ephemeris.toc_s) // 16, 16)
    first.sint(round(ephemeris.clock_drift_rate_per_s / 2.0**-55), 8)
    first.sint(round(ephemeris.clock_drift / 2.0**-43), 16)
    first.sint(round(ephemeris.clock_bias_s / 2.0**-31), 22)
    first.uint(0, 2)
    _lnav_head(second, 2, tow_count + 1)
    second.uint(ephemeris.issue & 0xFF, 8)
    second.sint(round(orbit.crs_m / 2.0**-5), 16)
    second.sint(_angle(orbit.delta_n_radps, 2.0**-43), 16)
    second.sint(_angle(orbit.m0_rad), 32)
    second.sint(round(orbit.cuc_rad / 2.0**-29), 16)
    second.uint(round(orbit.eccentricity / 2.0**-33), 32)
    second.sint(round(orbit.cus_rad / 2.0**-29), 16)
    second.uint(round(orbit.sqrt_a / 2.0**-19), 32)
    second.uint(round(ephemeris.toe_s) // 16, 16)
    second.uint(0, 8)
    _lnav_head(third, 3, tow_count + 2)
    third.sint(round(orbit.cic_rad / 2.0**-29), 16)
    third.sint(_angle(orbit.omega0_rad), 32)
    third.sint(round(orbit.cis_rad / 2.0**-29), 16)
    third.sint(_angle(orbit.i0_rad), 32)
    third.sint(round(orbit.crc_m / 2.0**-5), 16)
    third.sint(_angle(orbit.omega_rad), 32)
    third.sint(_angle(orbit.omega_dot_radps, 2.0**-43), 24)
    third.uint(ephemeris.issue & 0xFF, 8)
    third.sint(_angle(orbit.i_dot_radps, 2.0**-43), 14)
    third.uint(0, 2)
    return [lnav_words(writer.content()) for writer in (first, second, third)]


def lnav_ionosphere(alpha: Sequence[int], beta: Sequence[int], tow_count: int = 75_939) -> list[int]:
    """Page 18 of subframe 4 with coefficients in steps of the message."""
    writer = BitWriter()
    _lnav_head(writer, 4, tow_count)
    writer.uint(1, 2)
    writer.uint(56, 6)
    for value in (*alpha, *beta):
        writer.sint(value, 8)
    writer.uint(0, 240 - writer.length)
    return lnav_words(writer.content())


def inav_page(word: bytes) -> list[int]:
    """Eight words of 32 bits, as u-blox gives them, of the 128 bits of an I/NAV word."""
    data = int.from_bytes(word, "big")
    even = data >> 16
    odd = 1 << 81 | (data & 0xFFFF) << 64
    check = crc24q_of_bits(even << 82 | odd, 196)
    parts = (even << 14, (odd << 24 | check) << 22)
    return [part >> shift & 0xFFFFFFFF for part in parts for shift in (96, 64, 32, 0)]


def inav_pages(ephemeris: Ephemeris, tow_s: int = 455_600) -> list[list[int]]:
    """Word types 1 to 5 of a Galileo ephemeris."""
    orbit, issue = _kepler_of(ephemeris), ephemeris.issue
    words = [BitWriter() for _ in range(5)]
    for number, writer in enumerate(words, start=1):
        writer.uint(number, 6)
        if number < 5:
            writer.uint(issue, 10)
    one, two, three, four, five = words
    one.uint(round(ephemeris.toe_s) // 60, 14)
    one.sint(_angle(orbit.m0_rad), 32)
    one.uint(round(orbit.eccentricity / 2.0**-33), 32)
    one.uint(round(orbit.sqrt_a / 2.0**-19), 32)
    for value in (orbit.omega0_rad, orbit.i0_rad, orbit.omega_rad):
        two.sint(_angle(value), 32)
    two.sint(_angle(orbit.i_dot_radps, 2.0**-43), 14)
    three.sint(_angle(orbit.omega_dot_radps, 2.0**-43), 24)
    three.sint(_angle(orbit.delta_n_radps, 2.0**-43), 16)
    for value in (orbit.cuc_rad, orbit.cus_rad):
        three.sint(round(value / 2.0**-29), 16)
    for value in (orbit.crc_m, orbit.crs_m):
        three.sint(round(value / 2.0**-5), 16)
    three.uint(107, 8)
    four.uint(int(ephemeris.satellite[1:]), 6)
    for value in (orbit.cic_rad, orbit.cis_rad):
        four.sint(round(value / 2.0**-29), 16)
    four.uint(round(ephemeris.toc_s) // 60, 14)
    four.sint(round(ephemeris.clock_bias_s / 2.0**-34), 31)
    four.sint(round(ephemeris.clock_drift / 2.0**-46), 21)
    four.sint(round(ephemeris.clock_drift_rate_per_s / 2.0**-59), 6)
    five.uint(0, 41)
    five.sint(0, 10)
    five.sint(round(ephemeris.group_delay_s / 2.0**-32), 10)
    sick = not ephemeris.healthy
    for value, width in ((0, 2), (sick, 2), (0, 1), (sick, 1), (ephemeris.gps_week - 1024, 12), (tow_s, 20)):
        five.uint(int(value), width)
    for writer in words:
        writer.uint(0, 128 - writer.length)
    return [inav_page(writer.content()) for writer in words]


def _bch(eleven: int) -> int:
    """Code word of eleven bits by long division by x^4 + x + 1."""
    rest = eleven << 4
    for bit in range(14, 3, -1):
        if rest >> bit & 1:
            rest ^= 0b10011 << (bit - 4)
    return eleven << 4 | rest


def beidou_words(information: bytes) -> list[int]:
    """Ten words of 30 bits, as u-blox gives them, of 224 bits of information."""
    bits = int.from_bytes(information, "big")
    head = bits >> 198
    words = [head >> 11 << 15 | _bch(head & 0x7FF)]
    for at in range(9):
        part = bits >> (176 - 22 * at) & 0x3FFFFF
        high, low = _bch(part >> 11), _bch(part & 0x7FF)
        words.append(part << 8 | (high & 0xF) << 4 | low & 0xF)
    return words


def beidou_subframes(ephemeris: Ephemeris, sow_s: int = 455_400) -> list[list[int]]:
    """Subframes 1 to 3 (D1) of a BeiDou ephemeris."""
    orbit = _kepler_of(ephemeris)
    writers = [BitWriter() for _ in range(3)]
    for number, writer in enumerate(writers, start=1):
        for value, width in ((0b11100010010, 11), (0, 4), (number, 3), (sow_s + 6 * (number - 1), 20)):
            writer.uint(value, width)
    one, two, three = writers
    toe = round(ephemeris.toe_s - 14.0) // 8
    for value, width in ((not ephemeris.healthy, 1), (0, 5), (1, 4), (ephemeris.gps_week - 1356, 13), (toe, 17)):
        one.uint(int(value), width)
    one.sint(round(ephemeris.group_delay_s / 1e-10), 10)
    one.uint(0, 10 + 64)
    one.sint(round(ephemeris.clock_drift_rate_per_s / 2.0**-66), 11)
    one.sint(round(ephemeris.clock_bias_s / 2.0**-33), 24)
    one.sint(round(ephemeris.clock_drift / 2.0**-50), 22)
    one.uint(ephemeris.issue, 5)
    two.sint(_angle(orbit.delta_n_radps, 2.0**-43), 16)
    two.sint(round(orbit.cuc_rad / 2.0**-31), 18)
    two.sint(_angle(orbit.m0_rad), 32)
    two.uint(round(orbit.eccentricity / 2.0**-33), 32)
    two.sint(round(orbit.cus_rad / 2.0**-31), 18)
    two.sint(round(orbit.crc_m / 2.0**-6), 18)
    two.sint(round(orbit.crs_m / 2.0**-6), 18)
    two.uint(round(orbit.sqrt_a / 2.0**-19), 32)
    two.uint(toe >> 15, 2)
    three.uint(toe & 0x7FFF, 15)
    three.sint(_angle(orbit.i0_rad), 32)
    three.sint(round(orbit.cic_rad / 2.0**-31), 18)
    three.sint(_angle(orbit.omega_dot_radps, 2.0**-43), 24)
    three.sint(round(orbit.cis_rad / 2.0**-31), 18)
    three.sint(_angle(orbit.i_dot_radps, 2.0**-43), 14)
    three.sint(_angle(orbit.omega0_rad), 32)
    three.sint(_angle(orbit.omega_rad), 32)
    three.uint(0, 1)
    assert {writer.length for writer in writers} == {224}
    return [beidou_words(writer.content()) for writer in writers]


def glonass_words(data: int) -> list[int]:
    """Four words of 32 bits, as u-blox gives them, of the 77 bits of a string without its checks.

    Each check bit holds the parity of the places of the Hamming code that have its bit set, the last
    one that of the whole string (GLONASS ICD 5.1, table 4.13).
    """
    places = [place for place in range(3, 128) if place & (place - 1)][:77]
    string = data << 8
    for check in range(7):
        members = [index for index, place in enumerate(places) if place >> check & 1]
        string |= sum(data >> index & 1 for index in members) % 2 << check
    string |= (string.bit_count() & 1) << 7
    whole = string << (128 - 85)
    return [whole >> shift & 0xFFFFFFFF for shift in (96, 64, 32, 0)]


def glonass_strings(ephemeris: Ephemeris) -> list[list[int]]:
    """Strings 1 to 4 of a GLONASS ephemeris."""
    orbit = ephemeris.orbit
    assert isinstance(orbit, StateVectorOrbit)
    tb_s = (ephemeris.issue * 900) % 86_400
    frame_s = tb_s - 1800
    writers = [BitWriter() for _ in range(4)]
    for number, writer in enumerate(writers, start=1):
        writer.uint(0, 1)
        writer.uint(number, 4)
    one, two, three, four = writers
    one.uint(0, 4)
    one.uint(frame_s // 3600, 5)
    one.uint(frame_s % 3600 // 60, 6)
    one.uint(frame_s % 60 // 30, 1)
    two.uint(0 if ephemeris.healthy else 4, 3)
    two.uint(0, 1)
    two.uint(ephemeris.issue, 7)
    two.uint(0, 5)
    three.uint(0, 1)
    three.magnitude(round(ephemeris.clock_drift / 2.0**-40), 11)
    three.uint(0, 4)
    axes = zip(orbit.velocity_mps, orbit.acceleration_mps2, orbit.position_m, strict=True)
    for writer, (speed, pull, place) in zip((one, two, three), axes, strict=True):
        writer.magnitude(round(speed / 1e3 / 2.0**-20), 24)
        writer.magnitude(round(pull / 1e3 / 2.0**-30), 5)
        writer.magnitude(round(place / 1e3 / 2.0**-11), 27)
    four.magnitude(round(-ephemeris.clock_bias_s / 2.0**-30), 22)
    four.uint(0, 77 - four.length)
    assert {writer.length for writer in writers} == {77}
    return [glonass_words(int.from_bytes(writer.content(), "big") >> 3) for writer in writers]
