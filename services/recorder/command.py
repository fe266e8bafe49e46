"""`kirotei record`, `replay` and `recording`: recordings of the bus, in the hands of a person."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

if TYPE_CHECKING:
    from services.recorder.contents_file import Contents
    from services.recorder.offline_replay_command import Replayed
    from services.recorder.repaired_file import Repair

ROUTER = "tcp/127.0.0.1:7447"
FileArgument = Annotated[Path, typer.Argument(help="Recording (MCAP).")]
KeyOption = Annotated[
    str | None, typer.Option("--key", help="Key expression, 'kirotei/v1/*/train/T1/**'; by default all.")
]
ConnectOption = Annotated[str, typer.Option("--connect", help="Router.")]
JsonFlag = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]

recording_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Look into recordings, and repair them.")


def _refuse(command: str, text: str, code: int) -> NoReturn:
    typer.echo(f"kirotei {command}: {text}", err=True)
    raise typer.Exit(code)


def _require_file(command: str, path: Path) -> None:
    if not path.is_file():
        _refuse(command, f"{path}: no such file", 2)


def _require_folder(command: str, out: Path) -> None:
    if out.is_dir() or not out.parent.is_dir():
        _refuse(command, f"{out}: " + ("is a folder" if out.is_dir() else f"there is no folder {out.parent}"), 2)


def _require_key(command: str, key: str | None) -> None:
    from services.recorder.key_choice import fault_of

    fault = None if key is None else fault_of(key)
    if fault is not None:
        _refuse(command, f"--key {key}: {fault}", 2)


def record(
    out: Annotated[Path, typer.Argument(help="File to record into; may not exist.")],
    *,
    key: KeyOption = None,
    connect: ConnectOption = ROUTER,
    duration: Annotated[float | None, typer.Option(min=0.1, help="Seconds; until Ctrl-C when left out.")] = None,
    as_json: JsonFlag = False,
) -> None:
    """Record what is on the bus into one MCAP file, until Ctrl-C.

    Example: kirotei record run1.mcap --key 'kirotei/v1/demo/train/T1/**'
    """
    from schemas.topics import EVERYTHING

    _require_key("record", key)
    _require_folder("record", out)
    part = out.with_name(f"{out.name}.part")
    if out.exists():
        _refuse("record", f"{out} is there already; a recording is never overwritten", 2)
    if part.exists():
        _refuse("record", f"{part} is there: another recording is running, or `kirotei recording repair {part}`", 2)
    from services.recorder.live_record_command import run_record

    run_record(out, key or EVERYTHING, connect, duration, as_json=as_json)


def replay(
    file: FileArgument,
    *,
    live: Annotated[bool, typer.Option("--live", help="Put the recording onto the bus.")] = False,
    speed: Annotated[
        float | None, typer.Option(min=0.0, help="With --live: times real time; 0 as fast as it goes.")
    ] = None,
    line: Annotated[str | None, typer.Option(help="With --live: put it onto the keys of this line instead.")] = None,
    connect: ConnectOption = ROUTER,
    through: Annotated[
        str | None, typer.Option(help="Services to run it through, 'gnss_correction,train_position'.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="With --through: recording of what they publish.")] = None,
    config: Annotated[
        Path | None, typer.Option("--config", help="With --through: profile with their settings.")
    ] = None,
    place: Annotated[str | None, typer.Option(help="With --through: where they work, 'demo/train/T1'.")] = None,
    key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Play a recording again: live onto the bus, or offline through services at full speed.

    Offline, time is virtual and the same recording gives the same bytes; what the services had
    published when it was recorded is left out. Live, keys and bytes are the original, the
    sender is marked as a replay, and measurement times stay those of the recording.
    Examples: kirotei replay run1.mcap --live --speed 10 --line rehearsal;
    kirotei replay run1.mcap --through gnss_correction --out again.mcap
    """
    if live == (through is not None):
        _refuse("replay", "give either --live or --through SERVICE,…", 2)
    if live and (out or config or place):
        _refuse("replay", "--out, --config and --place go with --through", 2)
    if not live and (speed is not None or line is not None):
        _refuse("replay", "--speed and --line go with --live", 2)
    _require_key("replay", key)
    _require_file("replay", file)
    if live:
        _replay_live(file, key, connect, 1.0 if speed is None else speed, line, as_json=as_json)
    if through is None or out is None:
        _refuse("replay", "--through needs --out FILE.mcap", 2)
    _replay_offline(file, through, out, config, place, key, as_json=as_json)


def _replay_live(
    file: Path, key: str | None, connect: str, speed: float, line: str | None, *, as_json: bool
) -> NoReturn:
    from schemas.topic import TopicError
    from services.recorder.live_replay import ReplayConfig
    from services.recorder.live_replay_command import run_live_replay
    from services.recorder.recording_file import RecordingError, require_complete

    try:
        require_complete(file)
        run_live_replay(file, key, connect, ReplayConfig(speed=speed, line=line), as_json=as_json)
    except TopicError as error:
        _refuse("replay", f"{file}: {error}", 1)
    except RecordingError as error:
        _refuse("replay", str(error), 1)


