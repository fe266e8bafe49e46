"""Observations as the lines of a RINEX 3.04 file.

Source: RINEX 3.04 (IGS/RTCM 2018), tables A2 and A3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta

import numpy as np

from schemas.gnss_time import WEEK_S
from services.gnss_receiver.observations import SYSTEMS, Observations, satellite_name
from services.gnss_receiver.rinex_signals import QUANTITIES

_GPS_EPOCH = datetime(1980, 1, 6)  # noqa: DTZ001 - GPS time has no zone
_TICKS = 10_000_000
_TYPES_PER_LINE = 13
_ABSENT = " " * 16


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingHeader:
    """What is known of a recording besides its measurements."""

    marker: str = "unknown"
    observer: str = "unknown"
    receiver: str = "unknown"
    antenna: str = "unknown"
    approximate_position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Earth-centred, Earth-fixed."""
    interval_s: float | None = None
    glonass_channels: Mapping[int, int] = field(default_factory=dict)
    """Frequency channel by slot number."""
    comments: tuple[str, ...] = ()


def observation_lines(observations: Observations, header: RecordingHeader) -> Iterator[str]:
    """Lines of a RINEX 3.04 observation file on the GPS time scale.

    Signals stand in the order of their names. A measurement of exactly zero cannot be told from none in
    RINEX and is read back as none. Raises ValueError for a figure that does not fit its field, for a
    satellite that comes back after another one within an epoch, and when nothing is measured at all.
    """
    types = _types(observations)
    if not types:
        msg = "there are no measurements to write"
        raise ValueError(msg)
    first = _calendar(int(observations.gps_week[0]), float(observations.tow_s[0]))
    yield from _header(types, first, header)
    for index in range(len(observations)):
        yield from _epoch_lines(observations, index, types)


def _types(observations: Observations) -> dict[str, tuple[str, ...]]:
    """Observables of each system: what is measured somewhere, ordered by signal."""
    system = observations.satellite // 100
    measured = np.isfinite(
        [
            observations.pseudorange_m,
            observations.carrier_phase_cycles,
            observations.doppler_hz,
            observations.cn0_dbhz,
        ]
    )
    measured[1] |= observations.lock_lost > 0
    types: dict[str, tuple[str, ...]] = {}
    for index, letter in enumerate(SYSTEMS):
        codes = []
        for code in np.argsort(observations.signals).tolist():
            rows = (system == index) & (observations.signal == code)
            codes += [
                f"{quantity}{observations.signals[code]}"
                for quantity, column in zip(QUANTITIES, measured, strict=True)
                if bool((column & rows).any())
            ]
        if codes:
            types[letter] = tuple(codes)
    return types


def _header(types: Mapping[str, tuple[str, ...]], first: str, header: RecordingHeader) -> Iterator[str]:
    system = next(iter(types)) if len(types) == 1 else "M"
    yield _record(f"{'3.04':>9}{'':11}{'OBSERVATION DATA':20}{system}", "RINEX VERSION / TYPE")
    yield _record(f"{'kirotei':20}{'':20}{'':20}", "PGM / RUN BY / DATE")
    for comment in header.comments:
        yield _record(comment, "COMMENT")
    yield _record(header.marker, "MARKER NAME")
    yield _record(f"{header.observer:20.20}", "OBSERVER / AGENCY")
    yield _record(f"{'':20}{header.receiver:20.20}", "REC # / TYPE / VERS")
    yield _record(f"{'':20}{header.antenna:20.20}", "ANT # / TYPE")
    yield _record("".join(f"{part:14.4f}" for part in header.approximate_position_m), "APPROX POSITION XYZ")
    yield _record(f"{0.0:14.4f}" * 3, "ANTENNA: DELTA H/E/N")
    for letter, codes in types.items():
        for at in range(0, len(codes), _TYPES_PER_LINE):
            start = f"{letter}  {len(codes):3d}" if at == 0 else " " * 6
            yield _record(
                start + "".join(f" {code}" for code in codes[at : at + _TYPES_PER_LINE]), "SYS / # / OBS TYPES"
            )
    yield _record("DBHZ", "SIGNAL STRENGTH UNIT")
    if header.interval_s is not None:
        yield _record(f"{header.interval_s:10.3f}", "INTERVAL")
    yield _record(f"{_spaced(first)}{'':5}GPS", "TIME OF FIRST OBS")
    for letter, codes in types.items():
        for code in (code for code in codes if code[0] == "L"):
            yield _record(f"{letter} {code} {0.0:8.5f}", "SYS / PHASE SHIFT")
    if "R" in types:
        yield from _glonass_records(header.glonass_channels)
    yield _record("", "END OF HEADER")


