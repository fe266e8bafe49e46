"""Whole recordings solved: RINEX files in, fixes.csv and verdicts.csv out, through the service's own pipeline."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from schemas.gnss_time import NS, WEEK_S, unix_ns_from_gps
from services.gnss_correction.fix_messages import Corrected, fixes_of
from services.gnss_correction.fixes_file import FixesWriter
from services.gnss_correction.line_method import Line
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.rejection import OUTCOME_WORDS, Outcome
from services.gnss_correction.settings import Config
from services.gnss_correction.thresholds_file import read_thresholds
from services.gnss_correction.verdict_messages import verdicts_of
from services.gnss_correction.wheel_file import read_wheel
from services.gnss_receiver.observations import FileIssue, Navigation, Observations
from services.gnss_receiver.session_file import began_ns, read_session
from services.gnss_reference.base_file import Base, read_corrections
from services.gnss_reference.reference_correction import StationSettings
from services.line.line_file import read_line

BLOCK_EPOCHS: Final = 2_000
"""Epochs solved at a time: memory stays bounded, and progress is seen."""


class SolveError(ValueError):
    """Files from which nothing can be solved, and why."""


@dataclass(frozen=True, slots=True)
class Solved:
    """What became of a recording."""

    epochs: int
    fixes: int
    reasons: dict[str, int]
    """Epochs without a fix by kind of reason, commonest first."""
    flagged_per_epoch: float
    clock_jumps: int
    ephemerides: int
    corrected: int
    """Epochs corrected by a base."""
    uncorrected: dict[str, int]
    """Epochs not corrected although there is a base, by reason (figures left out), commonest first."""
    issues: tuple[FileIssue, ...]
    """What was refused in the files."""


def blocks(observations: Observations) -> Iterator[Observations]:
    """Consecutive stretches of a recording."""
    for first in range(0, len(observations), BLOCK_EPOCHS):
        last = min(first + BLOCK_EPOCHS, len(observations))
        rows = slice(int(observations.first_row[first]), int(observations.first_row[last]))
        yield replace(
            observations,
            gps_week=observations.gps_week[first:last],
            tow_s=observations.tow_s[first:last],
            first_row=observations.first_row[first : last + 1] - observations.first_row[first],
            satellite=observations.satellite[rows],
            signal=observations.signal[rows],
            pseudorange_m=observations.pseudorange_m[rows],
            carrier_phase_cycles=observations.carrier_phase_cycles[rows],
            doppler_hz=observations.doppler_hz[rows],
            cn0_dbhz=observations.cn0_dbhz[rows],
            lock_lost=observations.lock_lost[rows],
        )


def _require_cover(config: Config, observations: Observations, navigation: Navigation, named: str) -> None:
    """Raise SolveError unless some ephemeris may be used at some time of the recording."""
    usable = [one for one in navigation.ephemerides if one.satellite[0] in config.systems]
    if not usable:
        msg = f"{named}: no ephemeris of the systems {', '.join(config.systems)}"
        raise SolveError(msg)
    t_s = observations.gps_week * WEEK_S + observations.tow_s
    toe_s = np.array([one.gps_week * WEEK_S + one.toe_s for one in usable])
    fit_s = np.array([one.fit_interval_s for one in usable])
    if not ((toe_s - fit_s <= t_s.max()) & (toe_s + fit_s >= t_s.min())).any():
        given = f"{_calendar(toe_s.min())} to {_calendar(toe_s.max())}"
        wanted = f"{_calendar(t_s.min())} to {_calendar(t_s.max())}"
        msg = f"{named}: ephemerides of {given} UTC cover no epoch of the recording, {wanted} UTC"
        raise SolveError(msg)


def _line(config: Config, wheel: Path | None, observations: Observations) -> Line | None:
    """The line on which the train runs, with its wheels, where they are given."""
    if not config.line_file:
        return None
    first_s = float(observations.gps_week[0] * WEEK_S + observations.tow_s[0])
    wheels = read_wheel(wheel, first_s) if wheel is not None else None
    return Line(read_line(Path(config.line_file)), wheels, config.antenna_above_line_m)


def _informed(config: Config, navigation: Navigation, line: Line | None) -> Correction:
    """A pipeline that knows what was broadcast."""
    thresholds = read_thresholds(Path(config.thresholds_file)) if config.thresholds_file else None
    correction = Correction(config, (config.method,), thresholds, line)
    for ephemeris in navigation.ephemerides:
        correction.add(ephemeris)
    if navigation.ionosphere is not None:
        correction.add(navigation.ionosphere)
    return correction


def _correct_by(
    correction: Correction, base: Base, navigation: Navigation, observations: Observations
) -> Sequence[FileIssue]:
    """Hand the corrections of a base to the pipeline, which takes of them what each epoch may know."""
    corrections, issues = read_corrections(base, navigation, StationSettings(), beside_ns=began_ns(observations))
    for one in corrections:
        correction.correct_by(one)
    return issues


def _kinds(corrected: Corrected) -> Iterator[str]:
    """Kind of reason of every epoch without a fix."""
    outcomes = corrected.solutions[corrected.config.method].epochs["outcome"].tolist()
    for refusal, outcome in zip(corrected.refusals, outcomes, strict=True):
        if refusal:
            yield "repeated or out of order"
        elif outcome != Outcome.FIX:
            yield OUTCOME_WORDS[Outcome(outcome)]


def _calendar(gps_s: float) -> str:
    """UTC of an instant given in seconds of GPS time, to the minute."""
    unix_s = unix_ns_from_gps(0, gps_s) // NS
    return f"{datetime.fromtimestamp(unix_s, UTC):%Y-%m-%d %H:%M}"


def solve_file(
    rover: Path,
    navigation_paths: Sequence[Path],
    config: Config,
    out: Path,
    verdicts: Path | None = None,
    progress: Callable[[float], None] | None = None,
    wheel: Path | None = None,
    base: Base | None = None,
) -> Solved:
    """Solve a recording by the configured method and write the files.

    `progress` gets the fraction done; `wheel` is a file of speeds by the wheels for the method `line`;
    a `base` corrects the pseudoranges.
    Raises RinexError for files that are none, LineFileError and WheelFileError likewise, SolveError
    when nothing can be solved at all (then nothing is written), OSError.
    """
    observations, navigation = read_session(rover, navigation_paths)
    if not len(observations):
        msg = f"{rover}: no epoch that can be read"
        raise SolveError(msg)
    _require_cover(config, observations, navigation, ", ".join(str(path) for path in navigation_paths))
    correction = _informed(config, navigation, _line(config, wheel, observations))
    base_issues = _correct_by(correction, base, navigation, observations) if base is not None else ()
    writer = FixesWriter(out, verdicts, chainage=bool(config.line_file))
    fixes, flagged, reasons, words = 0, 0, Counter[str](), Counter[str]()
    try:
        done = 0
        for block in blocks(observations):
            corrected = correction.block(block)
            answers = fixes_of(corrected, config.method)
            writer.write_fixes(answers)
            if verdicts is not None:
                writer.write_verdicts(verdicts_of(corrected))
            fixes += sum(fix.status == "fix" for fix in answers)
            flagged += sum(corrected.flagged)
            reasons.update(_kinds(corrected))
            words.update(re.sub(r"\d+", "…", why) for why in corrected.differential.epochs)
            done += len(block)
            if progress is not None:
                progress(done / len(observations))
        writer.close()
    except BaseException:
        writer.discard()
        raise
    return Solved(
        epochs=len(observations),
        fixes=fixes,
        reasons=dict(reasons.most_common()),
        flagged_per_epoch=flagged / len(observations),
        clock_jumps=correction.detector.clock_jumps,
        ephemerides=len(navigation.ephemerides),
        corrected=words[""] if base is not None else 0,
        uncorrected={why: count for why, count in words.most_common() if why},
        issues=(*navigation.issues, *observations.issues, *base_issues),
    )
