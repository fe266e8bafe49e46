"""Epochs as Multiple Signal Messages MSM4 or MSM7 of RTCM 3.

Source: RTCM 10403.3, 3.5.16.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import Final, Literal

from schemas.gnss import Epoch
from schemas.gnss_time import GPS_EPOCH_UNIX_S, NS
from services.gnss_receiver.bit_fields import BitWriter
from services.gnss_receiver.carrier_frequency import signal_hz
from services.gnss_receiver.rtcm_msm_layout import (
    CHANNEL_UNKNOWN,
    CHANNEL_ZERO,
    FAMILY_OF,
    FINE_RATE_BITS,
    FINE_RATE_MPS,
    LAYOUTS,
    LIGHT_M_PER_MS,
    NO_ROUGH_MS,
    NO_ROUGH_RATE,
    ROUGH_MS,
    SIGNALS,
    lock_indicator,
    place_of,
)
from services.gnss_receiver.rtcm_time import BDT_BEHIND_MS, DAY_MS, MOSCOW_MS, WEEK_MS

_LIGHT_MPS: Final = 1000.0 * LIGHT_M_PER_MS
_MOST_CELLS: Final = 64
_LONGEST_GAP_MS: Final = 10_000
"""A signal that was away longer is locked anew."""
_FARTHEST_PHASE_M: Final = 500.0
"""The phase field reaches 1170 m from the rough range; beyond this its whole cycles are chosen anew."""
_PLACES: Final = {system: {name: place for place, name in names.items()} for system, names in SIGNALS.items()}


@dataclass(slots=True)
class _Track:
    """A signal that has been written before."""

    since_ms: int
    last_ms: int
    cycles: float
    """Whole cycles added to its phase, which begins anywhere."""


@dataclass(frozen=True, slots=True)
class _Cell:
    satellite: str
    signal: str
    range_m: float
    phase_m: float
    rate_mps: float
    cn0_dbhz: float
    lock_s: float
    half_cycle: bool


class MsmWriter:
    """Writes the epochs of one receiver, in their order; keeps lock times and whole cycles between them."""

    def __init__(self, station: int, kind: Literal[4, 7] = 7) -> None:
        """Speak for a station (0 to 4095) in MSM4 or MSM7."""
        self._station = station
        self._kind = kind
        self._tracks: dict[tuple[str, str], _Track] = {}

    def messages(self, epoch: Epoch, channels: Mapping[str, int]) -> list[bytes]:
        """Messages of one epoch, the multiple-message bit set in all but the last.

        `channels` are GLONASS frequency channels by satellite; without its channel a satellite is
        sent without phase and rate. Signals that the standard has no place for are left out, and
        so are satellites without any pseudorange.
        """
        gps_ms = epoch.gps_week * WEEK_MS + round(1000.0 * epoch.tow_s)
        by_system: dict[str, list[_Cell]] = {}
        for row, (satellite, signal) in enumerate(zip(epoch.satellites, epoch.signals, strict=True)):
            if signal in _PLACES.get(satellite[0], {}):
                by_system.setdefault(satellite[0], []).append(self._cell(epoch, row, gps_ms, channels))
        groups = [(system, group) for system, cells in by_system.items() for group in _groups(cells)]
        field_of = {system: _epoch_field(system, gps_ms, epoch.t_ns) for system, _ in groups}
        return [
            self._message(system, field_of[system], group, channels, more=index + 1 < len(groups))
            for index, (system, group) in enumerate(groups)
        ]

    def _cell(self, epoch: Epoch, row: int, gps_ms: int, channels: Mapping[str, int]) -> _Cell:
        satellite, signal = epoch.satellites[row], epoch.signals[row]
        range_m, lost = float(epoch.pseudorange_m[row]), int(epoch.lock_lost[row])
        hz = signal_hz(satellite[0], signal, channels.get(satellite))
        wave_m = _LIGHT_MPS / hz if hz else nan
        phase_m = float(epoch.carrier_phase_cycles[row]) * wave_m
        track = self._tracks.get((satellite, signal))
        if track is None or lost & 1 or not 0 < gps_ms - track.last_ms <= _LONGEST_GAP_MS:
            track = _Track(gps_ms, gps_ms, 0.0)
        track.last_ms = gps_ms
        if not abs(phase_m + track.cycles * wave_m - range_m) <= _FARTHEST_PHASE_M and isfinite(phase_m + range_m):
            track.cycles, track.since_ms = float(round((range_m - phase_m) / wave_m)), gps_ms
        if isfinite(phase_m):
            self._tracks[satellite, signal] = track
        return _Cell(
            satellite=satellite,
            signal=signal,
            range_m=range_m,
            phase_m=phase_m + track.cycles * wave_m,
            rate_mps=-float(epoch.doppler_hz[row]) * wave_m,
            cn0_dbhz=float(epoch.cn0_dbhz[row]),
            lock_s=(gps_ms - track.since_ms) / 1000.0,
            half_cycle=bool(lost & 2),
        )

    def _message(
        self, system: str, field: int, cells: Sequence[_Cell], channels: Mapping[str, int], *, more: bool
    ) -> bytes:
        writer = BitWriter()
        writer.uint(10 * FAMILY_OF[system] + self._kind, 12)
        writer.uint(self._station, 12)
        writer.uint(field, 30)
        writer.uint(int(more), 1)
        writer.uint(0, 18)
        satellites = sorted({cell.satellite for cell in cells}, key=place_of)
        signals = sorted({_PLACES[system][cell.signal] for cell in cells})
        writer.uint(sum(1 << (64 - place_of(satellite)) for satellite in satellites), 64)
        writer.uint(sum(1 << (32 - place) for place in signals), 32)
        placed = {(cell.satellite, _PLACES[system][cell.signal]): cell for cell in cells}
        grid = [(satellite, place) for satellite in satellites for place in signals]
        for spot in grid:
            writer.uint(int(spot in placed), 1)
        ordered = [placed[spot] for spot in grid if spot in placed]
        rough = {satellite: _rough(satellite, ordered) for satellite in satellites}
        self._write_satellites(writer, satellites, rough, channels)
        self._write_cells(writer, ordered, rough)
        return writer.content()

    def _write_satellites(
        self,
        writer: BitWriter,
        satellites: Sequence[str],
        rough: Mapping[str, tuple[int, int]],
        channels: Mapping[str, int],
    ) -> None:
        rates = LAYOUTS[self._kind].with_rate
        for satellite in satellites:
            writer.uint(rough[satellite][0] // 1024, 8)
        if rates:
            for satellite in satellites:
                glonass = channels.get(satellite, CHANNEL_UNKNOWN - CHANNEL_ZERO) + CHANNEL_ZERO
                writer.uint(glonass if satellite[0] == "R" else 0, 4)
        for satellite in satellites:
            writer.uint(rough[satellite][0] % 1024, 10)
        if rates:
            for satellite in satellites:
                writer.sint(rough[satellite][1], 14)

    def _write_cells(self, writer: BitWriter, cells: Sequence[_Cell], rough: Mapping[str, tuple[int, int]]) -> None:
        layout = LAYOUTS[self._kind]
        for cell in cells:
            _fine(writer, cell.range_m / LIGHT_M_PER_MS - _rough_ms(rough, cell), layout.range_ms, layout.range_bits)
        for cell in cells:
            _fine(writer, cell.phase_m / LIGHT_M_PER_MS - _rough_ms(rough, cell), layout.phase_ms, layout.phase_bits)
        for cell in cells:
            writer.uint(lock_indicator(cell.lock_s, layout.lock_bits), layout.lock_bits)
        for cell in cells:
            writer.uint(int(cell.half_cycle), 1)
        for cell in cells:
            strength = round(cell.cn0_dbhz / layout.cn0_db) if isfinite(cell.cn0_dbhz) else 0
            writer.uint(min(max(strength, 0), (1 << layout.cn0_bits) - 1), layout.cn0_bits)
        if layout.with_rate:
            for cell in cells:
                metres = rough[cell.satellite][1]
                fine_mps = cell.rate_mps - metres if metres != NO_ROUGH_RATE else nan
                _fine(writer, fine_mps, FINE_RATE_MPS, FINE_RATE_BITS)


def _groups(cells: Sequence[_Cell]) -> list[list[_Cell]]:
    """Cells of one system in messages of at most 64 places, whole satellites together."""
    ranged = {cell.satellite for cell in cells if isfinite(cell.range_m)}
    kept = [cell for cell in cells if cell.satellite in ranged]
    satellites = sorted(ranged, key=place_of)
    size = max(_MOST_CELLS // max(len({cell.signal for cell in kept}), 1), 1)
    return [
        [cell for cell in kept if cell.satellite in satellites[at : at + size]]
        for at in range(0, len(satellites), size)
    ]


def _rough(satellite: str, cells: Sequence[_Cell]) -> tuple[int, int]:
    """Rough range [2^-10 ms] and rate [m/s] of a satellite, from its first signals that have them."""
    own = [cell for cell in cells if cell.satellite == satellite]
    range_m = next(cell.range_m for cell in own if isfinite(cell.range_m))
    steps = round(range_m / LIGHT_M_PER_MS / ROUGH_MS)
    rate = next((round(cell.rate_mps) for cell in own if isfinite(cell.rate_mps)), NO_ROUGH_RATE)
    if not 0 <= steps < NO_ROUGH_MS * 1024:
        msg = f"a pseudorange of {range_m} m to {satellite} does not fit into the message"
        raise ValueError(msg)
    return steps, rate if abs(rate) < -NO_ROUGH_RATE else NO_ROUGH_RATE


def _rough_ms(rough: Mapping[str, tuple[int, int]], cell: _Cell) -> float:
    return rough[cell.satellite][0] * ROUGH_MS


def _fine(writer: BitWriter, difference: float, scale: float, width: int) -> None:
    """Write a difference, or that there is none where it is unknown or does not fit."""
    nothing = -(1 << (width - 1))
    whole = round(difference / scale) if isfinite(difference) else nothing
    writer.sint(whole if abs(whole) < -nothing else nothing, width)


def _epoch_field(system: str, gps_ms: int, t_ns: int) -> int:
    """Epoch of a message on the time scale of its system."""
    if system == "R":
        utc_ms = round((t_ns - GPS_EPOCH_UNIX_S * NS) / 1e6)
        days, day_ms = divmod(utc_ms + MOSCOW_MS, DAY_MS)
        return days % 7 << 27 | day_ms
    return (gps_ms - (BDT_BEHIND_MS if system == "C" else 0)) % WEEK_MS
