"""Thresholds of a receiver from a recording: RINEX in, thresholds.toml out, and the sweep of section 4.4."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from schemas.gnss_time import NS, unix_ns_from_gps
from schemas.thresholds import Thresholds
from services.gnss_correction.evaluation import Polyline
from services.gnss_correction.fix_messages import Corrected
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.settings import Config
from services.gnss_correction.solve_file import SolveError, blocks
from services.gnss_correction.threshold_sweep import SweepRow, sweep
from services.gnss_correction.threshold_tuning import bands_of, changes_of, joined
from services.gnss_correction.thresholds_file import write_thresholds
from services.gnss_receiver.observations import Navigation, Observations
from services.gnss_receiver.session_file import read_session


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording and what was broadcast meanwhile."""

    rover: Path
    observations: Observations
    navigation: Navigation

    def inform(self, correction: Correction) -> None:
        """Tell a pipeline what was broadcast."""
        for ephemeris in self.navigation.ephemerides:
            correction.add(ephemeris)
        if self.navigation.ionosphere is not None:
            correction.add(self.navigation.ionosphere)

    def through(self, correction: Correction) -> Iterator[Corrected]:
        """Take the recording through a pipeline."""
        for block in blocks(self.observations):
            yield correction.block(block)


def read_recording(rover: Path, navigation: Sequence[Path]) -> Recording:
    """Read a recording. Raises RinexError, SolveError when it holds no epoch, OSError."""
    recording = Recording(rover, *read_session(rover, navigation))
    if not len(recording.observations):
        msg = f"{rover}: no epoch that can be read"
        raise SolveError(msg)
    return recording


def tune(recording: Recording, config: Config, out: Path, *, receiver: str, false_alarms: float) -> Thresholds:
    """Tune thresholds and write them. Raises SolveError when too little of the recording is clean, OSError."""
    correction = Correction(config, ("original",))
    recording.inform(correction)
    changes = joined([changes_of(corrected) for corrected in recording.through(correction)])
    try:
        bands = bands_of(changes, false_alarms=false_alarms, window_epochs=config.window_epochs)
    except ValueError as error:
        msg = f"{recording.rover}: {error}"
        raise SolveError(msg) from error
    observations = recording.observations
    intervals_s = np.diff(observations.tow_s)
    thresholds = Thresholds(
        receiver=receiver,
        recording=recording.rover.name,
        first_utc=_utc(int(observations.gps_week[0]), float(observations.tow_s[0])),
        last_utc=_utc(int(observations.gps_week[-1]), float(observations.tow_s[-1])),
        epochs=len(observations),
        interval_s=round(float(np.median(intervals_s[intervals_s > 0.0])), 3) if (intervals_s > 0.0).any() else 0.0,
        false_alarms=false_alarms,
        bands=bands,
    )
    write_thresholds(out, thresholds)
    return thresholds


def sweep_recording(
    recording: Recording,
    config: Config,
    *,
    truth: Polyline | None,
    line: Polyline | None,
    progress: Callable[[float], None] | None = None,
) -> list[SweepRow]:
    """Thresholds against accuracy and fixation rate."""
    return sweep(config, recording.through, recording.inform, truth=truth, line=line, progress=progress)


def _utc(week: int, tow_s: float) -> str:
    return f"{datetime.fromtimestamp(unix_ns_from_gps(week, tow_s) // NS, UTC):%Y-%m-%dT%H:%M:%SZ}"
