"""matches.csv: one row per landmark that a run recognised or refused."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from services.landmark_matching.curve_shape import direction_sign
from services.landmark_matching.matcher import Match

COLUMNS: Final = ("t_s", "landmark", "branch", "accepted", "reason", "correction_m", "axis_m", "bound_m")


def write_matches(path: Path, matches: Sequence[Match], behind_front_m: float) -> None:
    """Write beside `path`, then rename; `axis_m` is the front end's. Correction and bound of a refusal are blank.

    Raises OSError.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(COLUMNS)
            for match in matches:
                front_m = match.axis_m + direction_sign(match.landmark.direction) * behind_front_m
                judged = (f"{match.correction_m:.3f}", f"{front_m:.3f}", f"{match.bound_m:.3f}")
                if not match.accepted:
                    judged = ("", f"{front_m:.3f}", "")
                name = (match.landmark.id, match.landmark.branch, int(match.accepted), match.reason)
                rows.writerow((f"{match.t_s:.3f}", *name, *judged))
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
