"""What a stream of UBX messages says: epochs, ephemerides, the ionosphere, the receiver's own position.

Source: u-blox F9 HPG 1.32 interface description, 3.15.14 (NAV-PVT), 3.17.5 and 3.17.8; message names and
NAV-PVT by pyubx2.
"""

from __future__ import annotations

from collections import Counter
from datetime import datetime
from typing import Final

from pyubx2 import GET, UBX_MSGIDS, UBXMessage
from pyubx2.exceptions import UBXMessageError, UBXTypeError

from schemas.gnss import Ephemeris, FixStatus, Ionosphere, OwnMode, OwnPosition
from schemas.gnss_time import GPS_EPOCH_UNIX_S, NS, WEEK_S, leap_seconds
from services.gnss_receiver.beidou_geo_subframes import BeidouGeoCollector
from services.gnss_receiver.beidou_subframes import BeidouCollector
from services.gnss_receiver.fnav_pages import FnavCollector
from services.gnss_receiver.glonass_strings import GlonassCollector
from services.gnss_receiver.heard import Heard
from services.gnss_receiver.inav_pages import InavCollector
from services.gnss_receiver.lnav_subframes import LnavCollector
from services.gnss_receiver.ubx_measurements import SYSTEMS, RawMeasurements

_PVT, _RAWX, _SFRBX = b"\x01\x07", b"\x02\x15", b"\x02\x13"
_SHORTEST_PVT: Final = 84
"""Of u-blox 7; later ones have 92."""
_SFRBX_HEAD: Final = 8
_CHANNEL_ZERO: Final = 7
_LAST_GEO, _SECOND_GEO = 5, 59
"""Up to the first and from the second number on BeiDou is geostationary and sends D2 (BDS-SIS-ICD-B1I, table 4-1)."""
_LNAV, _D1, _D2, _STRINGS = frozenset({0}), frozenset({0, 2, 4}), frozenset({1, 3, 10}), frozenset({0, 2})
_INAV, _FNAV = frozenset({1, 5}), frozenset({3})
"""Signals (u-blox's numbers) that carry the messages that are read."""
_AGES_S: Final = (None, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0)
"""Longest age that an index of NAV-PVT stands for."""
_UNSUPPORTED: Final = {
    "G": {3: "CNAV", 4: "CNAV", 6: "CNAV", 7: "CNAV"},
    "E": {8: "CNAV", 9: "CNAV", 10: "CNAV"},
    "C": dict.fromkeys((0, 2, 4), "D1_of_GEO")
    | dict.fromkeys((1, 3, 10), "D2_of_no_GEO")
    | {5: "CNAV1", 6: "CNAV1", 7: "CNAV2", 8: "CNAV2"},
    "J": {1: "L1S", 4: "CNAV", 5: "CNAV", 8: "CNAV", 9: "CNAV", 12: "LNAV_of_L1CB"},
    "S": {0: "SBAS"},
    "I": {0: "NavIC"},
}
"""Broadcast messages that are not decoded, by system and signal."""


