"""Observations from the bytes of a RINEX 2.10-2.12 or 3.00-3.05 observation file."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from services.gnss_receiver.observations import SYSTEMS, Observations, satellite_name
from services.gnss_receiver.rinex_blocks import read_blocks
from services.gnss_receiver.rinex_epochs import POWER_FAILURE, find_heads, gps_times
from services.gnss_receiver.rinex_error import IssueLog
from services.gnss_receiver.rinex_header import (
    CHANGES,
    END,
    FIRST,
    LABEL_AT,
    LABELS,
    VERSION,
    Observables,
    ObservationHeader,
    Record,
    label_of,
    read_header,
    read_observables,
)
from services.gnss_receiver.rinex_lines import Ints, Lines, split_lines
from services.gnss_receiver.rinex_rows import REPEATED, Records, Rows, read_rows
from services.gnss_receiver.rinex_signals import FIELDS_PER_LINE_2, Layout, layout_of, report_unknown

_MAX_HEADER_LINES = 10_000
_NAMES = ("pseudorange", "carrier phase", "Doppler", "signal strength")
_STRUCTURE_DONE = 0.3
"""Share of the work before the first field is read; for the progress only."""


def parse_observations(content: bytes, path: str, progress: Callable[[float], None] | None = None) -> Observations:
    """Everything that is good in a file, and what was refused as issues; `path` is only named in them.

    Rows without a single measurement are left out; a figure of zero is none (RINEX 2.11, table A2).
    Raises RinexError when the file is not RINEX or not an observation file, or its header cannot
    be understood.
    """
    report = progress or (lambda _: None)
    log = IssueLog(path)
    lines = split_lines(content.removeprefix(b"\xef\xbb\xbf"))
    header = read_header(_header_records(lines), log)
    body, stretches, last_lines = _body(lines, header, log)
    for first_line, stretch_observables in zip([header.body_line - 1, *last_lines], stretches, strict=True):
        report_unknown(stretch_observables, first_line, log, rinex_3=header.is_rinex_3)
    heads = find_heads(body, rinex_3=header.is_rinex_3)
    report(_STRUCTURE_DONE / 2)
    stretch = np.searchsorted(np.array(last_lines, np.int64), body.numbers)
    per_satellite = None if header.is_rinex_3 else _lines_per_satellite(stretches)
    system = "G" if header.system == "M" else header.system
    blocks = read_blocks(body, heads, stretch, per_satellite, system, log)
    layout = layout_of(stretches, header.version, rinex_3=header.is_rinex_3)
    _report_missing(body, blocks.records, layout, log)
    report(_STRUCTURE_DONE)
    rows = read_rows(
        body,
        blocks.records,
        layout,
        len(blocks.head),
        lambda done: report(_STRUCTURE_DONE + (1.0 - _STRUCTURE_DONE) * done),
    )
    _report_bad(body, blocks.records, layout, rows, log)
    week, tow_s = gps_times(heads.ticks[blocks.head], heads.day[blocks.head], header.time_system)
    report(1.0)
    return _observations(week, tow_s, heads.flag[blocks.head] == POWER_FAILURE, layout, rows, log)


def _observations(
    week: Ints,
    tow_s: NDArray[np.float64],
    restarted: NDArray[np.bool_],
    layout: Layout,
    rows: Rows,
    log: IssueLog,
) -> Observations:
    used = np.unique(rows.signal)
    signals = tuple(layout.signals[code] for code in used.tolist())
    pseudorange_m, carrier_phase_cycles, doppler_hz, cn0_dbhz = rows.values
    # After a power failure no carrier phase continues the one before it.
    lost = np.repeat(restarted, rows.rows_of_epoch) & np.isfinite(carrier_phase_cycles)
    return Observations(
        gps_week=week,
        tow_s=tow_s,
        first_row=np.concatenate([np.zeros(1, np.int64), np.cumsum(rows.rows_of_epoch)]),
        satellite=rows.satellite,
        signal=np.searchsorted(used, rows.signal).astype(np.uint8),
        signals=signals,
        pseudorange_m=pseudorange_m,
        carrier_phase_cycles=carrier_phase_cycles,
        doppler_hz=doppler_hz,
        cn0_dbhz=cn0_dbhz,
        lock_lost=rows.lock_lost | lost.astype(np.uint8),
        issues=log.issues(),
    )


def _header_records(lines: Lines) -> list[Record]:
    records: list[Record] = []
    for index in range(min(len(lines), _MAX_HEADER_LINES)):
        text = lines.text(index)
        records.append((index + 1, text))
        if label_of(text) == END or label_of(records[0][1]) != VERSION:
            break
    return records


def _body(lines: Lines, header: ObservationHeader, log: IssueLog) -> tuple[Lines, list[Observables], list[int]]:
    """Lines after the header without header records, and the observables of each stretch.

    A stretch ends with the last line of the header records that change the observables; those
    line numbers come last. RINEX 3 loses its blank lines; in RINEX 2 they are observations.
    """
    body = lines.select(slice(header.body_line - 1, None))
    letter = body.character(LABEL_AT)
    suspects = np.flatnonzero(((letter >= ord("A")) & (letter <= ord("Z"))) | (letter == ord("#"))).tolist()
    records = [(index, body.text(index)) for index in suspects]
    records = [(index, text) for index, text in records if label_of(text) in LABELS]
    end = next((index for index, text in records if _is_another(text, header)), len(body))
    if end < len(body):
        log.add(int(body.numbers[end]), "another file of another kind starts here; it is left out, give it by itself")
    stretches, last_lines = [header.observables], []
    for run in _runs([(int(body.numbers[index]), text) for index, text in records if index < end]):
        if any(label_of(text) in CHANGES for _, text in run):
            stretches.append(read_observables(run, stretches[-1], log))
            last_lines.append(run[-1][0])
    keep = np.ones(len(body), np.bool_)
    keep[[index for index, _ in records]] = False
    keep[end:] = False
    if header.is_rinex_3:
        keep &= body.ends > body.starts
        spaced = np.flatnonzero(keep & (body.character(0) <= ord(" "))).tolist()
        blank = [index for index in spaced if not body.text(index).strip()]
        keep[blank] = False
    return body.select(keep), stretches, last_lines


def _is_another(text: str, header: ObservationHeader) -> bool:
    """Whether a header record in the middle says that what follows is laid out or timed otherwise."""
    label = label_of(text)
    if label == VERSION:
        same_layout = text[:20].strip().split(".")[0] == header.version.split(".")[0]
        return not same_layout or text[20:21].upper() != "O"
    return label == FIRST and text[48:51].strip() not in {"", header.time_system}


def _runs(records: list[Record]) -> list[list[Record]]:
    """Records of adjacent lines together."""
    runs: list[list[Record]] = []
    for record in records:
        if runs and record[0] == runs[-1][-1][0] + 1:
            runs[-1].append(record)
        else:
            runs.append([record])
    return runs


def _lines_per_satellite(stretches: list[Observables]) -> Ints:
    return np.array(
        [math.ceil(len(stretch.types.get(SYSTEMS[0], ())) / FIELDS_PER_LINE_2) for stretch in stretches], np.int64
    )


def _report_missing(body: Lines, records: Records, layout: Layout, log: IssueLog) -> None:
    """Systems whose satellites stand in the file although the header names no observables for them."""
    unread = np.diff(layout.first)[records.table] == 0
    tables, first, count = np.unique(records.table[unread], return_index=True, return_counts=True)
    for table, index, times in zip(tables.tolist(), first.tolist(), count.tolist(), strict=True):
        number = int(body.numbers[records.line[unread][index]])
        name = SYSTEMS[table % len(SYSTEMS)]
        log.add(number, f"the header names no observables for system {name}; {times} lines of it are left out")


def _report_bad(body: Lines, records: Records, layout: Layout, rows: Rows, log: IssueLog) -> None:
    for record, entry, quantity in rows.bad.tolist():
        line = int(records.line[record])
        satellite = satellite_name(int(records.satellite[record]))
        if quantity == REPEATED:
            log.add(int(body.numbers[line]), f"{satellite} stands twice in this epoch; the first is taken")
            continue
        line += int(layout.line[entry, quantity])
        at = int(layout.offset[entry, quantity])
        what = f"{_NAMES[quantity]} of {satellite} on {layout.signals[layout.signal[entry]]}"
        log.add(int(body.numbers[line]), f"{what} is left out, it cannot be read: {body.text(line)[at : at + 16]!r}")
    log.count(rows.bad_count - len(rows.bad), int(body.numbers[-1]) if len(body) else 0)
