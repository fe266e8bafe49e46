"""`kirotei simulate` and `kirotei fault`: a simulated train into files or onto the bus, and what goes wrong with it."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from services.simulator.radio_passes_file import RadioWritten
    from services.simulator.radio_scenario import RadioScenario
    from services.simulator.scenario import Scenario
    from services.simulator.simulation_file import Written
    from services.simulator.train_scenario import TrainScenario
    from services.simulator.train_simulation_file import TrainWritten

ROUTER = "tcp/127.0.0.1:7447"


def simulate(
    scenario: Annotated[str, typer.Argument(help="Scenario in a TOML file, or the name of one that comes with it.")],
    *,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the files; made if need be.")] = None,
    live: Annotated[bool, typer.Option("--live", help="Run it on the bus, router included, until Ctrl-C.")] = False,
    fleet: Annotated[int, typer.Option(min=1, max=50, help="With --live: trains, one after another.")] = 1,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed in place of the scenario's.")] = None,
    duration: Annotated[
        float | None, typer.Option(min=1.0, max=86_400.0, help="Seconds; one run when left out.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Simulate a train: a motion log with truth, the line, a receiver's RINEX files; or live on the bus.

    Scenarios that come with Kirotei: demo_line, street_canyon, slips_16permille, slips_33permille,
    curves_only, wet_leaves, bad_sensors; of radio alone, over days: radio_table2, radio_passes, radio_faults,
    radio_lapse. Examples: kirotei simulate demo_line --out run1;
    kirotei simulate demo_line --live --fleet 3
    """
    from services.simulator.scenario import ScenarioError
    from services.simulator.scenario_file import read_any_scenario

    if (out is None) != live:
        _refuse("simulate", "give either --out DIR or --live", 2)
    if fleet != 1 and not live:
        _refuse("simulate", "--fleet goes with --live", 2)
    try:
        settings = read_any_scenario(scenario)
    except ScenarioError as error:
        _refuse("simulate", str(error), 2)
    if out is None:
        from services.simulator.live_command import run_live

        run_live(scenario, fleet, seed)
    if out.exists() and not out.is_dir():
        _refuse("simulate", f"{out} is there and is no folder", 2)

    from rich.console import Console

    from services.simulator.train_route import RouteError

    try:
        written = _write(settings, out, seed, duration, Console(stderr=True))
    except (ScenarioError, RouteError) as error:
        _refuse("simulate", f"{scenario}: {error}", 2)
    except OSError as error:
        _refuse("simulate", f"{error.filename or out}: {error.strerror or error}", 1)
    typer.echo(json.dumps(asdict(written), indent=2) if as_json else _summary(written))


def _write(
    settings: Scenario | TrainScenario | RadioScenario,
    out: Path,
    seed: int | None,
    duration: float | None,
    console: Console,
) -> Written | TrainWritten | RadioWritten:
    from rich.progress import Progress

    from services.simulator.radio_passes_file import write_radio_passes
    from services.simulator.radio_scenario import RadioScenario
    from services.simulator.simulation_file import write_simulation
    from services.simulator.train_scenario import TrainScenario
    from services.simulator.train_simulation_file import write_train_simulation

    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(f"simulating {settings.name}", total=1.0)

        def progress(done: float) -> None:
            bar.update(task, completed=done)

        if isinstance(settings, RadioScenario):
            return write_radio_passes(settings, out, seed=seed, progress=progress)
        if isinstance(settings, TrainScenario):
            return write_train_simulation(settings, out, seed=seed, duration_s=duration, progress=progress)
        return write_simulation(settings, out, seed=seed, duration_s=duration, progress=progress)


