"""A simulation as the files of a measurement run: RINEX, truth, line."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from schemas.gnss import Ephemeris, Epoch
from schemas.gnss_time import NS, WEEK_S
from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.rinex_navigation_file import write_navigation
from services.gnss_receiver.rinex_observation_file import write_observations
from services.gnss_receiver.rinex_observation_text import RecordingHeader
from services.simulator.scenario import Scenario
from services.simulator.simulation import Instant, Simulation
from services.simulator.sky import VisibleSky

Floats = NDArray[np.float64]
FILES = (
    "rover.obs",
    "nav.rnx",
    "truth.csv",
    "track_centreline.csv",
    "stations.csv",
    "pseudorange_error.csv",
)
CENTRELINE_STEP_M = 2.0
"""Chords of 2 m stay within 2 mm of a curve of 300 m radius."""
REPORT_EVERY = 50
"""Epochs between two reports of progress."""
Rows = Iterable[Sequence[object]]
PLACE = ("lat_deg", "lon_deg", "h_ell_m")


@dataclass(frozen=True, slots=True)
class Written:
    """What a simulation into files came to."""

    folder: str
    epochs: int
    duration_s: float
    satellites: float
    """Measured per epoch, on average."""
    reception: dict[str, int]
    """Satellites above the mask, summed over the epochs, by how their signal came in."""


def write_simulation(
    scenario: Scenario,
    folder: Path,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> Written:
    """Simulate `duration_s` (one run there and back when left out) into `folder`, made if need be.

    All files or none: they are written beside and then moved into place, over what stood there.
    `seed` replaces the scenario's own. `progress` gets the fraction done. Raises OSError.
    """
    start_ns = scenario.start_gps_week * WEEK_S * NS + round(scenario.start_tow_s * NS)
    generator = np.random.default_rng(scenario.seed if seed is None else seed)
    simulation = Simulation(scenario, start_ns, generator)
    wanted_s = simulation.run.period_s if duration_s is None else duration_s
    count = int(wanted_s / scenario.receiver.interval_s) + 1
    interval_ns = round(scenario.receiver.interval_s * NS)
    navigation = navigation_over(simulation.sky, start_ns, start_ns + (count - 1) * interval_ns)
    instants: list[Instant] = []
    for i in range(count):
        instants.append(simulation.step())
        if progress is not None and i % REPORT_EVERY == 0:
            progress(i / count)
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder, prefix=".simulate-") as beside:
        _write_all(Path(beside), simulation, instants, navigation)
        for name in FILES:
            (Path(beside) / name).replace(folder / name)
    if progress is not None:
        progress(1.0)
    receptions = [reception for instant in instants for reception in instant.reception]
    return Written(
        folder=str(folder),
        epochs=count,
        duration_s=(count - 1) * scenario.receiver.interval_s,
        satellites=sum(len(instant.epoch.satellites) for instant in instants) / count,
        reception={name: receptions.count(name) for name in sorted(set(receptions))},
    )


def navigation_over(sky: VisibleSky, start_ns: int, end_ns: int) -> Navigation:
    """Every ephemeris that is broadcast between two GPS times [ns], in order of reference time."""
    broadcast: dict[tuple[int, float, str], Ephemeris] = {}
    for at_ns in range(start_ns, end_ns + 1, 60 * NS):
        for ephemeris in sky.ephemerides(at_ns):
            broadcast[ephemeris.gps_week, ephemeris.toe_s, ephemeris.satellite] = ephemeris
    return Navigation(ephemerides=tuple(broadcast.values()), ionosphere=sky.ionosphere(start_ns))


def _write_all(folder: Path, simulation: Simulation, instants: Sequence[Instant], navigation: Navigation) -> None:
    scenario = simulation.scenario
    x, y, z = simulation.plane.ecef(np.zeros(3)).tolist()
    header = recording_header(scenario.line.id, scenario.name, (x, y, z), scenario.receiver.interval_s)
    write_recording(folder, instants, navigation, header)
    write_csv(folder / "track_centreline.csv", ("chainage_m", *PLACE), _centreline_rows(simulation))
    write_csv(folder / "stations.csv", ("name", "chainage_m", *PLACE), _station_rows(simulation))


def recording_header(
    marker: str, scenario: str, position_m: tuple[float, float, float], interval_s: float
) -> RecordingHeader:
    """What a simulated observation file says of itself."""
    return RecordingHeader(
        marker=marker,
        observer="kirotei simulate",
        receiver="simulated",
        antenna="simulated",
        approximate_position_m=position_m,
        interval_s=interval_s,
        comments=(f"simulated, scenario {scenario}",),
    )


def write_recording(folder: Path, instants: Sequence[Instant], navigation: Navigation, header: RecordingHeader) -> None:
    """Write what the receiver measured, what was broadcast, where the antenna was, and how wrong pseudoranges are."""
    write_observations(folder / "rover.obs", [instant.epoch for instant in instants], header)
    write_navigation(folder / "nav.rnx", navigation)
    write_csv(folder / "truth.csv", ("gps_week", "tow_s", *PLACE), map(_truth_row, instants))
    write_csv(
        folder / "pseudorange_error.csv",
        ("gps_week", "tow_s", "satellite", "error_m"),
        (row for instant in instants for row in _error_rows(instant)),
    )


def _truth_row(instant: Instant) -> Sequence[object]:
    truth = instant.truth
    return (*_time(instant.epoch), f"{truth.lat_deg:.10f}", f"{truth.lon_deg:.10f}", f"{truth.h_m:.4f}")


def _error_rows(instant: Instant) -> Rows:
    time = _time(instant.epoch)
    for satellite, error_m in zip(instant.epoch.satellites, instant.code_error_m.tolist(), strict=True):
        yield (*time, satellite, f"{error_m:.3f}")


def _time(epoch: Epoch) -> tuple[int, str]:
    return epoch.gps_week, f"{epoch.tow_s:.3f}"


def _centreline_rows(simulation: Simulation) -> Rows:
    length_m = simulation.axis.length_m
    axis_m = np.append(np.arange(0.0, length_m, CENTRELINE_STEP_M), length_m)
    return ((f"{axis:.2f}", *place) for axis, place in zip(axis_m, _places(simulation, axis_m), strict=True))


def _station_rows(simulation: Simulation) -> Rows:
    stations = simulation.scenario.line.stations
    places = _places(simulation, np.array([station.axis_m for station in stations]))
    return ((s.name, f"{s.axis_m:.2f}", *place) for s, place in zip(stations, places, strict=True))


def _places(simulation: Simulation, axis_m: Floats) -> list[tuple[str, str, str]]:
    """Latitude, longitude and ellipsoidal height of the rail, as they stand in files."""
    axis = simulation.axis.at(axis_m)
    points = np.stack([axis.x_m, axis.y_m, np.zeros_like(axis.x_m)], axis=1)
    return place_words(*simulation.plane.geodetic_deg(points))


def place_words(lat_deg: Floats, lon_deg: Floats, h_m: Floats) -> list[tuple[str, str, str]]:
    """Places as they stand in files."""
    return [(f"{lat:.10f}", f"{lon:.10f}", f"{h:.4f}") for lat, lon, h in zip(lat_deg, lon_deg, h_m, strict=True)]


def write_csv(path: Path, header: Sequence[str], rows: Rows) -> None:
    """Write a table."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
