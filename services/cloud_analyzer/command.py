"""`kirotei cloud`: what the cloud remembers, asked over the bus."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    no_args_is_help=True, help="What the cloud remembers of trains and wayside sites.", rich_markup_mode=None
)
ROUTER = "tcp/127.0.0.1:7447"
ABOUT = ("radio", "radio_events", "radio_sums", "events", "runs", "models", "reanalysed")
Line = Annotated[str, typer.Option(help="Line.")]
Cloud = Annotated[str, typer.Option("--cloud", help="Name of the cloud.")]
Shard = Annotated[str, typer.Option(help="Analyzer of the line.")]
From = Annotated[str | None, typer.Option("--from", help="ISO 8601 with zone.")]
Until = Annotated[str | None, typer.Option(help="ISO 8601 with zone.")]
Router = Annotated[str, typer.Option(help="Router of the cloud.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


@app.command()
def history(
    about: Annotated[str, typer.Argument(help=f"One of {', '.join(ABOUT)}.")],
    *,
    line: Line = "demo",
    at: Cloud = "C1",
    shard: Shard = "all",
    since: From = None,
    until: Until = None,
    from_m: Annotated[float | None, typer.Option("--from-chainage", help="Kilometrage [m].")] = None,
    until_m: Annotated[float | None, typer.Option("--until-chainage", help="Kilometrage [m].")] = None,
    radio: Annotated[str, typer.Option(help="One radio alone.")] = "",
    channel: Annotated[str, typer.Option(help="One channel alone.")] = "",
    train: Annotated[str, typer.Option(help="One train alone.")] = "",
    kind: Annotated[str, typer.Option(help="Of events.")] = "",
    topic: Annotated[str, typer.Option(help="Of events: one topic alone, 'weather'.")] = "",
    model: Annotated[str, typer.Option(help="Of models and what they found: one version alone.")] = "",
    most: Annotated[int, typer.Option("--most", min=1, help="Rows at most.")] = 1000,
    out: Annotated[Path | None, typer.Option("--out", help="CSV or Parquet file; printed when left out.")] = None,
    passes: Annotated[
        bool, typer.Option("--passes", help="Of radio: as passes.csv, for `kirotei radio learn` and `analyse`.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object a row.")] = False,
    connect: Router = ROUTER,
) -> None:
    """Ask a cloud's history, page by page.

    Example: kirotei cloud history radio --from 2026-11-01T00:00Z --radio R3 --most 100000 --out r3.parquet
    """
    from schemas.bridge import StoreQuestion
    from schemas.topic import Place
    from services.cloud_analyzer.history_command import run_history
    from services.runtime.told_command import UsageError, told

    with told("cloud history"):
        if about not in ABOUT:
            msg = f"{about!r} is none of {', '.join(ABOUT)}"
            raise UsageError(msg)
        if passes and about != "radio":
            msg = "--passes goes with radio"
            raise UsageError(msg)
        if out is not None and out.suffix not in (".csv", ".parquet"):
            msg = f"{out}: write .csv or .parquet"
            raise UsageError(msg)
        question = StoreQuestion(
            t_ns=0,
            about=about,  # type: ignore[arg-type]  # one of them
            from_ns=_time_of(since),
            until_ns=_time_of(until),
            from_chainage_m=from_m,
            until_chainage_m=until_m,
            radio=radio,
            channel=channel,
            train=train,
            kind=kind,
            topic=topic,
            model=model,
            limit=min(most, 5000),
        )
        place = Place(line, "cloud", at)
    run_history(question, place, shard, connect, most=most, out=out, as_json=as_json, passes=passes)


@app.command()
def learn(
    *,
    line: Line = "demo",
    at: Cloud = "C1",
    shard: Shard = "all",
    since: From = None,
    until: Until = None,
    update: Annotated[
        bool, typer.Option("--update", help="Go on from the newest model: whole days that it has not seen.")
    ] = False,
    as_json: Json = False,
    connect: Router = ROUTER,
) -> None:
    """Let the cloud learn the radio along the line from its history; the model stays there, under its version.

    Example: kirotei cloud learn --from 2026-09-01T00:00Z --until 2026-11-01T00:00Z
    """
    from schemas.bridge import HistoryTask
    from schemas.topic import Place
    from services.cloud_analyzer.task_command import run_task
    from services.runtime.told_command import told

    with told("cloud learn"):
        task = HistoryTask(
            t_ns=0, task="update" if update else "learn", from_ns=_time_of(since), until_ns=_time_of(until)
        )
        place = Place(line, "cloud", at)
    run_task(task, place, shard, connect, as_json=as_json)


@app.command()
def analyse(
    *,
    line: Line = "demo",
    at: Cloud = "C1",
    shard: Shard = "all",
    since: From = None,
    until: Until = None,
    model: Annotated[str, typer.Option(help="Version; the newest when left out.")] = "",
    as_json: Json = False,
    connect: Router = ROUTER,
) -> None:
    """Let the cloud judge its history by a model; what is found stays there, marked with the model's version.

    Example: kirotei cloud analyse --from 2026-11-01T00:00Z && kirotei cloud history reanalysed --out found.csv
    """
    from schemas.bridge import HistoryTask
    from schemas.topic import Place
    from services.cloud_analyzer.task_command import run_task
    from services.runtime.told_command import told

    with told("cloud analyse"):
        task = HistoryTask(t_ns=0, task="analyse", from_ns=_time_of(since), until_ns=_time_of(until), model=model)
        place = Place(line, "cloud", at)
    run_task(task, place, shard, connect, as_json=as_json)


@app.command()
def model(
    version: Annotated[str, typer.Argument(help="As `kirotei cloud history models` lists it; `newest`.")] = "newest",
    *,
    line: Line = "demo",
    at: Cloud = "C1",
    shard: Shard = "all",
    out: Annotated[Path | None, typer.Option("--out", help="Model file, for `kirotei radio analyse`.")] = None,
    send_as: Annotated[
        str, typer.Option("--send-as", help="Hand it to trains and wayside sites under this name.")
    ] = "",
    connect: Router = ROUTER,
) -> None:
    """Fetch a model that the cloud has learned, into a file or down to the trains.

    Example: kirotei cloud model newest --out model.json --send-as line
    """
    from schemas.topic import Place
    from services.cloud_analyzer.model_command import run_model
    from services.runtime.told_command import UsageError, told

    with told("cloud model"):
        if out is None and not send_as:
            msg = "say where to: --out FILE, --send-as NAME, or both"
            raise UsageError(msg)
        place = Place(line, "cloud", at)
    run_model("" if version == "newest" else version, place, shard, connect, out=out, send_as=send_as)


@app.command()
def send(
    file: Annotated[Path, typer.Argument(help="Line file, landmarks.json, thresholds.toml or a radio model.")],
    *,
    kind: Annotated[str, typer.Option(help="line, landmarks, gnss_thresholds or radio_model.")],
    version: Annotated[str, typer.Option(help="Version by which people call it.")],
    name: Annotated[str | None, typer.Option(help="Name; that of the file when left out.")] = None,
    line: Line = "demo",
    at: Cloud = "C1",
    connect: Router = ROUTER,
) -> None:
    """Hand a file to the cloud's bridges, which keep it until every train that they serve has it.

    Example: kirotei cloud send line.json --kind line --version 2026-2
    """
    from schemas.topic import Place
    from services.cloud_analyzer.send_command import document_of, run_send
    from services.runtime.told_command import told

    with told("cloud send"):
        document = document_of(file, kind, name or file.stem, version)
        place = Place(line, "cloud", at)
    run_send(document, place, connect)


def _time_of(text: str | None) -> int | None:
    from services.runtime.told_command import UsageError

    if text is None:
        return None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        msg = f"{text!r} is no time: write 2026-11-01T08:30+09:00"
        raise UsageError(msg) from error
    if moment.tzinfo is None:
        msg = f"{text!r} has no zone: write 2026-11-01T08:30+09:00 or end it with Z"
        raise UsageError(msg)
    return round(moment.astimezone(UTC).timestamp() * 1e9)