def _summary(written: Written | TrainWritten | RadioWritten) -> str:
    from services.simulator.radio_passes_file import RadioWritten
    from services.simulator.simulation_file import Written

    if isinstance(written, RadioWritten):
        files = ", ".join(written.files)
        return f"{written.folder}: {written.passes} passes, {written.rows} measurements\nfiles: {files}"
    if not isinstance(written, Written):
        return (
            f"{written.folder}: {written.duration_s:.0f} s, {written.distance_m / 1000.0:.2f} km, "
            f"{written.slips} slips, {written.balises} balises, {written.epochs} epochs\n"
            f"files: {', '.join(written.files)}"
        )
    total = sum(written.reception.values())
    shares = ", ".join(f"{name.replace('_', ' ')} {100 * n / total:.0f} %" for name, n in written.reception.items())
    return (
        f"{written.folder}: {written.epochs} epochs over {written.duration_s:.0f} s, "
        f"{written.satellites:.1f} satellites measured on average\nsignals: {shares or 'none'}"
    )


def fault(
    kind: Annotated[str, typer.Argument(help="slide, spin, micro_slip, gnss_lost, gyro_bias, …")],
    *,
    train: Annotated[str, typer.Option(help="The simulated train.")] = "T1",
    line: Annotated[str, typer.Option(help="Its line.")] = "demo",
    magnitude: Annotated[float | None, typer.Option(help="How much; a usual amount when left out.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="How long; until switched off when left out.")] = None,
    off: Annotated[bool, typer.Option("--off", help="Switch it off.")] = False,
    stretch: Annotated[
        str | None, typer.Option("--at", help="Radio: axis_m of a stretch, 4000:4500, or of a place, 4000.")
    ] = None,
    radio: Annotated[str, typer.Option(help="Radio: the wayside radio; all when left out.")] = "",
    channel: Annotated[str, typer.Option(help="Radio: the channel; all when left out.")] = "",
    connect: Annotated[str, typer.Option(help="Router.")] = ROUTER,
) -> None:
    """Switch a fault of a simulated train on or off while it runs.

    Kinds and their magnitudes: docs/simulator.md. Examples: kirotei fault slide --seconds 6 --magnitude 4;
    kirotei fault radio_obstruction --at 2000:2500
    """
    from typing import cast, get_args

    import msgspec

    from schemas.position import FaultKind, SimulatorFault
    from schemas.topic import Place, TopicError
    from services.runtime.catalogue import suggestion
    from services.simulator.fault_sizes import size_fault

    kinds = get_args(FaultKind)
    if kind not in kinds:
        _refuse("fault", f"no fault {kind!r}{suggestion(kind, kinds)}; there are: {', '.join(kinds)}", 2)
    if off and (magnitude is not None or seconds is not None):
        _refuse("fault", "--magnitude and --seconds go with switching on", 2)
    if wrong := size_fault(cast("FaultKind", kind), magnitude):
        _refuse("fault", f"--magnitude: {wrong}", 2)
    if not kind.startswith("radio_") and (stretch is not None or radio or channel):
        _refuse("fault", "--at, --radio and --channel go with the faults of radios", 2)
    try:
        place = Place(line, "train", train)
        start_m, end_m = _stretch(stretch)
    except (TopicError, ValueError) as error:
        _refuse("fault", str(error), 2)
    fields = {"t_ns": 0, "kind": kind, "active": not off, "magnitude": magnitude, "duration_s": seconds}
    fields |= {"start_axis_m": start_m, "end_axis_m": end_m, "radio": radio, "channel": channel}
    message = msgspec.convert(fields, SimulatorFault)

    from services.simulator.fault_command import run_fault

    run_fault(message, place, connect)


def _stretch(text: str | None) -> tuple[float | None, float | None]:
    """Both ends of a stretch; ValueError for what is none."""
    if text is None:
        return None, None
    start, _, end = text.partition(":")
    try:
        start_m, end_m = float(start), float(end or start)
    except ValueError:
        start_m, end_m = 1.0, 0.0
    if not 0.0 <= start_m <= end_m < float("inf"):
        msg = f"--at {text}: give a place or a stretch in metres, 4000 or 4000:4500"
        raise ValueError(msg)
    return start_m, end_m


def _refuse(command: str, text: str, code: int) -> NoReturn:
    typer.echo(f"kirotei {command}: {text}", err=True)
    raise typer.Exit(code)
