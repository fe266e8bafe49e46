"""What `kirotei motion evaluate --plot` draws of other rooms: balises, curvature, margin (Iwata et al., figure 5)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from services.runtime.told_command import UsageError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from schemas.line import Line
    from services.landmark_matching.line_landmarks import LineLandmarks
    from services.odometry_fusion.evaluation import Marks, MotionTruth
    from services.odometry_fusion.motion_plot import Panel
    from services.train_position.evaluation import Passes

CURVATURE_ROW_KM: Final = 13.0
CURVATURE_IN, MARGIN_IN = 2.1, 3.0


def known_line(
    line: Path | None, landmarks: Path | None, *, balises: Path | None, matches: Path | None
) -> tuple[Line, LineLandmarks] | None:
    """The line with its landmarks; None where nothing wants it. Raises UsageError, ValueError, OSError."""
    if line is None:
        for option, given in (("--balises", balises), ("--matches", matches), ("--landmarks", landmarks)):
            if given is not None:
                msg = f"{option} wants --line"
                raise UsageError(msg)
        return None
    from services.landmark_matching.landmarks_file import read_landmarks
    from services.landmark_matching.line_landmarks import line_landmarks
    from services.line.line_file import load_line

    found = load_line(line).line
    return found, line_landmarks(found, read_landmarks(landmarks) if landmarks else None)


def marks_for(
    truth: MotionTruth, spacing_m: float, known: tuple[Line, LineLandmarks] | None, balises: Path | None
) -> Marks:
    """Balises with the places that the line gives them, else even marks. Raises ValueError, OSError."""
    import numpy as np

    from services.odometry_fusion.evaluation import Marks, even_marks

    if balises is None or known is None:
        return even_marks(truth, spacing_m)
    from services.train_position.log_messages_file import balises_of

    place_m = {one.id: one.axis_m for one in known[0].balises}
    met = sorted(balises_of(balises), key=lambda one: one.t_ns)
    for one in met:
        if one.balise not in place_m:
            msg = f"{balises}: the line has no balise {one.balise!r}"
            raise ValueError(msg)
    return Marks("balises", np.array([one.t_ns / 1e9 for one in met]), np.array([place_m[one.balise] for one in met]))


def curvature_panels(
    log: Path, known: tuple[Line, LineLandmarks] | None, matches: Path | None, behind_front_m: float
) -> list[Panel]:
    """Curvature of the log against the database, in as many rows as the line is long. Raises ValueError, OSError."""
    if matches is None or known is None:
        return []
    from services.landmark_matching.curvature_plot import draw_stretch, drawn_between
    from services.landmark_matching.matched_run_file import read_matched_run
    from services.odometry_fusion.motion_plot import Panel
    from services.odometry_fusion.picture_plot import head

    line = known[1]
    every = list({one.id: one for ones in line.landmarks.values() for one in ones}.values())
    run = read_matched_run(log, matches, every, behind_front_m)
    rows = drawn_between(run, CURVATURE_ROW_KM)

    def row(number: int) -> Panel:
        def draw(axes: Axes) -> None:
            draw_stretch(axes, run, every, line.curves, rows[number])
            if number == 0:
                head(axes, "Curvature")
            if number + 1 == len(rows):
                axes.set_xlabel("place along the axis [km]")

        return Panel(CURVATURE_IN, draw)

    return [row(number) for number in range(len(rows))]


def reference_passes(balises: Path | None, matches: Path | None) -> Passes | None:
    """References of both files, in order of time; None where neither is given. Raises ValueError, OSError."""
    if balises is None and matches is None:
        return None
    import numpy as np

    from services.train_position.evaluation import Passes
    from services.train_position.log_messages_file import balises_of, matches_of

    met = [] if balises is None else [(one.t_ns / 1e9, one.balise, "balise") for one in balises_of(balises)]
    if matches is not None:
        met += [(one.t_ns / 1e9, one.landmark, "landmark") for one in matches_of(matches, "")]
    met.sort()
    return Passes(np.array([one[0] for one in met]), tuple(one[1] for one in met), tuple(one[2] for one in met))


def margin_panel(positions: Path, log: Path, passes: Passes | None) -> Panel:
    """Margin along the way, with the error where the front end's true place is beside the log. Raises as readers do."""
    from services.odometry_fusion.motion_plot import Panel
    from services.odometry_fusion.picture_plot import head
    from services.train_position.margin_plot import draw_saw, way_of
    from services.train_position.positions_file import read_positions, read_truth

    found = read_positions(positions)
    beside = next((path for path in (log / "place.parquet", log / "place.csv") if path.is_file()), None)
    true_m = None if beside is None else read_truth(beside).at(found.t_s)
    way_km = way_of(found.axis_m if true_m is None else true_m)

    def draw(axes: Axes) -> None:
        draw_saw(axes, found, way_km, None if true_m is None else found.axis_m - true_m, passes)
        head(axes, "Margin")

    return Panel(MARGIN_IN, draw)