def _replay_offline(
    file: Path, through: str, out: Path, config: Path | None, place: str | None, key: str | None, *, as_json: bool
) -> None:
    from schemas.topic import TopicError
    from services.recorder.offline_replay import ReplayError
    from services.recorder.offline_replay_command import parts_of, place_of, run_offline_replay
    from services.recorder.recording_file import RecordingError, require_complete
    from services.runtime.catalogue import UnknownServiceError
    from services.runtime.config import ConfigError

    _require_folder("replay", out)
    if out.exists() and out.samefile(file):
        _refuse("replay", f"--out {out} is the recording itself", 2)
    try:
        where = None if place is None else place_of(place)
        require_complete(file)
        parts = parts_of(through, config)
        done = run_offline_replay(file, parts, out, key, where)
    except (UnknownServiceError, TopicError) as error:
        _refuse("replay", str(error), 2)
    except (ConfigError, ReplayError, RecordingError) as error:
        _refuse("replay", str(error), 1)
    except OSError as error:
        _refuse("replay", f"{error.filename or out}: {error.strerror or error}", 1)
    typer.echo(json.dumps(_replayed_json(done, out), indent=2) if as_json else _replayed_text(done, out))


def _replayed_json(done: Replayed, out: Path) -> dict[str, object]:
    from dataclasses import asdict

    return {"file": str(out), **asdict(done)}


def _replayed_text(done: Replayed, out: Path) -> str:
    factor = f" ({done.recorded_s / done.took_s:.0f} x real time)" if done.took_s > 0.0 else ""
    return (
        f"{out}: {done.published} messages published by hearing {done.fed} ({done.left_out} others left out)\n"
        f"{done.recorded_s:.1f} s of recording in {done.took_s:.2f} s{factor}, after {done.start_s:.2f} s of start"
    )


@recording_app.command("info")
def info(file: FileArgument, *, as_json: JsonFlag = False) -> None:
    """Tell what a recording holds: keys, counts, rates, senders, gaps. Reads broken files too.

    Exit code 1 when something is wrong with the file. Example: kirotei recording info run1.mcap
    """
    from services.recorder.contents_file import contents_of
    from services.recorder.contents_words import contents_json, contents_text

    _require_file("recording info", file)
    contents: Contents
    try:
        contents = contents_of(file)
    except OSError as error:
        _refuse("recording info", f"{file}: {error.strerror}", 1)
    typer.echo(
        json.dumps(contents_json(contents), indent=2, ensure_ascii=False) if as_json else contents_text(contents)
    )
    if contents.faults:
        fault = contents.faults[0]
        hint = f"; `kirotei recording repair {file}` saves what can be saved" if contents.messages else ""
        _refuse("recording info", f"{file}: byte {fault.offset}: {fault.what}{hint}", 1)


@recording_app.command("repair")
def repair(file: FileArgument, *, as_json: JsonFlag = False) -> None:
    """Complete a recording that ended in a crash, and save what can be read of a damaged one.

    `X.mcap.part` becomes `X.mcap`; any other file keeps its name. The broken file is kept as
    `….damaged` if more than its end was missing. Example: kirotei recording repair run1.mcap.part
    """
    from services.recorder.repaired_file import repair as repair_file

    _require_file("recording repair", file)
    done: Repair
    try:
        done = repair_file(file)
    except OSError as error:
        _refuse("recording repair", error.strerror or str(error), 1)
    if as_json:
        result = {
            "file": str(done.path),
            "outcome": done.outcome,
            "output": None if done.output is None else str(done.output),
            "kept": None if done.kept is None else str(done.kept),
            "messages": done.messages,
            "lost_messages": done.lost_messages,
            "lost_bytes": done.lost_bytes,
            "faults": list(done.faults),
        }
        typer.echo(json.dumps(result, indent=2, ensure_ascii=False))
    else:
        typer.echo(_repair_text(done))
    if done.outcome == "hopeless":
        raise typer.Exit(1)


def _repair_text(done: Repair) -> str:
    if done.outcome == "complete":
        return f"{done.output}: complete, {done.messages} messages"
    if done.outcome == "empty":
        return f"{done.path}: held no message and was removed"
    what = "; ".join(done.faults)
    if done.outcome == "hopeless":
        return f"{done.path}: nothing can be saved and it was left as it is ({what})"
    lost = f"{done.lost_messages} messages and {done.lost_bytes} bytes lost"
    kept = f"; the broken file is kept as {done.kept}" if done.kept else ""
    return f"{done.output}: {done.messages} messages saved, {lost} ({what}){kept}"


app_commands = (record, replay)
"""Commands that stand on their own; `recording_app` goes under `recording`."""
