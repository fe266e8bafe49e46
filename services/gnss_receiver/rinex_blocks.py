"""Which epochs of a RINEX observation file are whole enough to be read, and their satellites."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.gnss_receiver.observations import SYSTEMS
from services.gnss_receiver.rinex_epochs import CYCLE_SLIPS, FIRST_EVENT, LAST_EVENT, EpochHeads
from services.gnss_receiver.rinex_error import IssueLog
from services.gnss_receiver.rinex_lines import BLANK, Bools, Ints, Lines, integers, is_blank_line
from services.gnss_receiver.rinex_rows import Records

_PER_LIST_LINE = 12
_LIST_AT = 32
_POINT = "."
_POINTS_AT = range(10, 80, 16)
_NONE = 255


@dataclass(frozen=True, slots=True)
class Blocks:
    """Epochs that are read, and the satellites in them."""

    head: Ints
    """Index into the EpochHeads, shape (epochs,)."""
    records: Records


def read_blocks(
    lines: Lines, heads: EpochHeads, stretch: Ints, lines_per_satellite: Ints | None, system: str, log: IssueLog
) -> Blocks:
    """Epochs to read, from all headers; what is refused goes to `log`.

    `stretch` tells for every line which table set holds (shape (lines,)). `lines_per_satellite` is
    given per stretch for RINEX 2, None for RINEX 3. `system` is meant where RINEX 2 leaves it blank.
    """
    _report_before(lines, heads, log)
    observed = _observed(lines, heads, log)
    length = heads.next_line - heads.line - 1
    if lines_per_satellite is None:
        _report_events(lines, heads, length, log)
        return _blocks_3(lines, heads, observed, length, stretch, log)
    per_satellite = lines_per_satellite[stretch[heads.line]]
    for index in np.flatnonzero(observed & (per_satellite == 0)).tolist():
        observed[index] = False
        log.add(int(lines.numbers[heads.line[index]]), "the epoch is left out, its observables are not known")
    return _blocks_2(lines, heads, observed, length, per_satellite, stretch, system, log)


def _report_before(lines: Lines, heads: EpochHeads, log: IssueLog) -> None:
    first = int(heads.line[0]) if len(heads.line) else len(lines)
    filled = [index for index in range(first) if not is_blank_line(lines, index)]
    if filled:
        log.add(int(lines.numbers[filled[0]]), f"{len(filled)} lines belong to no epoch; they are left out")


def _observed(lines: Lines, heads: EpochHeads, log: IssueLog) -> Bools:
    """Which headers announce observations; headers that cannot be read are reported."""
    is_event = (heads.flag >= FIRST_EVENT) & (heads.flag <= CYCLE_SLIPS)
    observed: Bools = (heads.flag >= 0) & ~is_event & (heads.flag <= CYCLE_SLIPS) & (heads.count >= 0)
    observed &= heads.ticks >= 0
    for index in np.flatnonzero(~observed & ~is_event).tolist():
        at = int(heads.line[index])
        log.add(int(lines.numbers[at]), f"the epoch is left out, its header cannot be read: {lines.text(at)[:80]!r}")
    return observed


def _report_events(lines: Lines, heads: EpochHeads, length: Ints, log: IssueLog) -> None:
    """Lines after an event that are neither header records (taken out before) nor announced."""
    plain = (heads.flag >= FIRST_EVENT) & (heads.flag <= LAST_EVENT) & (length > np.maximum(heads.count, 0))
    for index in np.flatnonzero(plain).tolist():
        at = int(heads.line[index] + 1 + max(int(heads.count[index]), 0))
        log.add(int(lines.numbers[at]), "lines after an event record belong to no epoch; they are left out")


def _blocks_3(lines: Lines, heads: EpochHeads, observed: Bools, length: Ints, stretch: Ints, log: IssueLog) -> Blocks:
    head = np.flatnonzero(observed)
    count, length = heads.count[head], length[head]
    for index in np.flatnonzero(count != length).tolist():
        announced, found = int(count[index]), int(length[index])
        left = "; those that follow them are left out" if found > announced else "; they are read"
        number = int(lines.numbers[heads.line[head[index]]])
        log.add(number, f"the epoch announces {announced} satellites, {found} lines follow{left}")
    taken = np.minimum(count, length)
    epoch, place = _spread(taken)
    line = heads.line[head][epoch] + 1 + place
    satellite = _satellites(lines, line, np.zeros_like(line), "", log)
    return Blocks(head, _records(line, epoch, satellite, stretch))


def _blocks_2(
    lines: Lines,
    heads: EpochHeads,
    observed: Bools,
    length: Ints,
    per_satellite: Ints,
    stretch: Ints,
    system: str,
    log: IssueLog,
) -> Blocks:
    more_lists = np.maximum(-(-heads.count // _PER_LIST_LINE) - 1, 0)
    claimed = more_lists + heads.count * per_satellite
    for index in np.flatnonzero(observed & (length != claimed)).tolist():
        observed[index] = _extent_is_clear(lines, heads, index, int(claimed[index]), log)
    head = _with_whole_lists(lines, heads, np.flatnonzero(observed), log)
    epoch, place = _spread(heads.count[head])
    first = heads.line[head][epoch]
    listed_at, offset = _listed(first, place)
    satellite = _satellites(lines, listed_at, offset, system, log)
    line = first + 1 + more_lists[head][epoch] + place * per_satellite[head][epoch]
    return Blocks(head, _records(line, epoch, satellite, stretch))


def _listed(first: Ints, place: Ints) -> tuple[Ints, Ints]:
    """Line and column of the name of the satellite at `place` of an epoch that begins at line `first`."""
    return first + place // _PER_LIST_LINE, _LIST_AT + 3 * (place % _PER_LIST_LINE)


def _with_whole_lists(lines: Lines, heads: EpochHeads, head: Ints, log: IssueLog) -> Ints:
    """Headers of RINEX 2 whose lists have no gap: a blank name means that the names around it have slipped."""
    epoch, place = _spread(heads.count[head])
    listed_at, offset = _listed(heads.line[head][epoch], place)
    blank = (lines.characters(listed_at, offset, 3) == BLANK).all(axis=1)
    gaps = np.unique(epoch[blank])
    for index in gaps.tolist():
        number = int(lines.numbers[heads.line[head[index]]])
        log.add(number, "the list of satellites has a gap; which line is whose is in doubt, the epoch is left out")
    return np.delete(head, gaps)


def _extent_is_clear(lines: Lines, heads: EpochHeads, index: int, claimed: int, log: IssueLog) -> bool:
    """Whether a RINEX 2 epoch whose lines do not fit its announcement can still be read without doubt.

    It can when what follows the announced lines is blank, or something other than observations.
    """
    at, end = int(heads.line[index]), int(heads.next_line[index])
    number = int(lines.numbers[at])
    found = end - at - 1
    announced = f"the epoch announces {int(heads.count[index])} satellites in {claimed} lines, {found} follow"
    if found < claimed:
        log.add(number, f"{announced}; which line is whose is in doubt, the epoch is left out")
        return False
    filled = [extra for extra in range(at + 1 + claimed, end) if not is_blank_line(lines, extra)]
    if not filled:
        return True
    if any(lines.text(filled[0])[point : point + 1] == _POINT for point in _POINTS_AT):
        log.add(number, f"{announced}; which line is whose is in doubt, the epoch is left out")
        return False
    log.add(int(lines.numbers[filled[0]]), f"{len(filled)} lines belong to no epoch; they are left out")
    return True


def _spread(counts: Ints) -> tuple[Ints, Ints]:
    """For every satellite of every epoch: the epoch, and the place among its satellites."""
    epoch = np.repeat(np.arange(len(counts)), counts)
    start = np.cumsum(counts) - counts
    return epoch, np.arange(len(epoch)) - start[epoch]


def _satellites(lines: Lines, line: Ints, offset: Ints, system: str, log: IssueLog) -> Ints:
    """Satellite numbers as in Observations, -1 where the name is none; blank systems mean `system`."""
    letters = np.full(256, _NONE, np.uint8)
    letters[np.frombuffer(SYSTEMS.encode(), np.uint8)] = np.arange(len(SYSTEMS))
    if system:
        letters[ord(" ")] = SYSTEMS.index(system)
    names = lines.characters(line, offset, 3)
    number, good = integers(names[:, 1:])
    index: NDArray[np.int64] = letters[names[:, 0]].astype(np.int64)
    good &= (index != _NONE) & (number > 0)
    for bad in np.flatnonzero(~good).tolist():
        name = names[bad].tobytes().decode("ascii", errors="replace")
        log.add(int(lines.numbers[line[bad]]), f"{name!r} is no satellite; its observations are left out")
    return np.where(good, 100 * index + number, -1)


def _records(line: Ints, epoch: Ints, satellite: Ints, stretch: Ints) -> Records:
    named = satellite >= 0
    line, epoch, satellite = line[named], epoch[named], satellite[named]
    return Records(line, len(SYSTEMS) * stretch[line] + satellite // 100, epoch, satellite)
