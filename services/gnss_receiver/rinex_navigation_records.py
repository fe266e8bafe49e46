"""Records of a RINEX navigation file as they stand there: satellite, epoch, figures.

Source: RINEX 2.11, tables A3, A4, A10 and A11; RINEX 3.05, tables A5 to A17.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from services.gnss_receiver.rinex_error import IssueLog, RinexError
from services.gnss_receiver.rinex_header import END, VERSION, VERSIONS_2, VERSIONS_3, label_of

NAVIGATION_LABELS = frozenset(
    {
        VERSION,
        END,
        "PGM / RUN BY / DATE",
        "COMMENT",
        "ION ALPHA",
        "ION BETA",
        "DELTA-UTC: A0,A1,T,W",
        "LEAP SECONDS",
        "CORR TO SYSTEM TIME",
        "D-UTC A0,A1,T,W,S,U",
        "IONOSPHERIC CORR",
        "TIME SYSTEM CORR",
    }
)
CONTINUATIONS = {"G": 7, "E": 7, "C": 7, "J": 7, "I": 7, "R": 3, "S": 3}
"""Lines after the first one; a GLONASS record of RINEX 3.05 may have a fourth."""
_RINEX_3_05 = "3.05"
_KINDS_2 = {"N": "G", "G": "R", "H": "S"}
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[DdEe]([+ -]?\d+))?")
_FIELD = 19
_NAME_3 = re.compile(r"[GRECJSI][ \d]\d")
_NAME_2 = re.compile(r"[ \d]\d")


@dataclass(frozen=True, slots=True)
class NavigationRecord:
    """One broadcast message; the epoch is on the satellite system's own time scale."""

    line: int
    system: str
    number: int
    calendar: tuple[int, int, int, int, int, float]
    """Year, month, day, hour, minute, second."""
    values: tuple[float | None, ...]
    """Figures in the order of the file, three of the first line, then four of each; None where blank."""
    times_within_week: bool
    """GLONASS frame times count from the start of the week (RINEX 3), else of the day (RINEX 2)."""


@dataclass(frozen=True, slots=True)
class NavigationText:
    """A navigation file taken apart into header and records."""

    header: list[tuple[int, str]]
    records: list[NavigationRecord]


def figure(text: str) -> float | None:
    """Number in a field of any exponent form; None for a blank field. ValueError for what is no number.

    >>> figure(" -.461526215076D-04")
    -4.61526215076e-05
    """
    if not text.strip():
        return None
    match = _NUMBER.fullmatch(text.strip())
    if match is None:
        msg = f"{text.strip()!r} is no number"
        raise ValueError(msg)
    mantissa, exponent = match.groups()
    value = float(f"{mantissa}e{(exponent or '0').replace(' ', '+')}")
    if abs(value) > _LARGEST:
        msg = f"{text.strip()!r} is beyond every figure of a navigation message"
        raise ValueError(msg)
    return value


_LARGEST = 1e12


def read_records(lines: list[str], log: IssueLog) -> NavigationText:
    """Header and records of a navigation file; records that are broken are reported and left out.

    Raises RinexError when the file is not RINEX, not navigation, of a version that is not read or
    has no end of its header.
    """
    version, kind = _version(lines, log.path)
    rinex_3 = version in VERSIONS_3
    body = next((index + 1 for index, text in enumerate(lines) if label_of(text) == END), None)
    if body is None:
        raise RinexError(log.path, len(lines), "the header does not end: 'END OF HEADER' is missing; get it whole")
    header = [(index + 1, text) for index, text in enumerate(lines[:body])]
    records = []
    for line, texts in _grouped(lines, body, rinex_3=rinex_3, log=log):
        system = texts[0][0] if rinex_3 else kind
        wanted = CONTINUATIONS[system] + 1
        allowed = wanted + 1 if system == "R" and version == _RINEX_3_05 else wanted
        if not wanted <= len(texts) <= allowed:
            # A line lost or doubled shifts what the others mean.
            log.add(
                line, f"the record of {texts[0][:3].strip()!r} is left out: it has {len(texts)} lines, not {wanted}"
            )
            continue
        try:
            records.append(_record(line, system, texts, rinex_3=rinex_3))
        except ValueError as error:
            log.add(line, f"the record of {texts[0][:3].strip()!r} is left out: {error}")
    return NavigationText(header, records)


def _version(lines: list[str], path: str) -> tuple[str, str]:
    """Version of the file, and the system of a RINEX 2 file."""
    first = lines[0] if lines else ""
    if label_of(first) != VERSION:
        raise RinexError(path, 1, f"this is not RINEX: the first line must end in '{VERSION}'")
    version, kind = first[:20].strip(), first[20:21].upper()
    if version not in VERSIONS_2 | VERSIONS_3:
        raise RinexError(path, 1, f"RINEX version {version!r} is not read; convert the file to 3.04")
    rinex_3 = version in VERSIONS_3
    if kind != "N" and (rinex_3 or kind not in _KINDS_2):
        raise RinexError(path, 1, f"this is no navigation file that is read but {first[20:40].strip()!r}")
    return version, "" if rinex_3 else _KINDS_2[kind]


def _grouped(lines: list[str], body: int, *, rinex_3: bool, log: IssueLog) -> Iterator[tuple[int, list[str]]]:
    """Lines of each record, with the number of the first one."""
    name = _NAME_3 if rinex_3 else _NAME_2
    group: list[str] = []
    start = 0
    astray = False
    for index in range(body, len(lines)):
        text = lines[index]
        if not text.strip() or label_of(text) in NAVIGATION_LABELS:
            continue
        starts = name.match(text) is not None
        if starts or text[:3].strip():
            if group:
                yield start, group
            start, group, astray = index + 1, [text] if starts else [], False
        if not starts and group:
            group.append(text)
        elif not group and not astray:
            log.add(index + 1, f"this and what follows belong to no record; they are left out: {text[:30]!r}")
            astray = True
    if group:
        yield start, group


def _record(line: int, system: str, texts: list[str], *, rinex_3: bool) -> NavigationRecord:
    first, indent = texts[0], 4 if rinex_3 else 3
    number = int(first[1:3] if rinex_3 else first[:2])
    date = first[3:23].split() if rinex_3 else [*first[2:17].split(), first[17:22].strip()]
    year, month, day, hour, minute = (int(part) for part in date[:5])
    second = float(date[5])
    if not rinex_3 and year < 100:  # noqa: PLR2004 - two digits
        year += 1900 if year >= 80 else 2000  # noqa: PLR2004 - RINEX 2.11, 6.5
    fields = [first[at : at + _FIELD] for at in range(indent + _FIELD, indent + 4 * _FIELD, _FIELD)]
    for text in texts[1:]:
        fields += [text[at : at + _FIELD] for at in range(indent, indent + 4 * _FIELD, _FIELD)]
    values = tuple(figure(field) for field in fields)
    return NavigationRecord(line, system, number, (year, month, day, hour, minute, second), values, rinex_3)
