"""`kirotei landmarks`: curves of a line surveyed from runs, and runs matched against them."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from services.runtime.progress import progress_of
from services.runtime.told_command import UsageError, told

if TYPE_CHECKING:
    from schemas.line import LandmarkDatabase
    from services.landmark_matching.line_landmarks import LineLandmarks
    from services.landmark_matching.run_matching import RunMatches, Start
    from services.landmark_matching.survey_merge import Surveyed, SurveyedLandmark

app = typer.Typer(
    name="landmarks",
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Curves as virtual balises: their database surveyed from runs, runs matched against it.",
)

LineOption = Annotated[
    Path, typer.Option("--line", help="Line file, or the name of a line that comes with Kirotei (demo).")
]
StartAxis = Annotated[
    list[float] | None,
    typer.Option("--start-axis", help="axis_m of the front end at each log's begin, in order of the logs."),
]
StartDirection = Annotated[
    list[str] | None, typer.Option("--direction", help="up (rising axis_m) or down, one for all logs or one each.")
]
StartBranch = Annotated[
    list[str] | None, typer.Option("--branch", help="Branch on which the logs begin; the main line when left out.")
]
StartBound = Annotated[float, typer.Option("--start-bound", min=0.0, help="Error of --start-axis in metres.")]
BehindFront = Annotated[
    float, typer.Option("--sensor-behind-front", help="Metres by which the inertial sensor is behind the front end.")
]
Method = Annotated[str, typer.Option("--method", help="Odometry: paper or fused (the wheel alone has no curvature).")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def _one_of(values: list[str] | None, number: int, count: int, option: str, default: str) -> str:
    if not values:
        return default
    if len(values) not in (1, count):
        msg = f"{option}: give it once, or once per log ({count})"
        raise UsageError(msg)
    return values[0] if len(values) == 1 else values[number]


def _starts(
    count: int,
    axes: list[float] | None,
    directions: list[str] | None,
    branches: list[str] | None,
    bound_m: float,
    behind_front_m: float,
) -> list[Start | None]:
    """Where each log begins; None where the curvature is to tell. Raises UsageError."""
    from services.landmark_matching.run_matching import Start

    if not axes:
        if directions or branches:
            msg = "--direction and --branch go with --start-axis; without it the place is found by the curvature"
            raise UsageError(msg)
        return [None] * count
    if len(axes) != count:
        msg = f"--start-axis: {len(axes)} places for {count} logs"
        raise UsageError(msg)
    found: list[Start | None] = []
    for number, axis_m in enumerate(axes):
        direction = _one_of(directions, number, count, "--direction", "up")
        if direction not in ("up", "down"):
            msg = f"--direction: {direction!r} is neither up nor down"
            raise UsageError(msg)
        sensor_m = axis_m - (behind_front_m if direction == "up" else -behind_front_m)
        branch = _one_of(branches, number, count, "--branch", "")
        found.append(Start(branch, "up" if direction == "up" else "down", sensor_m, bound_m))
    return found


def _known(line: Path, landmarks: Path | None, starts: list[Start | None]) -> LineLandmarks:
    from services.landmark_matching.landmarks_file import read_landmarks
    from services.landmark_matching.line_landmarks import line_landmarks
    from services.line.line_file import load_line

    known = line_landmarks(load_line(line).line, read_landmarks(landmarks) if landmarks else None)
    if not any(known.landmarks.values()):
        msg = f"{line}: no curve of this line can be a landmark (it has {sum(map(len, known.curves.values()))} curves)"
        raise ValueError(msg)
    for start in starts:
        if start is not None and start.branch not in known.landmarks:
            there = ", ".join(name for name in known.landmarks if name) or "none"
            msg = f"--branch: no branch {start.branch!r} on this line; there are: {there}"
            raise UsageError(msg)
    return known


def _method(name: str) -> Literal["paper", "fused"]:
    """Raises UsageError."""
    if name == "paper":
        return "paper"
    if name == "fused":
        return "fused"
    msg = f"--method: {name!r} is neither paper nor fused"
    raise UsageError(msg)


def _report_issues(name: str, issues: tuple[str, ...]) -> None:
    if issues:
        typer.echo(f"{name}: {len(issues)} things in the log were left out, the first: {issues[0]}", err=True)


@app.command()
def match(
    log: Annotated[Path, typer.Argument(help="Motion log, a folder (docs/odometry_fusion.md).")],
    *,
    line: LineOption,
    out: Annotated[Path, typer.Option("--out", help="matches.csv to write: one row per landmark passed.")],
    landmarks: Annotated[
        Path | None, typer.Option("--landmarks", help="landmarks.json; those of the line when left out.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Picture of curvature against database (.png, .svg).")
    ] = None,
    start_axis: Annotated[
        float | None, typer.Option("--start-axis", help="axis_m of the front end at the begin; found when left out.")
    ] = None,
    direction: Annotated[str | None, typer.Option("--direction", help="up (rising axis_m) or down.")] = None,
    branch: Annotated[str | None, typer.Option("--branch", help="Branch on which the log begins.")] = None,
    start_bound: StartBound = 20.0,
    sensor_behind_front: BehindFront = 0.0,
    method: Method = "fused",
    as_json: AsJson = False,
) -> None:
    """Recognise the landmarks that a run passes, and say where the train therefore is.

    Example: kirotei landmarks match run1 --line demo --landmarks landmarks.json --out matches.csv --plot curvature.png
    """
    from services.landmark_matching.curvature_plot import draw_curvature
    from services.landmark_matching.log_run_file import read_run
    from services.landmark_matching.matches_file import write_matches
    from services.landmark_matching.run_matching import match_run
    from services.landmark_matching.settings import MatchSettings
    from services.odometry_fusion.picture_plot import save_picture

    with told("landmarks match"):
        axes = None if start_axis is None else [start_axis]
        (start,) = starts = _starts(
            1,
            axes,
            None if direction is None else [direction],
            None if branch is None else [branch],
            start_bound,
            sensor_behind_front,
        )
        known = _known(line, landmarks, starts)
        run = read_run(log, _method(method))
        _report_issues(run.name, run.issues)
        found = match_run(run.readings, known, start, MatchSettings(), run.share)
        write_matches(out, found.matches, sensor_behind_front)
        if plot is not None:
            every = {one.id: one for ones in known.landmarks.values() for one in ones}
            title = f"{run.name} against the landmarks of {known.line} ({known.database_version})"
            save_picture(plot, draw_curvature(found, list(every.values()), known.curves, title))
    typer.echo(json.dumps(_match_json(found), indent=1) if as_json else _match_words(out, found))


def _match_json(found: RunMatches) -> dict[str, object]:
    return {
        "accepted": sum(one.accepted for one in found.matches),
        "refused": dict(Counter(one.kind for one in found.matches if not one.accepted)),
        "placed": [
            {
                "t_s": round(one.t_s, 3),
                "branch": one.anchor.branch,
                "direction": one.anchor.direction,
                "axis_m": round(one.anchor.axis_m, 1),
                "at_distance_m": round(one.anchor.distance_m, 1),
                "how": one.reason,
            }
            for one in found.placed
        ],
        "moved": [one.text for one in found.moved],
    }


def _match_words(out: Path, found: RunMatches) -> str:
    accepted = sum(one.accepted for one in found.matches)
    lines = [f"{out}: {accepted} of {len(found.matches)} landmarks accepted"]
    for one in found.placed:
        where = (
            f"{one.anchor.axis_m:.0f} m, {one.anchor.direction}{', ' + one.anchor.branch if one.anchor.branch else ''}"
        )
        lines.append(f"from {one.t_s:.1f} s on: {where} at distance {one.anchor.distance_m:.0f} m ({one.reason})")
    lines += [f"{one.landmark.id} refused: {one.reason}" for one in found.matches if not one.accepted]
    lines += [one.text for one in found.moved]
    return "\n".join(lines)


@app.command()
def survey(
    logs: Annotated[list[Path], typer.Argument(help="Motion logs, folders.")],
    *,
    line: LineOption,
    out: Annotated[Path, typer.Option("--out", help="landmarks.json to write.")],
    start_axis: StartAxis = None,
    direction: StartDirection = None,
    branch: StartBranch = None,
    start_bound: StartBound = 20.0,
    sensor_behind_front: BehindFront = 0.0,
    method: Method = "fused",
    as_json: AsJson = False,
) -> None:
    """Build the landmark database of a line from runs in any direction and at any speed.

    Example: kirotei landmarks survey run1 run2 run3 --line demo --out landmarks.json
    """
    from services.landmark_matching.landmarks_file import write_landmarks
    from services.landmark_matching.survey import database_of
    from services.landmark_matching.survey_merge import merge

    with told("landmarks survey"):
        names = _run_names(logs)
        starts = _starts(len(logs), start_axis, direction, branch, start_bound, sensor_behind_front)
        known = _known(line, None, starts)
        runs = list(zip(names, logs, starts, strict=True))
        surveyed = []
        with progress_of("landmarks survey") as tell:
            for number, run in enumerate(runs, 1):
                surveyed += _surveyed(*run, known, _method(method))
                tell(number / len(runs))
        found = merge(surveyed)
        if not found:
            msg = "no curve of the line was recognised in these runs"
            raise ValueError(msg)
        database = database_of(found, known)
        write_landmarks(out, database)
    missing = sorted(
        {one.id for ones in known.landmarks.values() for one in ones} - {one.id for one in database.landmarks}
    )
    typer.echo(_survey_json(database, found, missing) if as_json else _survey_words(out, database, found, missing))


def _run_names(logs: list[Path]) -> list[str]:
    """The folders' names, with as many of those above them as it takes to tell them apart. Raises UsageError."""
    places = [log.resolve() for log in logs]
    twice = [log for number, log in enumerate(logs) if places[number] in places[:number]]
    if twice:
        msg = f"{twice[0]}: given twice; a run that counts twice makes the landmarks look better than they are"
        raise UsageError(msg)
    depth = 1
    while len({place.parts[-depth:] for place in places}) < len(places):
        depth += 1
    return ["/".join(place.parts[-depth:]) for place in places]