def _glonass_records(channels: Mapping[int, int]) -> Iterator[str]:
    slots = [f" R{slot:02d} {channel:2d}" for slot, channel in sorted(channels.items())]
    for at in range(0, max(len(slots), 1), 8):
        start = f"{len(slots):3d}" if at == 0 else " " * 3
        yield _record(start + "".join(slots[at : at + 8]), "GLONASS SLOT / FRQ #")
    yield _record("", "GLONASS COD/PHS/BIS")


def _epoch_lines(observations: Observations, index: int, types: Mapping[str, tuple[str, ...]]) -> Iterator[str]:
    rows = range(int(observations.first_row[index]), int(observations.first_row[index + 1]))
    fields: dict[int, dict[str, str]] = {}
    previous = -1
    for row in rows:
        satellite = int(observations.satellite[row])
        if satellite != previous and satellite in fields:
            msg = f"epoch {index}: {satellite_name(satellite)} comes back after another satellite"
            raise ValueError(msg)
        previous = satellite
        fields.setdefault(satellite, {}).update(_fields(observations, row))
    calendar = _calendar(int(observations.gps_week[index]), float(observations.tow_s[index]))
    yield f"> {calendar}  0{len(fields):3d}"
    for satellite, of_satellite in fields.items():
        name = satellite_name(satellite)
        line = "".join(of_satellite.get(code, _ABSENT) for code in types[name[0]]) if of_satellite else ""
        yield f"{name}{line}".rstrip()


def _fields(observations: Observations, row: int) -> dict[str, str]:
    """Fields of one row by observable, 16 characters each."""
    signal = observations.signals[observations.signal[row]]
    columns = (
        observations.pseudorange_m,
        observations.carrier_phase_cycles,
        observations.doppler_hz,
        observations.cn0_dbhz,
    )
    fields = {}
    for quantity, column in zip(QUANTITIES, columns, strict=True):
        value = float(column[row])
        lost = int(observations.lock_lost[row]) if quantity == "L" else 0
        if math.isfinite(value) or lost:
            text = f"{value:14.3f}" if math.isfinite(value) else " " * 14
            if len(text) > 14:  # noqa: PLR2004 - F14.3
                name = satellite_name(int(observations.satellite[row]))
                msg = f"{quantity}{signal} of {name} is {value:g}, too large for RINEX"
                raise ValueError(msg)
            fields[f"{quantity}{signal}"] = f"{text}{lost or ' '} "
    return fields


def _calendar(week: int, tow_s: float) -> str:
    """Calendar time as in an epoch line, to 0.1 microseconds: '2016 06 06 11 10 41.7000000'."""
    seconds, ticks = divmod(week * WEEK_S * _TICKS + round(tow_s * _TICKS), _TICKS)
    moment = _GPS_EPOCH + timedelta(seconds=seconds)
    return f"{moment:%Y %m %d %H %M} {moment.second:2d}.{ticks:07d}"


def _spaced(calendar: str) -> str:
    """The same in the columns of `TIME OF FIRST OBS`: 5I6, F13.7."""
    *parts, second = calendar.split()
    return "".join(f"{int(part):6d}" for part in parts) + f"{second:>13}"


def _record(content: str, label: str) -> str:
    return f"{content:60.60}{label}"
