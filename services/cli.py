"""The `kirotei` command: thin, calls into the rooms. Heavy libraries load when a command needs them."""

from __future__ import annotations

import sys

import typer

from services.gnss_correction import command as gnss
from services.recorder import command as recorder
from services.runtime import bench_command, bus_command, demo_command, warm_up_command
from services.runtime import command as runtime
from services.simulator import command as simulator

app = typer.Typer(
    name="kirotei",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: Rich alone would take longer to load than all the rest
    help="Where a train is on its line, how sure that is, and how healthy the signalling around it is. "
    "Supports people; it is not certified safety equipment.",
)
app.command()(demo_command.demo)
for command in runtime.app_commands:
    app.command()(command)
app.command()(recorder.record)
app.command()(recorder.replay)
app.add_typer(recorder.recording_app, name="recording")
app.add_typer(gnss.app, name="gnss")
app.command()(simulator.simulate)
app.command()(bus_command.topics)
app.command()(bus_command.schema)
app.command()(bus_command.decode)
app.add_typer(runtime.config_app, name="config")
app.command("warm-up")(warm_up_command.warm_up)
app.command()(bench_command.bench)


def main() -> None:
    """Entry point of the console script."""
    try:
        app()
    except BrokenPipeError:  # the reader of a pipe has gone, as with `| head`
        sys.stderr.close()
        sys.exit(0)


if __name__ == "__main__":
    main()
