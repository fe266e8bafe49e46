"""A train's simulation as files: a motion log with truth, the line, where the train was, and a receiver's recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.gnss_time import NS, WEEK_S
from services.odometry_fusion.motion_log_writing_file import write_about, write_imu, write_table
from services.simulator.radio_run_file import write_run
from services.simulator.scenario_file import LoadedRoute, alignment_for, train_radio_line
from services.simulator.simulation_file import (
    CENTRELINE_STEP_M,
    PLACE,
    navigation_over,
    place_words,
    recording_header,
    write_csv,
    write_recording,
)
from services.simulator.train_scenario import TrainScenario
from services.simulator.train_simulation import TICK_NS, Tick, TrainSimulation

LONGEST_S = 86_400.0
"""A train that has not reached its last stop by then is given up."""
REPORT_EVERY = 100


@dataclass(frozen=True, slots=True)
class TrainWritten:
    """What a simulation into files came to."""

    folder: str
    duration_s: float
    distance_m: float
    slips: int
    balises: int
    epochs: int
    true_wheel_diameter_m: float
    files: tuple[str, ...]


@dataclass(slots=True)
class _Gathered:
    """Everything that came out, tick by tick."""

    ticks: list[Tick] = field(default_factory=list)

    def column(self, of: Callable[[Tick], NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate([of(tick) for tick in self.ticks])


def write_train_simulation(
    scenario: TrainScenario,
    folder: Path,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> TrainWritten:
    """Simulate into `folder`, made if need be: `duration_s`, or the scenario's, or until the last stop.

    All files or none: they are written beside and then moved into place, over what stood there.
    `seed` replaces the scenario's own. Raises ScenarioError, RouteError, OSError.
    """
    wanted_s = duration_s or scenario.duration_s
    if wanted_s is None:
        scenario = msgspec.structs.replace(
            scenario, journey=msgspec.structs.replace(scenario.journey, turns_back=False)
        )
    start_ns = scenario.start_gps_week * WEEK_S * NS + round(scenario.start_tow_s * NS)
    loaded = alignment_for(scenario)
    generator = np.random.default_rng(scenario.seed if seed is None else seed)
    simulation = TrainSimulation(
        scenario, loaded.alignment if loaded else None, start_ns, generator, train_radio_line(scenario, loaded)
    )
    gathered = _run(simulation, wanted_s, progress)
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder, prefix=".simulate-") as name:
        beside = Path(name)
        _write_motion(beside, simulation, gathered, start_ns)
        if loaded is not None:
            _write_line(beside, simulation, loaded, gathered)
        if simulation.receiver is not None and loaded is not None:
            _write_receiver(beside, simulation, loaded, gathered, start_ns)
        if simulation.radio is not None and simulation.route is not None:
            write_run(beside / "passes.csv", gathered.ticks, simulation.route)
        files = tuple(sorted(path.name for path in beside.iterdir()))
        for file in files:
            (beside / file).replace(folder / file)
    return _written(folder, simulation, gathered, files)


def _run(simulation: TrainSimulation, wanted_s: float | None, progress: Callable[[float], None] | None) -> _Gathered:
    gathered = _Gathered()
    count = round((wanted_s or LONGEST_S) * NS / TICK_NS)
    length_m = float(simulation.motion.way_left_m)
    for i in range(max(count, 1)):
        gathered.ticks.append(simulation.step())
        if progress is not None and i % REPORT_EVERY == 0:
            left_m = simulation.motion.way_left_m
            progress(i / count if wanted_s is not None else 1.0 - left_m / max(length_m, 1.0))
        if wanted_s is None and simulation.motion.finished:
            break
    if progress is not None:
        progress(1.0)
    return gathered


def _written(folder: Path, simulation: TrainSimulation, gathered: _Gathered, files: tuple[str, ...]) -> TrainWritten:
    slip = gathered.column(lambda tick: tick.samples.slip)
    return TrainWritten(
        folder=str(folder),
        duration_s=simulation.now_s,
        distance_m=round(float(gathered.ticks[-1].samples.distance_m[-1]), 3),
        slips=int(np.count_nonzero((slip[1:] != 0) & (slip[:-1] == 0))),
        balises=sum(len(tick.balises) for tick in gathered.ticks),
        epochs=sum(tick.instant is not None for tick in gathered.ticks),
        true_wheel_diameter_m=simulation.sensors.tacho.diameter_m,
        files=files,
    )


def _write_motion(folder: Path, simulation: TrainSimulation, gathered: _Gathered, start_ns: int) -> None:
    settings = simulation.scenario.motion
    week, rest_ns = divmod(start_ns, WEEK_S * NS)
    write_about(
        folder / "motion.toml",
        {
            "pulses_per_revolution": settings.vehicle.teeth,
            "wheel_diameter_m": settings.vehicle.wheel_diameter_m,
            "imu_latency_s": settings.imu.latency_s,
            "max_gradient_permille": settings.max_gradient_permille,
            "scenario": simulation.scenario.name,
            "start_gps_week": week,
            "start_tow_s": rest_ns / NS,
        },
    )
    imu_t_s = gathered.column(lambda tick: tick.sensors.imu_t_s)
    write_imu(folder / "imu.parquet", imu_t_s, gathered.column(lambda tick: tick.sensors.imu))
    write_table(
        folder / "tacho.parquet",
        {
            "t_s": gathered.column(lambda tick: tick.sensors.tacho_t_s),
            "pulses": gathered.column(lambda tick: tick.sensors.counts),
        },
    )
    write_table(
        folder / "truth.parquet",
        {
            "t_s": gathered.column(lambda tick: tick.samples.t_s[-1:]),
            "distance_m": gathered.column(lambda tick: tick.samples.distance_m[-1:]),
            "speed_mps": gathered.column(lambda tick: (tick.samples.speed_mps * tick.samples.forward)[-1:]),
            "slip": gathered.column(lambda tick: tick.samples.slip[-1:]),
            "acceleration_mps2": gathered.column(lambda tick: tick.samples.acceleration_mps2[-1:]),
        },
    )


def _write_line(folder: Path, simulation: TrainSimulation, loaded: LoadedRoute, gathered: _Gathered) -> None:
    """Write the line, the train's place on it at 10 Hz, balises passed and changes of cab."""
    encoded = msgspec.json.format(msgspec.json.encode(loaded.line), indent=1)
    (folder / "line.json").write_bytes(encoded + b"\n")
    truths = [tick.truth for tick in gathered.ticks if tick.truth is not None]
    columns: dict[str, NDArray[Any]] = {"t_s": gathered.column(lambda tick: tick.samples.t_s[-1:])}
    for name in ("axis_m", "chainage_m", "speed_mps", "gradient_permille", "curvature_per_m"):
        columns[name] = np.array([getattr(truth, name) for truth in truths])
    columns["branch"] = np.array([truth.branch for truth in truths], dtype=object)
    route, propels = simulation.route, simulation.scenario.journey.propels
    rises = [route is not None and route.rises(0 if propels else int(tick.samples.trip[-1])) for tick in gathered.ticks]
    columns["direction"] = np.array(["up" if up else "down" for up in rises], dtype=object)
    write_table(folder / "place.parquet", columns)
    start_utc_ns = truths[0].t_ns - TICK_NS

    def seconds(t_ns: int) -> str:
        return f"{(t_ns - start_utc_ns) / NS:.3f}"

    write_csv(
        folder / "balises.csv",
        ("t_s", "balise", "sensor_offset_m", "detection_bound_m"),
        (
            (seconds(one.t_ns), one.balise, one.sensor_offset_m, one.detection_bound_m)
            for tick in gathered.ticks
            for one in tick.balises
        ),
    )
    write_csv(
        folder / "changes.csv",
        ("t_s", "kind", "cab"),
        ((seconds(one.t_ns), one.kind, one.cab) for tick in gathered.ticks for one in tick.changes),
    )


