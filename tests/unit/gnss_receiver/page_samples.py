"""Messages that come in pages, bit by bit: Galileo's F/NAV, BeiDou's D2. Ephemerides as in broadcast_samples."""

from __future__ import annotations

import math

from schemas.gnss import Ephemeris, KeplerOrbit
from services.gnss_receiver.bit_fields import BitWriter
from services.gnss_receiver.crc24q import crc24q_of_bits
from tests.unit.gnss_receiver.broadcast_samples import beidou_words

Field = tuple[int, int]
"""Figure and width; negative figures are written in two's complement."""


def _angle(value_rad: float, step: float = 2.0**-31) -> int:
    return round(value_rad / math.pi / step)


def _written(fields: list[Field]) -> BitWriter:
    writer = BitWriter()
    for value, width in fields:
        writer.uint(value % (1 << width), width)
    return writer


def _kepler_of(ephemeris: Ephemeris) -> KeplerOrbit:
    assert isinstance(ephemeris.orbit, KeplerOrbit)
    return ephemeris.orbit


def fnav_words(fields: list[Field]) -> list[int]:
    """Eight words of 32 bits, as u-blox gives them, of a page's type and data."""
    writer = _written(fields)
    data = int.from_bytes(writer.content(), "big") >> (-writer.length % 8)
    data <<= 214 - writer.length
    whole = (data << 24 | crc24q_of_bits(data, 214)) << (256 - 238)
    return [whole >> shift & 0xFFFFFFFF for shift in range(224, -1, -32)]


def fnav_pages(ephemeris: Ephemeris, tow_s: int = 455_600) -> list[list[int]]:
    """Page types 1 to 4 of a Galileo ephemeris (OS SIS ICD 2.1, 4.2)."""
    orbit, issue = _kepler_of(ephemeris), ephemeris.issue
    week, number, sick = ephemeris.gps_week - 1024, int(ephemeris.satellite[1:]), int(not ephemeris.healthy)
    clock = (ephemeris.clock_bias_s / 2.0**-34, ephemeris.clock_drift / 2.0**-46)
    one: list[Field] = [(1, 6), (number, 6), (issue, 10), (round(ephemeris.toc_s) // 60, 14)]
    one += [(round(clock[0]), 31), (round(clock[1]), 21), (round(ephemeris.clock_drift_rate_per_s / 2.0**-59), 6)]
    one += [(107, 8), (5, 11), (6, 11), (7, 14), (0, 5), (round(ephemeris.group_delay_s / 2.0**-32), 10)]
    one += [(sick, 2), (week, 12), (tow_s, 20), (sick, 1)]
    two: list[Field] = [(2, 6), (issue, 10), (_angle(orbit.m0_rad), 32), (_angle(orbit.omega_dot_radps, 2.0**-43), 24)]
    two += [(round(orbit.eccentricity / 2.0**-33), 32), (round(orbit.sqrt_a / 2.0**-19), 32)]
    two += [(_angle(orbit.omega0_rad), 32), (_angle(orbit.i_dot_radps, 2.0**-43), 14), (week, 12), (tow_s + 10, 20)]
    three: list[Field] = [(3, 6), (issue, 10), (_angle(orbit.i0_rad), 32), (_angle(orbit.omega_rad), 32)]
    three += [(_angle(orbit.delta_n_radps, 2.0**-43), 16)]
    three += [(round(value / 2.0**-29), 16) for value in (orbit.cuc_rad, orbit.cus_rad)]
    three += [(round(value / 2.0**-5), 16) for value in (orbit.crc_m, orbit.crs_m)]
    three += [(round(ephemeris.toe_s) // 60, 14), (week, 12), (tow_s + 20, 20)]
    four: list[Field] = [(4, 6), (issue, 10)]
    four += [(round(value / 2.0**-29), 16) for value in (orbit.cic_rad, orbit.cis_rad)]
    return [fnav_words(page) for page in (one, two, three, four)]


def _cut(value: int, width: int, high: int) -> tuple[Field, Field]:
    """A figure cut after its first `high` bits."""
    whole, low = value % (1 << width), width - high
    return (whole >> low, high), (whole & ((1 << low) - 1), low)


def beidou_pages(ephemeris: Ephemeris, sow_s: int = 455_400) -> list[list[int]]:
    """Pages 1 to 10 of subframe 1 (D2) of a geostationary BeiDou ephemeris.

    Fields page by page (BDS-SIS-ICD-B1I 3.0, 5.3): behind the number of the page
    22 bits of information in each word, 6 of them in the second one.
    """
    orbit = _kepler_of(ephemeris)
    toe = round(ephemeris.toe_s - 14.0) // 8
    a0 = _cut(round(ephemeris.clock_bias_s / 2.0**-33), 24, 12)
    a1_high, a1_low = _cut(round(ephemeris.clock_drift / 2.0**-50), 22, 4)
    a2 = round(ephemeris.clock_drift_rate_per_s / 2.0**-66)
    cuc = _cut(round(orbit.cuc_rad / 2.0**-31), 18, 14)
    e = _cut(round(orbit.eccentricity / 2.0**-33), 32, 10)
    cic = _cut(round(orbit.cic_rad / 2.0**-31), 18, 10)
    i0 = _cut(_angle(orbit.i0_rad), 32, 21)
    omega_dot = _cut(_angle(orbit.omega_dot_radps, 2.0**-43), 24, 19)
    omega = _cut(_angle(orbit.omega_rad), 32, 27)
    bodies: list[list[Field]] = [
        [
            *((int(not ephemeris.healthy), 1), (0, 5), (1, 4), (ephemeris.gps_week - 1356, 13), (toe, 17)),
            *((round(ephemeris.group_delay_s / 1e-10), 10), (0, 10)),
        ],
        [(0x3FFFF, 18)],  # the ionosphere, which is not read
        [(0, 6), (0, 22), (0, 10), *a0, a1_high],
        [a1_low, (a2, 11), (ephemeris.issue, 5), (_angle(orbit.delta_n_radps, 2.0**-43), 16), cuc[0]],
        [cuc[1], (_angle(orbit.m0_rad), 32), (round(orbit.cus_rad / 2.0**-31), 18), e[0]],
        [e[1], (round(orbit.sqrt_a / 2.0**-19), 32), cic[0]],
        [cic[1], (round(orbit.cis_rad / 2.0**-31), 18), (toe, 17), i0[0]],
        [i0[1], (round(orbit.crc_m / 2.0**-6), 18), (round(orbit.crs_m / 2.0**-6), 18), omega_dot[0]],
        [omega_dot[1], (_angle(orbit.omega0_rad), 32), omega[0]],
        [omega[1], (_angle(orbit.i_dot_radps, 2.0**-43), 14)],
    ]
    return [_beidou_page(page, sow_s + 3 * (page - 1), body) for page, body in enumerate(bodies, start=1)]


def _beidou_page(page: int, sow_s: int, body: list[Field], frame: int = 1) -> list[int]:
    writer = _written([(0b11100010010, 11), (0, 4), (frame, 3), (sow_s, 20), (page, 4), *body])
    # What is reserved, and the words that no page uses, hold ones: nothing may look at them.
    writer.uint((1 << (224 - writer.length)) - 1, 224 - writer.length)
    return beidou_words(writer.content())
