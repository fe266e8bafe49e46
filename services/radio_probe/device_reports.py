"""What the bytes of an input say: reports of radios and of the weather, whatever they are written in."""

from __future__ import annotations

from typing import Protocol

from schemas.radio import RadioMeasurement, Weather
from services.radio_probe.modem_answers import SignalReport
from services.radio_probe.power_scan import ChannelPower, ScanSums
from services.radio_probe.report_fields import FieldReader, NoReportError
from services.radio_probe.report_rows import CsvRows, JsonRows, Lines
from services.radio_probe.settings import RadioInput

Report = RadioMeasurement | Weather


class Reports(Protocol):
    """Bytes in, reports out; a report without a time has t_ns 0."""

    @property
    def counts(self) -> dict[str, int]:
        """What was left out, by reason."""

    @property
    def reason(self) -> str:
        """What was last wrong, in words."""

    def feed(self, chunk: bytes) -> list[Report]:
        """Reports that the bytes complete."""

    def pause(self) -> list[Report]:
        """Reports that are complete because nothing more comes for now."""


class RowReports:
    """Lines of CSV or JSON."""

    def __init__(self, settings: RadioInput, side: str) -> None:
        """Know the columns and what they leave out."""
        self._lines = Lines()
        self._rows = JsonRows() if settings.format == "json" else CsvRows(settings.columns)
        usual = {"radio": settings.radio or settings.device, "channel": settings.channel, "side": side}
        station = {} if settings.axis_m is None else {"axis_m": settings.axis_m}
        self._reader: FieldReader[RadioMeasurement] | FieldReader[Weather] = (
            FieldReader(RadioMeasurement, usual) if settings.carries == "radio" else FieldReader(Weather, station)
        )
        self._broken = 0
        self.reason = ""

    @property
    def counts(self) -> dict[str, int]:
        """What was left out, by reason."""
        reader = self._reader
        return {
            "broken_lines": self._broken + self._lines.too_long,
            "unknown_columns": len(reader.unknown),
            "times_without_zone": reader.no_zone,
            "not_a_number": reader.no_number,
        }

    def feed(self, chunk: bytes) -> list[Report]:
        """Reports that the bytes complete."""
        out: list[Report] = []
        for line in self._lines.feed(chunk):
            row = self._rows.row(line)
            if isinstance(row, str):
                if row:
                    self._broken, self.reason = self._broken + 1, row
                continue
            known = len(self._reader.unknown)
            try:
                out.append(self._reader.read(row))
            except NoReportError as error:
                self._broken, self.reason = self._broken + 1, str(error)
            if len(self._reader.unknown) > known:
                self.reason = f"columns without meaning here: {', '.join(self._reader.unknown)}"
        return out

    def pause(self) -> list[Report]:
        """Nothing: every line is a report."""
        return []


class ScanReports:
    """Power scans."""

    def __init__(self, settings: RadioInput, side: str) -> None:
        """Know the channels."""
        self._settings = settings
        self._side = side
        self._lines = Lines()
        self._sums = ScanSums(settings.bands)
        self.reason = ""

    @property
    def counts(self) -> dict[str, int]:
        """What came, and what was left out."""
        return {**self._sums.counts, "broken_lines": self._lines.too_long}

    def feed(self, chunk: bytes) -> list[Report]:
        """Reports of the sweeps that the bytes complete."""
        return [self._report(one) for line in self._lines.feed(chunk) for one in self._sums.feed(line)]

    def pause(self) -> list[Report]:
        """The last sweep."""
        return [self._report(one) for one in self._sums.end()]

    def _report(self, one: ChannelPower) -> RadioMeasurement:
        settings = self._settings
        return RadioMeasurement(
            t_ns=one.t_ns,
            radio=settings.radio or settings.device,
            channel=one.channel,
            side="wayside" if self._side == "wayside" else "onboard",
            channel_power_dbm=round(one.power_db + settings.calibration_db, 2),
        )


def reports_of(settings: RadioInput, side: str) -> Reports:
    """Reader for an input that is not asked."""
    return ScanReports(settings, side) if settings.format == "scan" else RowReports(settings, side)


def modem_report(settings: RadioInput, side: str, signal: SignalReport) -> RadioMeasurement:
    """A modem's report: RSSI is what it hears on the carrier, RSRP what it has made out of the cell."""
    return RadioMeasurement(
        t_ns=0,
        radio=settings.radio or settings.device,
        channel=settings.channel,
        side="wayside" if side == "wayside" else "onboard",
        channel_power_dbm=signal.rssi_dbm,
        decoded_power_dbm=signal.rsrp_dbm,
        rsrq_db=signal.rsrq_db,
        snr_db=signal.sinr_db,
        cell=signal.cell or "",
    )
