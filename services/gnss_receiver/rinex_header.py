"""Header of a RINEX observation file: version, observables per system, time scale.

Source: RINEX 2.11 (Gurtner and Estey 2007), table A1; RINEX 3.05 (IGS/RTCM 2020), table A2.
Labels stand in columns 61-80 of a header line.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from services.gnss_receiver.observations import SYSTEMS
from services.gnss_receiver.rinex_error import IssueLog, RinexError

LABEL_AT = 60
VERSION = "RINEX VERSION / TYPE"
COMPACT_VERSION = "CRINEX VERS   / TYPE"
END = "END OF HEADER"
TYPES_2 = "# / TYPES OF OBSERV"
TYPES_3 = "SYS / # / OBS TYPES"
SCALE = "SYS / SCALE FACTOR"
FIRST = "TIME OF FIRST OBS"
CHANGES = frozenset({TYPES_2, TYPES_3, SCALE})
"""Records that change the meaning of the lines after them, also in the middle of a file."""
LABELS = CHANGES | {
    VERSION,
    END,
    FIRST,
    "TIME OF LAST OBS",
    "COMMENT",
    "PGM / RUN BY / DATE",
    "MARKER NAME",
    "MARKER NUMBER",
    "MARKER TYPE",
    "OBSERVER / AGENCY",
    "REC # / TYPE / VERS",
    "ANT # / TYPE",
    "APPROX POSITION XYZ",
    "ANTENNA: DELTA H/E/N",
    "ANTENNA: DELTA X/Y/Z",
    "ANTENNA: PHASECENTER",
    "ANTENNA: B.SIGHT XYZ",
    "ANTENNA: ZERODIR AZI",
    "ANTENNA: ZERODIR XYZ",
    "CENTER OF MASS: XYZ",
    "WAVELENGTH FACT L1/2",
    "INTERVAL",
    "RCV CLOCK OFFS APPL",
    "LEAP SECONDS",
    "# OF SATELLITES",
    "PRN / # OF OBS",
    "SIGNAL STRENGTH UNIT",
    "SYS / DCBS APPLIED",
    "SYS / PCVS APPLIED",
    "SYS / PHASE SHIFT",
    "SYS / PHASE SHIFTS",
    "GLONASS SLOT / FRQ #",
    "GLONASS COD/PHS/BIS",
    "GLONASS COD/PHS/BIS#",
}
VERSIONS_2 = frozenset({"2", "2.0", "2.00", "2.01", "2.10", "2.1", "2.11", "2.12"})
VERSIONS_3 = frozenset({"3", "3.0", "3.00", "3.01", "3.02", "3.03", "3.04", "3.05"})
TIME_SYSTEMS = frozenset({"GPS", "GLO", "GAL", "QZS", "BDT", "IRN", "UTC"})
_OWN_TIME = {"R": "GLO", "E": "GAL", "C": "BDT", "J": "QZS"}
_SCALES = (1, 10, 100, 1000)

Record = tuple[int, str]
"""Line number and text of a header record."""


@dataclass(frozen=True, slots=True)
class Observables:
    """What the columns of the observation lines mean from some line on."""

    types: dict[str, tuple[str, ...]]
    """By system letter, in the order of the columns, as the file writes them ('C1', 'C1C')."""
    scales: dict[tuple[str, str], int] = field(default_factory=dict)
    """By system and type: the stored figures are this many times too large."""


@dataclass(frozen=True, slots=True)
class ObservationHeader:
    """What must be known to read the observations after the header."""

    version: str
    system: str
    """System letter, or 'M' for mixed."""
    time_system: str
    observables: Observables
    body_line: int
    """Number of the first line after the header, counted from 1."""

    @property
    def is_rinex_3(self) -> bool:
        """Whether the lines after the header are laid out as in RINEX 3."""
        return self.version in VERSIONS_3


def label_of(text: str) -> str:
    """Label of a header record."""
    return text[LABEL_AT:80].strip()


def read_header(records: list[Record], log: IssueLog) -> ObservationHeader:
    """Header of an observation file from its records, `END OF HEADER` included.

    Raises RinexError when the file is not RINEX, not an observation file, of a version that is
    not read, has no end of its header or names no observables.
    """
    version, system = _version(records, log.path)
    body_line = next((line + 1 for line, text in records if label_of(text) == END), 0)
    if not body_line:
        raise RinexError(log.path, records[-1][0], "the header does not end: 'END OF HEADER' is missing; get it whole")
    known = [record for record in records if record[0] < body_line]
    observables = read_observables(known, Observables({}), log)
    if not any(observables.types.values()):
        wanted = TYPES_3 if version in VERSIONS_3 else TYPES_2
        raise RinexError(log.path, body_line - 1, f"the header names no observables; it needs '{wanted}'")
    return ObservationHeader(version, system, _time_system(known, system, log), observables, body_line)


def _version(records: list[Record], path: str) -> tuple[str, str]:
    line, text = records[0] if records else (1, "")
    if label_of(text) != VERSION:
        raise RinexError(path, 1, f"this is not RINEX: the first line must end in '{VERSION}'")
    version = text[:20].strip()
    if version not in VERSIONS_2 | VERSIONS_3:
        message = f"RINEX version {version!r} is not read; convert the file to 2.11 or 3.04"
        raise RinexError(path, line, message)
    kind = text[20:21].upper()
    if kind != "O":
        raise RinexError(path, line, f"this is no observation file but {text[20:40].strip()!r}; give it as navigation")
    system = text[40:41].upper().strip() or "G"
    if system not in f"{SYSTEMS}M":
        raise RinexError(path, line, f"satellite system {system!r} is none of {', '.join(SYSTEMS)} and M")
    return version, system


def read_observables(records: Iterable[Record], before: Observables, log: IssueLog) -> Observables:
    """Observables after `records`, which stand in a header or in the middle of a file.

    A system that `records` do not mention keeps what it had `before`.
    """
    types = dict(before.types)
    scales = dict(before.scales)
    for group in _grouped(records):
        line, first = group[0]
        label = label_of(first)
        if label in {TYPES_2, TYPES_3} and not first[:6].strip():
            # A continuation without its first line: what it continues is not known, nor what the columns are.
            log.add(line, f"the first line of these {label!r} is missing; what they describe cannot be read")
            types = {system: codes for system, codes in types.items() if system not in before.types}
        elif label == TYPES_2:
            codes = _codes_2([text for _, text in group], line, log)
            types.update(dict.fromkeys(SYSTEMS, codes))
        elif label == TYPES_3 and first[0] in SYSTEMS:
            types[first[0]] = _codes_3([text for _, text in group], line, log)
        elif label == SCALE:
            scales.update(_scales([text for _, text in group], types, line, log))
        else:
            log.add(line, f"{label!r} names no satellite system: {first[:LABEL_AT].strip()!r}")
    return Observables(types, scales)


def _grouped(records: Iterable[Record]) -> list[list[Record]]:
    """Records of observables, each together with its continuation lines."""
    groups: list[list[Record]] = []
    for line, text in records:
        label = label_of(text)
        if label not in CHANGES:
            continue
        continues = not text[:6].strip() and groups and label_of(groups[-1][0][1]) == label
        if continues:
            groups[-1].append((line, text))
        else:
            groups.append([(line, text)])
    return groups


def _codes_2(texts: list[str], line: int, log: IssueLog) -> tuple[str, ...]:
    codes = [text[at : at + 6].strip() for text in texts for at in range(6, LABEL_AT, 6)]
    return _counted([code for code in codes if code], texts[0][:6], line, log)


def _codes_3(texts: list[str], line: int, log: IssueLog) -> tuple[str, ...]:
    codes = [text[at : at + 4].strip() for text in texts for at in range(6, 58, 4)]
    return _counted([code for code in codes if code], texts[0][3:6], line, log)


def _counted(codes: list[str], count: str, line: int, log: IssueLog) -> tuple[str, ...]:
    """Codes as they are listed; a count that says otherwise is reported."""
    if count.strip() != str(len(codes)):
        log.add(line, f"{count.strip() or 'no'} observables announced, {len(codes)} listed; the list is taken")
    return tuple(codes)


def _scales(
    texts: list[str], types: dict[str, tuple[str, ...]], line: int, log: IssueLog
) -> dict[tuple[str, str], int]:
    system, factor = texts[0][:1], texts[0][2:6].strip()
    if system not in types or factor not in {str(scale) for scale in _SCALES}:
        log.add(line, f"scale factor {texts[0][:10].strip()!r} is not understood: {system!r} is left as it is")
        return {}
    codes = [text[at : at + 4].strip() for text in texts for at in range(10, 58, 4)]
    return {(system, code): int(factor) for code in [code for code in codes if code] or types[system]}


def _time_system(records: list[Record], system: str, log: IssueLog) -> str:
    """Time scale of the epochs: as `TIME OF FIRST OBS` says, else the system's own."""
    assumed = _OWN_TIME.get(system, "GPS")
    for line, text in records:
        if label_of(text) != FIRST:
            continue
        named = text[48:51].strip()
        if named in TIME_SYSTEMS:
            return named
        if named or system == "M":
            log.add(line, f"time system {named!r} is not known; {assumed} time is taken")
        return assumed
    log.add(records[-1][0], f"'{FIRST}' is missing; {assumed} time is taken")
    return assumed