def _surveyed(
    name: str, log: Path, start: Start | None, known: LineLandmarks, method: Literal["paper", "fused"]
) -> list[Surveyed]:
    """The curves of one run; of one that is nowhere on the line none, which is said."""
    from services.landmark_matching.log_run_file import read_run
    from services.landmark_matching.run_matching import PlaceError, match_run
    from services.landmark_matching.survey import SURVEY, survey_run

    run = read_run(log, method)
    _report_issues(name, run.issues)
    try:
        found = survey_run(name, match_run(run.readings, known, start, SURVEY, run.share))
    except PlaceError as error:
        typer.echo(f"{name} left out: {error}", err=True)
        return []
    if not found:
        typer.echo(f"{name} left out: no curve of the line was recognised in it", err=True)
    return found


def _left_out(found: list[SurveyedLandmark]) -> dict[str, list[str]]:
    """By run: landmarks at which the other runs agree against it."""
    told: dict[str, list[str]] = {}
    for one in found:
        for passage in one.left_out:
            told.setdefault(passage.run, []).append(one.landmark.id)
    return told


def _survey_json(database: LandmarkDatabase, found: list[SurveyedLandmark], missing: list[str]) -> str:
    rows = [
        {
            "landmark": one.landmark.id,
            "exit_m": one.landmark.exit_lower_limit_m,
            "radius_m": one.landmark.radius_m,
            "runs": one.landmark.runs,
            "spread_m": one.landmark.spread_m,
            "accuracy_m": one.landmark.accuracy_m,
            "from_geometry_m": round(one.moved_m, 2),
        }
        for one in found
    ]
    told = {"version": database.version, "landmarks": rows, "not_surveyed": missing, "left_out": _left_out(found)}
    return json.dumps(told, indent=1)


def _survey_words(out: Path, database: LandmarkDatabase, found: list[SurveyedLandmark], missing: list[str]) -> str:
    lines = [f"{out}: {len(found)} landmarks from {len(database.evidence)} runs, version {database.version}"]
    lines.append(
        f"{'landmark':<20}{'exit [m]':>12}{'radius':>9}{'runs':>6}{'spread':>8}{'accuracy':>10}{'geometry':>10}"
    )
    for one in found:
        row = one.landmark
        spread = "" if row.spread_m is None else f"{row.spread_m:.2f}"
        lines.append(
            f"{row.id:<20}{row.exit_lower_limit_m:>12.1f}{row.radius_m:>9.1f}{row.runs:>6}{spread:>8}"
            f"{row.accuracy_m:>10.2f}{one.moved_m:>+10.2f}"
        )
    for run, at in _left_out(found).items():
        lines.append(f"{run} left out where the other runs agree against it: {', '.join(at)}")
    if missing:
        lines.append(f"not recognised in any run, so not in the database: {', '.join(missing)}")
    return "\n".join(lines)
