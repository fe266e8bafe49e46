"""The `kirotei` command: thin, calls into the rooms. Heavy libraries load when a command needs them."""

from __future__ import annotations

import sys

import typer

from services.cloud_analyzer import command as cloud
from services.gnss_correction import command as gnss
from services.landmark_matching import command as landmarks
from services.line import command as line
from services.motion_sensors import command as motion_sensors
from services.odometry_fusion import command as motion
from services.radio_anomaly import command as radio
from services.recorder import command as recorder
from services.run_history import command as runs
from services.runtime import bench_command, bus_command, demo_command, warm_up_command
from services.runtime import command as runtime
from services.simulator import command as simulator
from services.track_circuit import command as track_circuit
from services.train_position import command as position

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
motion.app.command("import")(motion_sensors.import_log)
motion.app.command()(motion_sensors.calibrate)
app.add_typer(motion.app, name="motion")
app.add_typer(landmarks.app, name="landmarks")
app.add_typer(position.app, name="position")
app.add_typer(line.app, name="line")
app.add_typer(track_circuit.app, name="track-circuit")
app.add_typer(radio.app, name="radio")
app.add_typer(runs.app, name="runs")
app.add_typer(cloud.app, name="cloud")
app.command()(simulator.simulate)
app.command()(simulator.fault)
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
