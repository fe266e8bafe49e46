"""`kirotei radio`: learn what is normal along the line from passes, and find what leaves it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from services.runtime.told_command import UsageError, told

if TYPE_CHECKING:
    from collections.abc import Iterable

    from services.radio_anomaly.passes_file import Rows

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="The radio along the line: learn, analyse.")
PassesFile = Annotated[Path, typer.Option("--in", help="passes.csv (or .csv.gz).")]
ModelFile = Annotated[Path, typer.Option("--model", help="Model file (JSON).")]
PlotFile = Annotated[Path | None, typer.Option("--plot", help="Picture: .png, .svg or .pdf.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


@app.command()
def learn(
    passes: PassesFile,
    model: ModelFile,
    method: Annotated[Literal["line", "paper"], typer.Option(help="`paper`: the paper's A ± kσ.")] = "line",
    section_m: Annotated[float, typer.Option("--section", min=1.0, max=10_000.0, help="D [m].")] = 100.0,
    k: Annotated[float, typer.Option("-k", min=1.0, max=20.0, help="Of A ± kσ.")] = 3.0,
    loss_power_dbm: Annotated[
        float | None, typer.Option("--loss-power", help="Power at which reception fails [dBm]; else learned.")
    ] = None,
    plot: PlotFile = None,
    *,
    as_json: Json = False,
) -> None:
    """Learn what is normal from passes on which it was, and say how often the model would cry wolf.

    Example: kirotei radio learn --in passes.csv --model model.json
    """
    with told("radio learn"):
        import msgspec

        from services.radio_anomaly.file_analysis import learn as learned
        from services.radio_anomaly.passes_file import read_passes
        from services.radio_anomaly.radio_model_file import write_model
        from services.radio_anomaly.settings import Settings
        from services.radio_anomaly.told_words import model_words

        settings = Settings(section_m=section_m, k=k, loss_power_dbm=loss_power_dbm)
        rows = read_passes(passes)
        found = learned(rows.readings, settings, method, passes.name, rows.refused)
        write_model(model, found)
        if plot is not None:
            from services.radio_anomaly.radio_plot import draw_model, save

            save(draw_model(found), plot)
        _say_refused(rows)
        if as_json:
            text = msgspec.json.encode({"origin": found.origin, "evidence": found.evidence, "sums": len(found.sums)})
            typer.echo(text.decode())
        else:
            _say(model_words(found))


@app.command()
def analyse(
    passes: PassesFile,
    model: ModelFile,
    out: Annotated[Path, typer.Option("--out", help="events.csv to write.")],
    weather: Annotated[Path | None, typer.Option(help="weather.csv: time, axis_m, snow_mm_per_h …")] = None,
    plot: PlotFile = None,
    *,
    update: Annotated[bool, typer.Option("--update", help="Keep in the model file what was learned.")] = False,
    as_json: Json = False,
) -> None:
    """Find what is not as it was learned: in passes in order of time, learning daily from what is normal.

    Example: kirotei radio analyse --in passes.csv --model model.json --out events.csv
    """
    with told("radio analyse"):
        import msgspec

        from services.radio_anomaly.events_file import write_events
        from services.radio_anomaly.file_analysis import analyse as analysed
        from services.radio_anomaly.passes_file import read_passes
        from services.radio_anomaly.radio_model_file import read_model, write_model
        from services.radio_anomaly.told_words import analysis_words

        known = read_model(model)
        rows = read_passes(passes)
        sky = []
        if weather is not None:
            from services.radio_anomaly.weather_file import read_weather

            sky = read_weather(weather)
        found = analysed(rows.readings, known, sky)
        write_events(out, found.events)
        if update:
            write_model(model, found.model)
        if plot is not None:
            from services.radio_anomaly.radio_plot import draw_analysis, save

            save(draw_analysis(known, found.journeys, found.events), plot)
        _say_refused(rows)
        for reason, count in sorted(found.left_out.items()):
            if count:
                typer.echo(f"{passes}: {count} rows left out: {reason}", err=True)
        if as_json:
            typer.echo(msgspec.json.encode({"passes": found.passes, "events": found.events}).decode())
        else:
            _say(analysis_words(found, known))


@app.command()
def show(model: ModelFile, *, as_json: Json = False) -> None:
    """What a model was learned from, how often it reports what is normal, and what is open, a line an incident.

    Example: kirotei radio show --model model.json
    """
    with told("radio show"):
        import msgspec

        from services.radio_anomaly.radio_model_file import read_model
        from services.radio_anomaly.told_words import model_words, open_incidents

        known = read_model(model)
        if as_json:
            fields = {name: getattr(known, name) for name in ("method", "origin", "evidence", "alarms", "events")}
            typer.echo(msgspec.json.encode(fields).decode())
        else:
            _say([*model_words(known), *open_incidents(known)])


@app.command()
def accept(
    model: ModelFile,
    radio: Annotated[str, typer.Option(help="Radio whose new normal it is.")],
    start_m: Annotated[float, typer.Option("--from", help="Kilometrage [m].")],
    end_m: Annotated[float, typer.Option("--to", help="Kilometrage [m].")],
    since: Annotated[str, typer.Option(help="First day of the new normal: 2026-11-22.")],
    by: Annotated[str, typer.Option(help="Who says so.")],
    channel: Annotated[str, typer.Option(help="Left out: every channel.")] = "",
    direction: Annotated[Literal["up", "down"] | None, typer.Option(help="Left out: both.")] = None,
    why: Annotated[str, typer.Option(help="For the log.")] = "",
) -> None:
    """Take what a stretch shows since a day as its new normal. Logged in the model file; `revoke` takes it back.

    Example: kirotei radio accept --model model.json --radio W3 --from 2000 --to 2400 --since 2026-11-20 --by Sato
    """
    with told("radio accept"):
        from services.radio_anomaly.acceptance_words import accepted

        if end_m <= start_m:
            msg = "--to must be beyond --from"
            raise UsageError(msg)
        word = accepted(
            radio=radio,
            channel=channel,
            direction=direction,
            start_m=start_m,
            end_m=end_m,
            since=since,
            by=by,
            why=why,
        )
        _take(model, [word])
        typer.echo(f"accepted as {word.acceptance_id}")


@app.command()
def revoke(
    acceptance: Annotated[str, typer.Argument(help="Its name, as `accept` and `acceptances` print it.")],
    model: ModelFile,
    by: Annotated[str, typer.Option(help="Who takes it back.")],
    why: Annotated[str, typer.Option(help="For the log.")] = "",
) -> None:
    """Take an accepted new normal back: what was learned before counts again.

    Example: kirotei radio revoke 5f0c2a17 --model model.json --by Sato
    """
    with told("radio revoke"):
        import msgspec

        from services.radio_anomaly.radio_model_file import read_model

        found = [word for word in read_model(model).acceptances if word.acceptance_id == acceptance]
        if not found or found[-1].revoked:
            msg = f"{model}: no acceptance {acceptance} in force; see: kirotei radio acceptances --model {model}"
            raise ValueError(msg)
        _take(model, [msgspec.structs.replace(found[-1], revoked=True, by=by, why=why)])
        typer.echo(f"revoked {acceptance}")


@app.command()
def acceptances(model: ModelFile, *, as_json: Json = False) -> None:
    """Log of accepted and revoked new normals.

    Example: kirotei radio acceptances --model model.json
    """
    with told("radio acceptances"):
        import msgspec

        from services.radio_anomaly.events_file import time_text
        from services.radio_anomaly.radio_model_file import read_model

        log = read_model(model).acceptances
        if as_json:
            typer.echo(msgspec.json.encode(log).decode())
            return
        for word in log:
            typer.echo(
                f"{word.acceptance_id}  {'revoked' if word.revoked else 'accepted'}  {word.radio} "
                f"{word.channel or '*'} {word.direction or 'both'}  "
                f"{word.section_start_m:.0f}-{word.section_end_m:.0f} m  since {time_text(word.since_ns)[:10]}  "
                f"by {word.by}: {word.why}"
            )


def _take(model: Path, words: list[object]) -> None:
    from services.radio_anomaly.radio_model import model_of, monitor_of
    from services.radio_anomaly.radio_model_file import read_model, write_model

    known = read_model(model)
    if known.method != "line":
        msg = f"{model}: the paper's method learns once; learn it anew instead"
        raise ValueError(msg)
    monitor = monitor_of(known)
    for word in words:
        monitor.accept(word)  # type: ignore[arg-type]  # acceptances; typed loosely so that --help imports nothing
    write_model(model, model_of(monitor, known.origin, known.evidence))


def _say_refused(rows: Rows) -> None:
    for line in rows.named:
        typer.echo(line, err=True)
    for reason, count in sorted(rows.refused.items()):
        typer.echo(f"{count} rows refused: {reason}", err=True)


def _say(lines: Iterable[str]) -> None:
    for line in lines:
        typer.echo(line)
