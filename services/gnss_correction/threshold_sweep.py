"""The paper's section 4.4 again: thresholds against accuracy and fixation rate, by elevation band."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np

from schemas.gnss import Method
from schemas.gnss_time import WEEK_S
from schemas.thresholds import ZENITH_DEG, Band, System, Thresholds
from services.gnss_correction.evaluation import FixTrack, Polyline, evaluate
from services.gnss_correction.fix_messages import Corrected
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.rejection import Outcome
from services.gnss_correction.settings import Config

SWEPT_M: Final = (0.3, 0.4, 0.45, 0.5, 0.6, 0.7, 0.8)
"""The paper tried some about 0.4 and took 0.45."""
METHODS: Final[tuple[Method, ...]] = ("remove", "adjust")
_SYSTEMS: Final[tuple[System, ...]] = ("G", "R", "E", "C", "J")
Blocks = Callable[[Correction], Iterable[Corrected]]
"""Takes a recording through a pipeline."""


@dataclass(frozen=True, slots=True)
class SweepRow:
    """One threshold on one band of elevations with one method."""

    lowest_deg: float
    highest_deg: float
    threshold_m: float
    method: str
    flagged_percent: float
    """Of the judged satellites in the band."""
    fixation_percent: float
    mean_m: float | None
    """Distance to the line, else the error against the truth; None without a fix."""
    maximum_m: float | None


def swept_bands(config: Config) -> tuple[tuple[float, float], ...]:
    """All elevations at once, then low, middle and high satellites alone; those near the horizon keep their extra."""
    return ((0.0, ZENITH_DEG), (config.near_horizon_deg, 30.0), (30.0, 60.0), (60.0, ZENITH_DEG))


def sweep(
    config: Config,
    run: Blocks,
    informed: Callable[[Correction], None],
    *,
    truth: Polyline | None,
    line: Polyline | None,
    progress: Callable[[float], None] | None = None,
) -> list[SweepRow]:
    """Rows by band, threshold and method. Outside the band under trial the settings hold.

    `informed` tells a pipeline what was broadcast.
    """
    bands = swept_bands(config)
    trials = [(band, threshold_m) for band in bands for threshold_m in SWEPT_M]
    rows: list[SweepRow] = []
    for done, (band, threshold_m) in enumerate(trials, 1):
        correction = _pipeline(config, band, threshold_m, whole=band == bands[0])
        informed(correction)
        rows += _tried(list(run(correction)), band, threshold_m, truth, line)
        if progress is not None:
            progress(done / len(trials))
    return rows


def _pipeline(config: Config, band: tuple[float, float], threshold_m: float, *, whole: bool) -> Correction:
    if whole:
        return Correction(msgspec.structs.replace(config, threshold_m=threshold_m), METHODS)
    bands = tuple(
        Band(system=system, lowest_deg=band[0], highest_deg=band[1], threshold_m=threshold_m) for system in _SYSTEMS
    )
    return Correction(config, METHODS, Thresholds(receiver="sweep", bands=bands))


def _tried(
    blocks: Sequence[Corrected],
    band: tuple[float, float],
    threshold_m: float,
    truth: Polyline | None,
    line: Polyline | None,
) -> list[SweepRow]:
    flagged_percent = _flagged_percent(blocks, band)
    rows = []
    for method in METHODS:
        found = evaluate(_track(blocks, method), truth, line)
        mean_m = maximum_m = None
        if found.line is not None:
            mean_m, maximum_m = found.line.average_m, found.line.maximum_m
        elif found.truth is not None:
            mean_m, maximum_m = found.truth.mean_m, found.truth.maximum_m
        rows.append(SweepRow(*band, threshold_m, method, flagged_percent, found.fixation_percent, mean_m, maximum_m))
    return rows


def _flagged_percent(blocks: Sequence[Corrected], band: tuple[float, float]) -> float:
    judged = flagged = 0
    for block in blocks:
        elevations_deg = np.degrees(block.solutions["original"].rows["elevation_rad"]).tolist()
        for judgement, elevation_deg in zip(block.judgements, elevations_deg, strict=True):
            if judgement is not None and judgement.change_m is not None and band[0] <= elevation_deg <= band[1]:
                judged += 1
                flagged += judgement.flagged
    return 100.0 * flagged / judged if judged else 0.0


def _track(blocks: Sequence[Corrected], method: Method) -> FixTrack:
    epochs = np.concatenate([block.solutions[method].epochs for block in blocks])
    t_s = [week * WEEK_S + tow_s for block in blocks for week, tow_s in zip(block.gps_week, block.tow_s, strict=True)]
    track = FixTrack(
        method,
        np.array(t_s),
        epochs["outcome"] == int(Outcome.FIX),
        np.degrees(epochs["lat_rad"]),
        np.degrees(epochs["lon_rad"]),
        epochs["h_m"],
    )
    return replace(track, fixed=track.fixed & np.isfinite(track.lat_deg))


def sweep_table(rows: Sequence[SweepRow]) -> str:
    """Rows as a table for people."""
    lines = ["elevation   threshold  flagged  method   fixation    mean  maximum"]
    for row in rows:
        figures = "".join(
            f"{value:8.2f} m" if value is not None else "       – m" for value in (row.mean_m, row.maximum_m)
        )
        lines.append(
            f"{row.lowest_deg:3.0f}–{row.highest_deg:2.0f}°  {row.threshold_m:8.2f} m {row.flagged_percent:6.1f} %"
            f"  {row.method:7s}{row.fixation_percent:8.2f} %{figures}"
        )
    return "\n".join(lines)
