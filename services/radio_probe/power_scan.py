"""Power scans of software radios, as rtl_power and soapy_power write them, summed up to channels.

A line: date, time, lowest and highest frequency, width of a bin [Hz], samples, then the power of every bin [dB]. A
sweep over more than the receiver's width is several lines of one time. Decibels count from the receiver's full scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import isfinite, log10
from typing import Final

from services.radio_probe.settings import Band

NS: Final = 10**9
_HEAD: Final = 6
_MOST_BINS: Final = 1_000_000
_HIGHEST_HZ: Final = 1e13
_FINEST_HZ: Final = 1e-3


@dataclass(frozen=True, slots=True)
class ScanLine:
    """One line."""

    time: str
    """As it stands there."""
    low_hz: float
    step_hz: float
    powers_db: tuple[float, ...]
    """NaN where a bin holds no number."""


@dataclass(frozen=True, slots=True)
class ChannelPower:
    """Power of a channel over one sweep."""

    channel: str
    t_ns: int
    """UTC; 0 when the time cannot be read. rtl_power writes the local time of its host without a zone."""
    power_db: float


def scan_line(text: str) -> ScanLine | None:
    """A line of a scan; None for any other."""
    cells = [cell.strip() for cell in text.split(",")]
    if len(cells) <= _HEAD or len(cells) > _MOST_BINS:
        return None
    try:
        low_hz, high_hz, step_hz = (float(cell) for cell in cells[2:5])
        float(cells[5])
        powers = tuple(float(cell) for cell in cells[_HEAD:])
    except ValueError:
        return None
    if not (0.0 <= low_hz < high_hz <= _HIGHEST_HZ and _FINEST_HZ <= step_hz <= high_hz - low_hz):
        return None
    bins = max(round((high_hz - low_hz) / step_hz), 1)
    # rtl_power repeats the last bin at the end of its lines.
    return ScanLine(f"{cells[0]} {cells[1]}", low_hz, step_hz, powers[:bins])


class ScanSums:
    """Adds up the bins of every channel over a sweep."""

    def __init__(self, bands: Sequence[Band]) -> None:
        """Know the channels."""
        self._bands = tuple(bands)
        self._time = ""
        self._sums: dict[str, float] = {}
        self._newest_hz = -1.0
        self.counts = {"lines": 0, "no_scan": 0, "empty_bins": 0, "sweeps": 0}

    def feed(self, text: str) -> list[ChannelPower]:
        """Channels of the sweep before, once a line of the next one comes."""
        line = scan_line(text)
        if line is None:
            self.counts["no_scan"] += 1
            return []
        self.counts["lines"] += 1
        # A sweep begins anew where the frequency does not go on rising, too: some write every line's own time.
        out = self.end() if line.low_hz <= self._newest_hz else []
        if not self._sums:
            self._time = line.time
        self._newest_hz = line.low_hz
        for band in self._bands:
            self._add(band, line)
        return out

    def _add(self, band: Band, line: ScanLine) -> None:
        first = max(int((band.low_hz - line.low_hz) / line.step_hz + 0.5), 0)
        last = min(int((band.high_hz - line.low_hz) / line.step_hz + 0.5), len(line.powers_db))
        for power_db in line.powers_db[first:last]:
            if not (isfinite(power_db) and abs(power_db) < 1000.0):  # noqa: PLR2004 - beyond it powers have no number
                self.counts["empty_bins"] += 1
                continue
            self._sums[band.channel] = self._sums.get(band.channel, 0.0) + 10.0 ** (power_db / 10.0)

    def end(self) -> list[ChannelPower]:
        """Channels of what has come of a sweep so far."""
        t_ns = _time_ns(self._time)
        out = [ChannelPower(name, t_ns, 10.0 * log10(power)) for name, power in self._sums.items() if power > 0.0]
        self._sums, self._newest_hz = {}, -1.0
        self.counts["sweeps"] += bool(out)
        return out


def _time_ns(text: str) -> int:
    try:
        moment = datetime.fromisoformat(text).replace(tzinfo=UTC)
        return round(moment.replace(microsecond=0).timestamp()) * NS + moment.microsecond * 1000
    except (ValueError, OverflowError):
        return 0
