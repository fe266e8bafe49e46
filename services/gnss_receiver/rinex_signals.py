"""What each column of an observation line measures: signal and quantity.

RINEX 3 names a signal by band and attribute ('1C'). RINEX 2 names only frequencies, so its
types are laid on the RINEX 3 signal that they stand for (docs/gnss_receiver.md has the table):
a code observable names the signal, and the phase, Doppler and strength of its frequency go
with it. Where a frequency has two codes, they go with C/A on the first and with P on the others.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.gnss_receiver.observations import SYSTEMS
from services.gnss_receiver.rinex_error import IssueLog
from services.gnss_receiver.rinex_header import Observables

QUANTITIES = "CLDS"
"""Pseudorange, carrier phase, Doppler, signal strength."""
FIELD_WIDTH = 16
"""F14.3, loss of lock, strength digit."""
FIELDS_PER_LINE_2 = 5
_ABSENT = -1

# RINEX 2.11 table A1 and 2.12: system and type of code observable -> RINEX 3.05 tables 4-10.
_SIGNALS_2 = {
    "G": {"C1": "1C", "P1": "1W", "C2": "2X", "P2": "2W", "C5": "5X", "CA": "1C", "CB": "1X", "CC": "2X"},
    "R": {"C1": "1C", "P1": "1P", "C2": "2C", "P2": "2P", "CA": "1C", "CD": "2C"},
    "E": {"C1": "1C", "C5": "5X", "C6": "6X", "C7": "7X", "C8": "8X", "CA": "1C"},
    "C": {"C1": "2I", "C2": "2I", "C5": "5X", "C6": "6I", "C7": "7I"},
    "J": {"C1": "1C", "C2": "2X", "C5": "5X", "C6": "6X", "CA": "1C", "CB": "1X", "CC": "2X"},
    "S": {"C1": "1C", "C5": "5X", "CA": "1C"},
    "I": {},
}
_CODE_3 = re.compile(r"[CLDS][1-9][A-Z]")
_PSEUDO_3 = re.compile(r"[XI][1-9].?")
"""Channel number and ionospheric delay: no measurement of a signal."""
_RINEX_3_02 = "3.02"


@dataclass(frozen=True, slots=True)
class Layout:
    """Where to find the quantities of every signal, for every table (one per system and stretch of the file).

    Entries of table t are `first[t]:first[t + 1]`; each is one signal. Arrays with two axes have
    shape (entries, 4), in the order of QUANTITIES; offset -1 where a quantity is not recorded.
    """

    signals: tuple[str, ...]
    first: NDArray[np.int64]
    signal: NDArray[np.uint8]
    line: NDArray[np.int64]
    """Lines after the satellite's first one."""
    offset: NDArray[np.int64]
    divisor: NDArray[np.float64]
    """A field without its decimal point, over this, is the value."""


def layout_of(stretches: Iterable[Observables], version: str, *, rinex_3: bool) -> Layout:
    """Layout of all tables: table 7 * stretch + index of the system in SYSTEMS."""
    stretches = list(stretches)
    tables: list[list[tuple[str, dict[str, int], dict[str, int]]]] = []
    for stretch in stretches:
        for system in SYSTEMS:
            types = stretch.types.get(system, ())
            columns = _signals_3(system, types, version) if rinex_3 else _signals_2(system, types)
            scale = {code: factor for (owner, code), factor in stretch.scales.items() if owner == system}
            tables.append(
                [
                    (signal, of_signal, {q: scale.get(types[at], 1) for q, at in of_signal.items()})
                    for signal, of_signal in columns
                ]
            )
    signals = tuple(sorted({signal for table in tables for signal, _, _ in table}))
    entries = [entry for table in tables for entry in table]
    line = np.zeros((len(entries), 4), np.int64)
    offset = np.full((len(entries), 4), _ABSENT, np.int64)
    divisor = np.full((len(entries), 4), 1000.0)
    for row, (_, columns_of, scales) in enumerate(entries):
        for quantity, column in columns_of.items():
            at = QUANTITIES.index(quantity)
            divisor[row, at] *= scales[quantity]
            if rinex_3:
                offset[row, at] = 3 + FIELD_WIDTH * column
            else:
                line[row, at], place = divmod(column, FIELDS_PER_LINE_2)
                offset[row, at] = FIELD_WIDTH * place
    first = np.concatenate([[0], np.cumsum([len(table) for table in tables])]).astype(np.int64)
    signal = np.array([signals.index(signal) for signal, _, _ in entries], np.uint8)
    return Layout(signals, first, signal, line, offset, divisor)


def _signals_3(system: str, types: tuple[str, ...], version: str) -> list[tuple[str, dict[str, int]]]:
    found: dict[str, dict[str, int]] = {}
    for column, code in enumerate(types):
        if _CODE_3.fullmatch(code):
            signal = code[1:]
            # BeiDou B1I was band 1 in 3.02 only; I and Q name it beyond doubt, X does in that version.
            if system == "C" and (signal in {"1I", "1Q"} or (signal == "1X" and version == _RINEX_3_02)):
                signal = "2" + signal[1]
            found.setdefault(signal, {}).setdefault(code[0], column)
    return list(found.items())


def _signals_2(system: str, types: tuple[str, ...]) -> list[tuple[str, dict[str, int]]]:
    """Signals of a RINEX 2 line; a BeiDou B1 written as both C1 and C2 gives two entries, one after the other."""
    names = _SIGNALS_2[system]
    found: dict[str, dict[str, int]] = {}
    for column, code in enumerate(types):
        owner = code if code[:1] in {"C", "P"} else _owner_2(code[1:], types, names)
        if len(code) == len("C1") and code[0] in "CPLDS" and owner in names:
            quantity = "C" if code[0] == "P" else code[0]
            found.setdefault(owner, {}).setdefault(quantity, column)
    return sorted(((names[owner], columns) for owner, columns in found.items()), key=lambda entry: entry[0])


def _owner_2(frequency: str, types: tuple[str, ...], names: dict[str, str]) -> str:
    """Code observable with which phase, Doppler and strength of a frequency go."""
    preferred = ["C1", "P1"] if frequency == "1" else [f"P{frequency}", f"C{frequency}"]
    recorded = [code for code in preferred if code in types and code in names]
    return (recorded or [f"C{frequency}"])[0]


def report_unknown(observables: Observables, line: int, log: IssueLog, *, rinex_3: bool) -> None:
    """Note the types that name no signal; their columns are not read."""
    for system, types in observables.types.items() if rinex_3 else list(observables.types.items())[:1]:
        for code in types:
            known = _CODE_3.fullmatch(code) or _PSEUDO_3.fullmatch(code) if rinex_3 else _known_2(code)
            if not known:
                where = f"of system {system} " if rinex_3 else ""
                log.add(line, f"observable {code!r} {where}names no signal; its column is not read")


def _known_2(code: str) -> bool:
    # T1, T2: integrated Doppler of the Transit satellites; a known type, though none of ours.
    return re.fullmatch(r"[CPLDST][1-8A-D]", code) is not None