def _write_receiver(
    folder: Path, simulation: TrainSimulation, loaded: LoadedRoute, gathered: _Gathered, start_ns: int
) -> None:
    receiver = simulation.receiver
    assert receiver is not None  # noqa: S101 - the caller has looked
    alignment = loaded.alignment
    instants = [tick.instant for tick in gathered.ticks if tick.instant is not None]
    x, y, z = alignment.axis.at(alignment.length_m / 2).tolist()
    header = recording_header(
        loaded.line.id, simulation.scenario.name, (x, y, z), simulation.scenario.receiver.interval_s
    )
    write_recording(folder, instants, navigation_over(receiver.sky, start_ns, gathered.ticks[-1].gps_ns), header)
    places = np.append(np.arange(0.0, alignment.length_m, CENTRELINE_STEP_M), alignment.length_m)
    words = place_words(*alignment.position(places))
    write_csv(
        folder / "track_centreline.csv",
        ("chainage_m", *PLACE),
        ((f"{axis:.2f}", *place) for axis, place in zip(places, words, strict=True)),
    )
    stations = [station.axis_m for station in alignment.stations]
    write_csv(
        folder / "stations.csv",
        ("name", "chainage_m", *PLACE),
        (
            (station.name, f"{station.axis_m:.2f}", *place)
            for station, place in zip(alignment.stations, place_words(*alignment.position(stations)), strict=True)
        ),
    )