class UbxStream:
    """Turns messages into what they say, in their order."""

    def __init__(self, counts: Counter[str], near_ns: int) -> None:
        """Start near a time (UTC, within some years); what is noticed is counted in `counts`."""
        self._counts = counts
        self._near_s = 0.0
        self.near(near_ns)
        self._measurements = RawMeasurements(counts)
        self._lnav = {system: LnavCollector(system) for system in "GJ"}
        self._inav = InavCollector()
        self._fnav = FnavCollector()
        self._with_inav: set[int] = set()
        self._beidou = BeidouCollector()
        self._beidou_geo = BeidouGeoCollector()
        self._glonass = GlonassCollector()
        self._given: dict[str, Ephemeris] = {}

    def near(self, t_ns: int) -> None:
        """Resolve weeks around another time (UTC)."""
        self._near_s = t_ns / NS - GPS_EPOCH_UNIX_S + leap_seconds(t_ns / NS)

    def add(self, content: bytes) -> list[Heard]:
        """What a message (class, identity and the rest) says. What cannot be read is counted by its name."""
        kind, message = content[:2], content[2:]
        name = UBX_MSGIDS.get(kind, f"{kind.hex()}")
        try:
            if kind == _RAWX:
                epoch = self._measurements.epoch(message)
                self._near_s = epoch.gps_week * WEEK_S + epoch.tow_s
                return [epoch]
            if kind == _SFRBX:
                return self._subframe(message)
            if kind == _PVT:
                position = own_position(message)
                return [] if position is None else [position]
        except ValueError:
            self._counts[f"bad_ubx_{name}"] += 1
            return []
        self._counts[f"not_read_ubx_{name}"] += 1
        return []

    def _subframe(self, message: bytes) -> list[Heard]:
        if len(message) < _SFRBX_HEAD or len(message) < _SFRBX_HEAD + 4 * message[4]:
            msg = f"RXM-SFRBX of {len(message)} bytes is cut short"
            raise ValueError(msg)
        system, number, signal, channel = SYSTEMS.get(message[0], "?"), *message[1:4]
        words = [int.from_bytes(message[at : at + 4], "little") for at in range(8, 8 + 4 * message[4], 4)]
        found: Ephemeris | Ionosphere | None = None
        match system:
            case "G" | "J" if signal in _LNAV:
                found = self._lnav[system].add(number, words, self._near_s)
            case "E" if signal in _INAV:
                found = self._inav.add(number, words, self._near_s)
                self._with_inav |= {number} if found is not None else set()
            case "E" if signal in _FNAV:
                found = self._fnav_of(number, words)
            case "C" if signal in _D1 and _LAST_GEO < number < _SECOND_GEO:
                found = self._beidou.add(number, words, self._near_s)
            case "C" if signal in _D2 and not _LAST_GEO < number < _SECOND_GEO:
                found = self._beidou_geo.add(number, words, self._near_s)
            case "R" if signal in _STRINGS:
                found = self._glonass.add(number, channel - _CHANNEL_ZERO, words, self._near_s)
            case _:
                name = _UNSUPPORTED.get(system, {}).get(signal, f"signal_{signal}")
                self._counts[f"unsupported_ubx_{system}_{name}"] += 1
        return [] if found is None else self._fresh(found)

    def _fnav_of(self, number: int, words: list[int]) -> Ephemeris | None:
        """Ephemeris of F/NAV, whose clock is meant for E5a: only of satellites that have given none of I/NAV."""
        found = self._fnav.add(number, words, self._near_s)
        if found is not None and number in self._with_inav:
            self._counts["fnav_left_out"] += 1
            return None
        return found

    def _fresh(self, found: Ephemeris | Ionosphere) -> list[Heard]:
        """What was found, unless it says what has been said: satellites repeat themselves."""
        if isinstance(found, Ionosphere):
            return [found]
        given = self._given.get(found.satellite)
        # The same orbit with another clock is Galileo's other message.
        if given is not None and (given.gps_week, given.toe_s, given.issue, given.healthy, given.clock_bias_s) == (
            found.gps_week,
            found.toe_s,
            found.issue,
            found.healthy,
            found.clock_bias_s,
        ):
            self._counts["ephemerides_repeated"] += 1
            return []
        self._given[found.satellite] = found
        return [found]


def own_position(message: bytes) -> OwnPosition | None:
    """Receiver's own position in a NAV-PVT message; None while it does not know the time.

    Raises ValueError for a message that cannot be read.
    """
    if len(message) < _SHORTEST_PVT:
        msg = f"NAV-PVT of {len(message)} bytes is cut short"
        raise ValueError(msg)
    try:
        pvt = UBXMessage(_PVT[:1], _PVT[1:], GET, payload=message)
        if not (pvt.validDate and pvt.validTime):
            return None
        moment = datetime(pvt.year, pvt.month, pvt.day, pvt.hour, pvt.min)  # noqa: DTZ001 - UTC by definition
    except (UBXMessageError, UBXTypeError, AttributeError) as error:
        msg = f"NAV-PVT cannot be read: {error}"
        raise ValueError(msg) from error
    since_s = round((moment - datetime(1970, 1, 1)).total_seconds()) + pvt.second  # noqa: DTZ001 - the same
    status, mode = _mode(pvt)
    age = getattr(pvt, "lastCorrectionAge", 0)
    if status == "none" or getattr(pvt, "invalidLlh", False):
        return OwnPosition(t_ns=since_s * NS + pvt.nano, protocol="ubx", status="none", mode="none")
    return OwnPosition(
        t_ns=since_s * NS + pvt.nano,
        protocol="ubx",
        status=status,
        mode=mode,
        lat_deg=pvt.lat,
        lon_deg=pvt.lon,
        h_m=pvt.height / 1000.0,
        ve_mps=pvt.velE / 1000.0,
        vn_mps=pvt.velN / 1000.0,
        vu_mps=-pvt.velD / 1000.0,
        satellites_used=pvt.numSV,
        sigma_horizontal_m=pvt.hAcc / 1000.0,
        sigma_vertical_m=pvt.vAcc / 1000.0,
        correction_age_s=_AGES_S[age] if age < len(_AGES_S) else None,
    )


def _mode(pvt: UBXMessage) -> tuple[FixStatus, OwnMode]:
    """How the receiver found its position: fix types 1 dead reckoning, 2 to 4 by satellites."""
    match pvt.fixType:
        case 1:
            return "predicted", "estimated"
        case 2 | 3 | 4 if pvt.gnssFixOk:
            if pvt.carrSoln:
                return "fix", "rtk_fixed" if pvt.carrSoln == 2 else "rtk_float"  # noqa: PLR2004 - 2 is fixed
            return "fix", "differential" if pvt.diffSoln else "autonomous"
        case _:
            return "none", "none"
