"""Every method on every recording, with and without a base: fixes, errors and bounds, as one table in Markdown.

    KIROTEI_FIELD_DATA=… python -m benchmarks.gnss_accuracy

Default settings throughout. Takes some minutes.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np

from schemas.gnss import Method
from services.gnss_correction.evaluation import FixTrack, Polyline, truth_error
from services.gnss_correction.fixes_file import read_fixes, read_truth
from services.gnss_correction.integrity import bounded_errors, integrity_of
from services.gnss_correction.settings import Config
from services.gnss_correction.solve_file import solve_file
from services.gnss_reference.base_file import Base
from services.gnss_reference.base_position import parse_position

ALERT_LIMIT_M = 50.0
WALK_BASE_DEG = (31.182425, 121.401902, 4.06)
"""Its recorded place, set right by the mean offset of the walk's corrected fixes (2.4 m across, 2.9 m down)."""
HEAD = (
    "| recording | systems | base | method | fixes | mean | 50 % | 95 % | maximum | median bound | misleading |",
    "|---|---|---|---|---|---|---|---|---|---|---|",
)


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording with what belongs to it."""

    name: str
    folder: Path
    navigation: tuple[str, ...] = ("nav.rnx",)
    systems: str = "GRECJ"
    base_deg: tuple[float, float, float] | None = None
    place_deg: tuple[float, float, float] | None = None
    """Where the receiver stood; None where truth.csv tells where it went."""

    @property
    def methods(self) -> tuple[Method, ...]:
        """All of them, but `line` only where there is one."""
        return tuple(one for one in get_args(Method) if one != "line" or self.line.exists())

    @property
    def line(self) -> Path:
        """The way that was taken."""
        return self.folder / "track_centreline.csv"

    def truth(self, track: FixTrack) -> Polyline:
        """Where the receiver was."""
        if self.place_deg is None:
            return read_truth(self.folder / "truth.csv")
        lat_deg, lon_deg, h_m = (np.full(len(track.t_s), figure) for figure in self.place_deg)
        return Polyline(lat_deg, lon_deg, h_m, track.t_s)


def recordings(gnss: Path) -> list[Recording]:
    """All that can be solved."""
    static = gnss / "static_dgps"
    places = [parse_position((static / f"{name}_position.txt").read_text()) for name in ("base", "rover")]
    return [
        Recording("Berlin", gnss / "berlin_5hz", ("nav_gps.16n",), "G"),
        Recording("Berlin", gnss / "berlin_5hz", ("nav_gps.16n", "nav_glo.16g"), "GR"),
        Recording("Shanghai", gnss / "shanghai_dgps", base_deg=WALK_BASE_DEG),
        Recording("Boulder", gnss / "boulder_4hz"),
        Recording("static", static, base_deg=places[0], place_deg=places[1]),
    ]


def row(recording: Recording, method: Method, base: Base | None, out: Path) -> str:
    """Solve once and say what came of it."""
    line = str(recording.line) if method == "line" else ""
    config = Config(method=method, compare=(), systems=recording.systems, line_file=line)
    navigation = [recording.folder / name for name in recording.navigation]
    solve_file(recording.folder / "rover.obs", navigation, config, out, base=base)
    track = read_fixes(out, method)
    truth = recording.truth(track)
    error, integrity = truth_error(track, truth), integrity_of(bounded_errors(track, truth), ALERT_LIMIT_M)
    begun = f"| {recording.name} | {recording.systems} | {'yes' if base else 'no'} | `{method}` |"
    if error is None:
        return f"{begun} 0 % | | | | | | |"
    figures = (error.mean_m, error.p50_m, error.p95_m, error.maximum_m)
    words = " | ".join(f"{figure:.2f}" for figure in figures)
    bound = " | |" if integrity.bound_p50_m is None else f"{integrity.bound_p50_m:.1f} | {integrity.misleading} |"
    return f"{begun} {error.fixation_percent:.1f} % | {words} | {bound}"


def rows(gnss: Path, out: Path) -> Iterator[str]:
    """The table, line by line."""
    yield from HEAD
    for recording in recordings(gnss):
        bases: list[Base | None] = [None]
        if recording.base_deg is not None:
            bases.append(Base(recording.folder / "base.obs", recording.base_deg))
        for base in bases:
            for method in recording.methods:
                yield row(recording, method, base, out)


def main() -> int:
    """Print the table; 2 where there are no recordings."""
    field = os.environ.get("KIROTEI_FIELD_DATA", "")
    gnss = Path(field) / "gnss"
    if not field or not gnss.is_dir():
        sys.stderr.write("KIROTEI_FIELD_DATA does not name a folder with gnss/\n")
        return 2
    with tempfile.TemporaryDirectory() as folder:
        for text in rows(gnss, Path(folder) / "fixes.csv"):
            sys.stdout.write(f"{text}\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
