"""What a cellular modem answers about its signal, in decibels.

+CSQ and +CESQ by 3GPP TS 27.007, 8.5 and 8.69, whose numbers stand for steps (TS 45.008 8.1.4, TS 25.133 9.1, TS 36.133
9.1, TS 38.133 10.1): the middle of a step is given, at either end of the scale its edge. +QCSQ as Quectel's modems have
it. +CEREG by TS 27.007, 10.1.22.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

_ANSWER: Final = re.compile(r"^\+(C5?EREG|CESQ|CSQ|QCSQ):\s*(.*)$")
_WORD: Final = re.compile(r'"([^"]*)"|([^,\s]+)|(?<=,)(?=,)')
_CELL: Final = re.compile(r'"([0-9A-Fa-f]{1,9})"')
_LTE: Final = ("LTE", "CAT-M1", "eMTC", "CAT-NB1", "NBIoT")
_LONGEST: Final = 200


@dataclass(frozen=True, slots=True)
class Scale:
    """Steps numbered from 0; step 0 is everything below `low`, the last one everything from `high` on."""

    low: float
    high: float
    step: float
    unknown: int

    @property
    def last(self) -> int:
        """Number of the last step."""
        return round((self.high - self.low) / self.step) + 1

    def value(self, number: int) -> float | None:
        """Middle of a step; None for the number that means unknown, and for one beyond the scale."""
        if number == self.unknown or not 0 <= number <= self.last:
            return None
        if number == 0:
            return self.low
        return min(self.low + (number - 0.5) * self.step, self.high)


RXLEV: Final = Scale(-110.0, -48.0, 1.0, 99)
RSCP: Final = Scale(-120.0, -25.0, 1.0, 255)
RSRQ: Final = Scale(-19.5, -3.0, 0.5, 255)
RSRP: Final = Scale(-140.0, -44.0, 1.0, 255)
SS_RSRQ: Final = Scale(-43.0, 20.0, 0.5, 255)
SS_RSRP: Final = Scale(-156.0, -31.0, 1.0, 255)
SS_SINR: Final = Scale(-23.0, 40.0, 0.5, 255)
_CESQ_RXLEV, _CESQ_RSCP, _CESQ_RSRQ, _CESQ_RSRP, _CESQ_SS = 0, 2, 4, 5, 6
_CSQ_LAST, _CSQ_UNKNOWN = 31, 99


@dataclass(frozen=True, slots=True)
class SignalReport:
    """What one answer told; what it did not is None."""

    command: str
    rssi_dbm: float | None = None
    """Everything on the carrier."""
    rsrp_dbm: float | None = None
    """Of the cell's reference signals (RSCP of its pilot in UMTS)."""
    rsrq_db: float | None = None
    sinr_db: float | None = None
    cell: str | None = None
    """Of the serving cell, where the answer tells it."""
    technology: str = ""


def report_of(line: str) -> SignalReport | None:
    """What a line says about the signal; None for any other line, and for one that is broken."""
    match = _ANSWER.match(line.strip()) if len(line) <= _LONGEST else None
    if match is None:
        return None
    name, words = match[1], _words(match[2])
    if name == "CSQ":
        return _csq(words)
    if name == "CESQ":
        return _cesq(words)
    if name == "QCSQ":
        return _qcsq(words)
    return _registration(name, match[2])


def _words(text: str) -> list[str]:
    return [quoted or plain for quoted, plain in _WORD.findall(text)]


def _numbers(words: list[str]) -> list[int] | None:
    try:
        return [int(word) for word in words]
    except ValueError:
        return None


def _csq(words: list[str]) -> SignalReport | None:
    numbers = _numbers(words)
    if not numbers or not (0 <= numbers[0] <= _CSQ_LAST or numbers[0] == _CSQ_UNKNOWN):
        return None
    if numbers[0] == _CSQ_UNKNOWN:
        return SignalReport("CSQ")
    return SignalReport("CSQ", rssi_dbm=-113.0 + 2.0 * numbers[0])


def _cesq(words: list[str]) -> SignalReport | None:
    numbers = _numbers(words)
    if numbers is None or len(numbers) < _CESQ_SS:
        return None
    rsrp, rsrq = RSRP.value(numbers[_CESQ_RSRP]), RSRQ.value(numbers[_CESQ_RSRQ])
    rscp, sinr, technology = RSCP.value(numbers[_CESQ_RSCP]), None, "LTE"
    if len(numbers) >= _CESQ_SS + 3 and SS_RSRP.value(numbers[_CESQ_SS + 1]) is not None:
        rsrq, rsrp = SS_RSRQ.value(numbers[_CESQ_SS]), SS_RSRP.value(numbers[_CESQ_SS + 1])
        sinr, technology = SS_SINR.value(numbers[_CESQ_SS + 2]), "NR"
    elif rsrp is None and rscp is not None:
        rsrp, technology = rscp, "WCDMA"
    rssi = RXLEV.value(numbers[_CESQ_RXLEV])
    if rsrp is None:
        technology = "GSM" if rssi is not None else ""
    return SignalReport("CESQ", rssi, rsrp, rsrq, sinr, technology=technology)


def _qcsq(words: list[str]) -> SignalReport | None:
    """`"LTE",rssi,rsrp,sinr,rsrq`, SINR in fifths of a decibel from -20 dB on; `"WCDMA",rssi,rscp,ecio`; `"GSM",rssi`.

    `"NOSERVICE"` tells nothing but that.
    """
    technology, numbers = (words or [""])[0], _numbers(words[1:])
    match numbers:
        case [] if technology == "NOSERVICE":
            return SignalReport("QCSQ", technology=technology)
        case [rssi] if technology == "GSM":
            return SignalReport("QCSQ", rssi_dbm=float(rssi), technology=technology)
        case [rssi, rscp, _] if technology == "WCDMA":
            return SignalReport("QCSQ", float(rssi), float(rscp), technology=technology)
        case [rssi, rsrp, sinr, rsrq] if technology in _LTE:
            return SignalReport("QCSQ", float(rssi), float(rsrp), float(rsrq), sinr / 5.0 - 20.0, technology=technology)
        case _:
            return None


def _registration(name: str, text: str) -> SignalReport | None:
    """`n,stat,"tac","ci",AcT` when asked, `stat,"tac","ci",AcT` when it changes."""
    quoted = _CELL.findall(text)
    return SignalReport(name, cell=quoted[1].upper()) if len(quoted) > 1 else None
