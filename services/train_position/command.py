"""`kirotei position`: runs placed on their line from files, and how good the position was."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.runtime.told_command import UsageError, told

if TYPE_CHECKING:
    from schemas.message import Message
    from schemas.motion import Odometry
    from services.train_position.evaluation import Judgement, Positions, Truth
    from services.train_position.log_run import Said
    from services.train_position.settings import Config

app = typer.Typer(
    name="position",
    no_args_is_help=True,
    rich_markup_mode=None,
    help="The train's place on its line, with its bounds, from recordings.",
)


@app.command("run")
def run_command(
    motion: Annotated[Path, typer.Option(help="Motion log (a folder), or motion.csv of `kirotei motion run`.")],
    line: Annotated[Path, typer.Option(help="Line file.")],
    out: Annotated[Path, typer.Option(help="positions.csv to write.")],
    matches: Annotated[Path | None, typer.Option(help="matches.csv of `kirotei landmarks match`.")] = None,
    fixes: Annotated[Path | None, typer.Option(help="fixes.csv of `kirotei gnss solve`; wants --about.")] = None,
    about: Annotated[Path | None, typer.Option(help="motion.toml with start_gps_week and start_tow_s.")] = None,
    balises: Annotated[Path | None, typer.Option(help="balises.csv.")] = None,
    changes: Annotated[Path | None, typer.Option(help="changes.csv: cab, coupling, wheels, route.")] = None,
    config: Annotated[Path | None, typer.Option(help="TOML file with a [train_position] table.")] = None,
    passes: Annotated[Path | None, typer.Option(help="Write error against bound at every reference here.")] = None,
    start_axis_m: Annotated[float | None, typer.Option(help="Where the front end began, where that is known.")] = None,
    start_bound_m: Annotated[float, typer.Option(help="Error of that.")] = 5.0,
    direction: Annotated[str | None, typer.Option(help="Where the vehicle's forward axis points: up or down.")] = None,
    share_bound: Annotated[
        float, typer.Option(help="Largest share of the odometry's bound that is wheel scale.")
    ] = 0.02,
    match_delay_s: Annotated[float, typer.Option(help="How long after its crossing a match arrives.")] = 5.0,
    fix_delay_s: Annotated[float, typer.Option(help="How long after its time a fix arrives.")] = 0.5,
    json_out: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,  # noqa: FBT002 - a flag of the command line
) -> None:
    """One position from the odometry, landmarks, satellites and balises of a run.

    Example: kirotei position run --motion motion.csv --matches matches.csv --line demo --out positions.csv
    """
    from services.line.line_file import load_line
    from services.train_position.keeper import PositionKeeper
    from services.train_position.line_places import LinePlaces
    from services.train_position.log_messages_file import (
        DEVICE,
        balises_of,
        changes_of,
        fixes_of,
        matches_of,
        odometry_of,
        ordered,
    )
    from services.train_position.log_run import run_through
    from services.train_position.positions_file import write_passes, write_positions

    with told("position run"):
        settings = _settings(config)
        if direction is not None:
            settings = _facing(settings, direction)
        places = LinePlaces(load_line(line).line)
        odometry = _logged(motion) if motion.is_dir() else odometry_of(motion, share_bound)
        arrivals: list[tuple[int, Message]] = [(one.t_ns, one) for one in odometry]
        if start_axis_m is not None and odometry:
            started = _start(odometry[0].t_ns, start_axis_m, start_bound_m, places)
            arrivals.append((odometry[0].t_ns, started))
        if matches is not None:
            later_ns = round(match_delay_s * 1e9)
            arrivals += [(one.t_ns + later_ns, one) for one in matches_of(matches, places.version)]
        if fixes is not None:
            later_ns = round(fix_delay_s * 1e9)
            arrivals += [(one.t_ns + later_ns, one) for one in fixes_of(fixes, _start_gps_s(about))]
        if balises is not None:
            arrivals += [(one.t_ns, one) for one in balises_of(balises)]
        if changes is not None:
            arrivals += [(one.t_ns, one) for one in changes_of(changes)]
        keeper = PositionKeeper(settings, places)
        said = run_through(keeper, ordered(arrivals), DEVICE)
        write_positions(out, said.positions)
        if passes is not None:
            write_passes(passes, said.passes)
    _summarise(said, keeper.refused, json_out=json_out)


def _logged(folder: Path) -> list[Odometry]:
    """Odometry of a motion log by the default method: with everything that it vouches for, unlike a motion.csv."""
    from services.odometry_fusion.methods import run_parts
    from services.odometry_fusion.motion_log_file import read_motion_log
    from services.odometry_fusion.row_messages import odometry_of
    from services.odometry_fusion.settings import Config as OdometryConfig

    settings = OdometryConfig()
    parts = run_parts(read_motion_log(folder).log, settings)
    return [
        odometry_of(rows, at, 0, settings.method, f"log.{number}")
        for number, rows in enumerate(parts, 1)
        for at in range(len(rows))
    ]


def _start(t_ns: int, axis_m: float, bound_m: float, places: Any) -> Message:  # noqa: ANN401 - LinePlaces, which loads numpy
    """A known beginning, as all antennas together would tell it."""
    from schemas.gnss import FrontEnd

    return FrontEnd(
        t_ns=t_ns,
        devices=(),
        agreement="unknown",
        reason="given",
        chainage_m=places.chainage_m("", axis_m),
        chainage_bound_m=bound_m,
    )


def _facing(settings: Config, direction: str) -> Config:
    """Settings with a direction that is known."""
    import msgspec

    if direction not in {"up", "down"}:
        msg = f"--direction: {direction!r} is neither up nor down"
        raise UsageError(msg)
    return msgspec.structs.replace(settings, facing=direction)


def _settings(path: Path | None) -> Config:
    """Settings from a [train_position] table; without a file those with an antenna at the front end."""
    from services.runtime.config_check import Faults, converted
    from services.train_position.log_messages_file import DEVICE
    from services.train_position.settings import AntennaPlace, Config

    if path is None:
        return Config(antennas={DEVICE: AntennaPlace()})
    try:
        table: dict[str, Any] = tomllib.loads(path.read_text("utf-8")).get("train_position", {})
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        msg = f"{path}: {error}"
        raise UsageError(msg) from error
    faults = Faults()
    config = converted(table, Config, faults) if isinstance(table, dict) else None
    if config is None:
        words = "; ".join(f"train_position.{'.'.join(where)}: {what}" for where, what in faults.found)
        msg = f"{path}: {words or 'expected a table [train_position]'}"
        raise UsageError(msg)
    return config


def _start_gps_s(about: Path | None) -> float:
    """GPS time at which the log begins [s]."""
    from schemas.gnss_time import WEEK_S

    if about is None:
        msg = "--fixes wants --about motion.toml, which says when the log begins"
        raise UsageError(msg)
    try:
        table = tomllib.loads(about.read_text("utf-8"))
        return float(table["start_gps_week"]) * WEEK_S + float(table["start_tow_s"])
    except (tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
        msg = f"{about}: no start_gps_week and start_tow_s ({error})"
        raise ValueError(msg) from error


def _summarise(said: Said, refused: dict[str, int], *, json_out: bool) -> None:
    counts = {name: sum(one.status == name for one in said.positions) for name in ("valid", "degraded", "lost")}
    within = sum(one.within for one in said.passes)
    contradictions = sum(one.kind == "contradiction" for one in said.events)
    if json_out:
        summary = {"positions": counts, "references": len(said.passes), "references_within_bound": within}
        typer.echo(json.dumps(summary | {"contradictions": contradictions, "refused": refused}, sort_keys=True))
        return
    typer.echo(", ".join(f"{count} {name}" for name, count in counts.items()))
    typer.echo(f"{len(said.passes)} references passed, {within} of them within the bound")
    for one in said.events:
        if one.kind in {"contradiction", "branch", "change", "line_version"}:
            typer.echo(f"{one.t_ns / 1e9:9.1f} s  {one.text}")
    for kind, count in sorted(refused.items()):
        typer.echo(f"refused: {count} {kind}")


@app.command()
def evaluate(
    positions: Annotated[list[Path], typer.Argument(help="positions.csv, or recordings (.mcap) that hold positions.")],
    truth: Annotated[Path, typer.Option(help="place.parquet or CSV (t_s, axis_m), or a recording that holds truth.")],
    passes: Annotated[Path | None, typer.Option(help="References passed, to be drawn.")] = None,
    train: Annotated[str | None, typer.Option(help="Name of the train, for recordings of several.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw margin and error of the first one here (.png, .svg).")] = None,
    json_out: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,  # noqa: FBT002 - a flag of the command line
) -> None:
    """Error against bound, and the margin from reference to reference.

    Example: kirotei position evaluate positions.csv --truth place.parquet --plot margin.png
    """
    from services.odometry_fusion.picture_plot import save_picture
    from services.train_position.evaluation import judge
    from services.train_position.margin_plot import draw_margin
    from services.train_position.positions_file import read_passes

    with told("position evaluate"):
        true = _truth(truth, train)
        tracks = [_positions(path, train) for path in positions]
        found = [judge(track, true) for track in tracks]
        if plot is not None:
            met = None if passes is None else read_passes(passes)
            save_picture(plot, draw_margin(tracks[0], true, met))
    if json_out:
        typer.echo(json.dumps([asdict(one) for one in found], sort_keys=True))
    else:
        for one in found:
            _print(one)


def _truth(path: Path, train: str | None) -> Truth:
    from schemas.position import MotionTruth
    from services.train_position.positions_file import read_truth, truth_of

    if path.suffix != ".mcap":
        return read_truth(path)
    messages = [one for one in _recorded(path, train) if isinstance(one, MotionTruth)]
    if len(messages) < 2:  # noqa: PLR2004 - between two the truth is interpolated
        msg = f"{path}: holds no truth of a train (motion_truth)"
        raise ValueError(msg)
    return truth_of(messages)


def _positions(path: Path, train: str | None) -> Positions:
    from schemas.position import TrainPosition
    from services.train_position.positions_file import positions_of, read_positions

    if path.suffix != ".mcap":
        return read_positions(path)
    messages = [one for one in _recorded(path, train) if isinstance(one, TrainPosition)]
    if not messages:
        msg = f"{path}: holds no positions of a train"
        raise ValueError(msg)
    return positions_of(path.stem, messages)


def _recorded(path: Path, train: str | None) -> Iterator[Message]:
    """Positions and truths of a recording."""
    from schemas.codec import decode
    from schemas.topics import MOTION_TRUTH, TRAIN_POSITION, topic_of
    from services.recorder.recording_file import read_recording

    for sample in read_recording(path):
        address = topic_of(sample.key)
        if address is None or (train is not None and address.place.name != train):
            continue
        if address.topic is TRAIN_POSITION or address.topic is MOTION_TRUTH:
            yield decode(address.topic.message, sample.payload)


def _print(found: Judgement) -> None:
    typer.echo(f"{found.name}: {found.rows} positions, {found.compared} with a place and a truth")
    typer.echo(
        f"  valid {found.valid_percent:.1f} %, degraded {found.degraded_percent:.1f} %, lost {found.lost_percent:.1f} %"
    )
    typer.echo(
        f"  within the bound {found.within_percent:.3f} % ({found.compared - found.within} beyond, "
        f"by {max(found.largest_excess_m, 0.0):.2f} m at most)"
    )
    typer.echo(
        f"  error: median {found.median_error_m:.2f} m, 95 % {found.p95_error_m:.2f} m, "
        f"largest {found.largest_error_m:.2f} m"
    )
    typer.echo(
        f"  margin: median {found.median_margin_m:.1f} m; {found.resets} resets, its maxima between them: "
        f"median {found.median_of_maxima_m:.1f} m, largest {found.largest_margin_m:.1f} m"
    )
