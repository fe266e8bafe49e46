"""Positions as NMEA 0183 sentences: GGA, RMC, GST.

Source: NMEA 0183 4.11, 6.3. What is not known stays blank; nothing is made up.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import Final

from schemas.gnss import Fix
from schemas.gnss_time import NS

TALKER: Final = "GN"
_KNOT_MPS: Final = 1852.0 / 3600.0
_NONE, _AUTONOMOUS, _DIFFERENTIAL, _ESTIMATED = 0, 1, 2, 6
"""Qualities of GGA."""
_MODES: Final = {_NONE: "N", _AUTONOMOUS: "A", _DIFFERENTIAL: "D", _ESTIMATED: "E"}
"""Modes of RMC."""
_MINUTE_DIGITS: Final = 6
"""A millionth of a minute is 2 mm."""
_STANDING_MPS: Final = 0.1
"""Below this a course means nothing and stays blank."""
_MOST_SATELLITES: Final = 99


def sentence(body: str) -> bytes:
    r"""Sentence of a body: `$`, check and line end around it.

    >>> sentence("GPGLL,5300.97914,N,00259.98174,E,125926,A")
    b'$GPGLL,5300.97914,N,00259.98174,E,125926,A*28\r\n'
    """
    check = 0
    for character in body.encode("ascii"):
        check ^= character
    return f"${body}*{check:02X}\r\n".encode("ascii")


def sentences(fix: Fix, geoid_m: float | None = None) -> bytes:
    """GGA, RMC and GST of a fix; `geoid_m` is the geoid's height above the ellipsoid there, where it is known.

    Without it GGA bears the ellipsoidal height with a separation of zero, so that their sum, which
    listeners form, is right. A fix that is `none` gives sentences without a place and quality 0.
    """
    bodies = (_gga(fix, geoid_m), _rmc(fix), _gst(fix))
    return b"".join(sentence(TALKER + body) for body in bodies)


def position_report(t_ns: int, lat_deg: float, lon_deg: float, h_m: float) -> bytes:
    """GGA that tells an NTRIP caster where its listener is."""
    fix = Fix(
        t_ns=t_ns,
        gps_week=0,
        tow_s=0.0,
        method="original",
        status="fix",
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        h_m=h_m,
        satellites_used=10,
        satellites_flagged=0,
        hdop=1.0,
    )
    return sentence(TALKER + _gga(fix, None))


def _quality(fix: Fix) -> int:
    if fix.status == "none" or fix.lat_deg is None or fix.lon_deg is None:
        return _NONE
    if fix.status == "predicted":
        return _ESTIMATED
    # A few corrected satellites among many make no differential position.
    return _DIFFERENTIAL if 2 * fix.satellites_corrected > fix.satellites_used else _AUTONOMOUS


def _clock(t_ns: int) -> tuple[str, str]:
    """Time of day and date, to the nearest hundredth of a second."""
    hundredths = (t_ns + NS // 200) // (NS // 100)
    moment = datetime.fromtimestamp(hundredths // 100, UTC)
    return f"{moment:%H%M%S}.{hundredths % 100:02d}", f"{moment:%d%m%y}"


def _angle(angle_deg: float, digits: int, hemispheres: str) -> str:
    """Degrees and minutes, and the hemisphere.

    >>> _angle(-0.5, 2, "NS")
    '0030.000000,S'
    """
    scale = 60 * 10**_MINUTE_DIGITS
    degrees, parts = divmod(round(abs(angle_deg) * scale), scale)
    minutes = parts / 10**_MINUTE_DIGITS
    width = 3 + _MINUTE_DIGITS
    return f"{degrees:0{digits}d}{minutes:0{width}.{_MINUTE_DIGITS}f},{hemispheres[angle_deg < 0]}"


def _place(fix: Fix) -> str:
    if _quality(fix) == _NONE or fix.lat_deg is None or fix.lon_deg is None:
        return ",,,"
    return f"{_angle(fix.lat_deg, 2, 'NS')},{_angle(fix.lon_deg, 3, 'EW')}"


def _gga(fix: Fix, geoid_m: float | None) -> str:
    quality = _quality(fix)
    satellites = f"{min(fix.satellites_used, _MOST_SATELLITES):02d}"
    hdop = f"{fix.hdop:.1f}" if fix.hdop is not None and quality else ""
    height, separation = "", ""
    if fix.h_m is not None and quality:
        height, separation = f"{fix.h_m - (geoid_m or 0.0):.3f}", f"{geoid_m or 0.0:.3f}"
    return f"GGA,{_clock(fix.t_ns)[0]},{_place(fix)},{quality},{satellites},{hdop},{height},M,{separation},M,,"


def _rmc(fix: Fix) -> str:
    quality = _quality(fix)
    clock, day = _clock(fix.t_ns)
    valid = "A" if quality not in (_NONE, _ESTIMATED) else "V"
    speed, course = "", ""
    if fix.ve_mps is not None and fix.vn_mps is not None and quality:
        speed_mps = math.hypot(fix.ve_mps, fix.vn_mps)
        speed = f"{speed_mps / _KNOT_MPS:.3f}"
        if speed_mps >= _STANDING_MPS:
            course = f"{round(math.degrees(math.atan2(fix.ve_mps, fix.vn_mps)) % 360.0, 2) % 360.0:.2f}"
    return f"RMC,{clock},{valid},{_place(fix)},{speed},{course},{day},,,{_MODES[quality]},V"


def _gst(fix: Fix) -> str:
    """Deviations; the horizontal one is the root of both squares, and half of it each way is all that is known."""
    north = ""
    if fix.sigma_horizontal_m is not None and _quality(fix):
        north = f"{fix.sigma_horizontal_m / math.sqrt(2.0):.3f}"
    return f"GST,{_clock(fix.t_ns)[0]},,,,,{north},{north},"
