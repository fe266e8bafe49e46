"""What is simulated: line, train, sky, surroundings and receiver, as frozen structs with limits.

A scenario comes from a TOML file (scenario_file.py); `scenario_from_toml` names an unknown field
or a bad value by its path. Lengths along the line are `axis_m`, sides are seen towards rising
`axis_m`.
"""

from __future__ import annotations

from math import isfinite
from typing import Annotated, Final, Literal, NoReturn

import msgspec
import numpy as np
from msgspec import Meta

from services.simulator.line_shape import Element, LineShape, LineShapeError

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Fraction = Annotated[float, Meta(ge=0.0, lt=1.0)]
Name = Annotated[str, Meta(pattern="^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")]
Side = Literal["left", "right", "both"]
MAX_LINE_M: Final = 20_000.0
"""A tangent plane stretches lengths by 2e-6 at 10 km from its origin."""
Range = tuple[float, float]
"""Smallest and largest of values drawn uniformly."""


class ScenarioError(ValueError):
    """A scenario that cannot be simulated."""


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of a scenario file."""


class Station(Part, frozen=True, kw_only=True):
    """Where the train calls."""

    name: str
    axis_m: NotNegative


class Line(Part, frozen=True, kw_only=True):
    """The line; level, its rail at one ellipsoidal height."""

    id: Name
    name: str
    origin_lat_deg: Annotated[float, Meta(ge=-85.0, le=85.0)]
    origin_lon_deg: Annotated[float, Meta(ge=-180.0, le=180.0)]
    rail_height_m: float
    """Ellipsoidal height of the rail."""
    bearing_deg: float
    """Direction at the origin, clockwise from north."""
    elements: Annotated[tuple[Element, ...], Meta(min_length=1)]
    stations: Annotated[tuple[Station, ...], Meta(min_length=2)]


class Train(Part, frozen=True, kw_only=True):
    """How the train runs; its place is that of its antenna."""

    cruise_mps: Positive = 18.0
    acceleration_mps2: Positive = 0.7
    braking_mps2: Positive = 0.8
    dwell_s: NotNegative = 25.0
    antenna_above_rail_m: Positive = 4.0


class Sky(Part, frozen=True, kw_only=True):
    """Satellites, and what lies between them and the ground."""

    systems: Annotated[str, Meta(pattern="^(G|E|GE)$")] = "G"
    signal_in_space_sigma_m: NotNegative = 0.6
    """Spread of a constant range error per satellite (orbit and clock against the broadcast ones)."""
    ionosphere_alpha: tuple[float, float, float, float] = (1.1176e-8, 2.2352e-8, -5.9605e-8, -1.1921e-7)
    ionosphere_beta: tuple[float, float, float, float] = (9.0112e4, 9.8304e4, -6.5536e4, -5.2429e5)
    ionosphere_scale: NotNegative = 1.15
    """True delay against the broadcast model; the model halves the error, no more (IS-GPS-200)."""
    troposphere_scale: NotNegative = 1.0
    """True delay against the standard atmosphere."""


class Receiver(Part, frozen=True, kw_only=True):
    """A single-frequency code and carrier receiver."""

    interval_s: Annotated[float, Meta(ge=0.01, le=60.0)] = 0.2
    elevation_mask_deg: Annotated[float, Meta(ge=0.0, lt=90.0)] = 5.0
    cn0_zenith_dbhz: float = 49.0
    cn0_horizon_dbhz: float = 36.0
    cn0_satellite_sigma_db: NotNegative = 1.0
    """Spread of a constant difference in power between satellites."""
    cn0_noise_db: NotNegative = 0.4
    tracking_threshold_dbhz: float = 24.0
    """Weaker signals are lost."""
    reacquisition_s: NotNegative = 0.6
    """A signal must have been there this long before it is measured again."""
    noise_scale: NotNegative = 1.0
    """Thermal noise of code, carrier and C/N0 against theory; 0 switches it off."""
    correlator_spacing_chips: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.2
    """Early to late."""
    code_loop_bandwidth_hz: Annotated[float, Meta(gt=0.0, le=20.0)] = 0.25
    carrier_loop_bandwidth_hz: Positive = 15.0
    frequency_loop_bandwidth_hz: Positive = 8.0
    integration_s: Positive = 0.02
    multipath_averaging_s: NotNegative = 0.1
    """Reflections that turn against the direct signal within this time cancel in the loops."""
    clock_bias_s: float = 3.0e-4
    """At the start, receiver minus GPS time."""
    clock_drift: Annotated[float, Meta(ge=-1e-4, le=1e-4)] = 1.0e-6
    """At the start [s/s]."""
    clock_drift_walk: NotNegative = 2.0e-10
    """Random walk of the drift [s/s per square root of a second]."""
    clock_jump_s: NotNegative = 1.0e-3
    """Step by which the clock is set back when it is off by more than half of it; 0: never."""


class BuildingRow(Part, frozen=True, kw_only=True):
    """Buildings side by side along the track, drawn from ranges."""

    name: str
    """What these surroundings are called ('street canyon')."""
    from_m: float
    to_m: float
    side: Side = "both"
    setback_m: Range = (9.0, 13.0)
    """Facade from the track's centre."""
    length_m: Range = (18.0, 45.0)
    gap_m: Range = (2.0, 6.0)
    height_m: Range = (20.0, 45.0)
    """Above the street."""
    depth_m: Positive = 15.0
    twist_deg: NotNegative = 0.4
    """Largest angle between facade and track, either way."""
    reflectivity: Range = (0.35, 0.6)
    """Amplitude given back by a facade."""


class Deck(Part, frozen=True, kw_only=True):
    """A flat cover above the track: overbridge, station roof."""

    name: str
    from_m: float
    to_m: float
    width_m: Positive
    """Across the track, centred on it."""
    clearance_m: Positive
    """Underside above the rail."""
    thickness_m: Positive = 1.5


class Scene(Part, frozen=True, kw_only=True):
    """What stands along the line."""

    street_below_rail_m: NotNegative = 7.0
    """How far the rail is above the street (a viaduct)."""
    rows: tuple[BuildingRow, ...] = ()
    decks: tuple[Deck, ...] = ()


class Scenario(Part, frozen=True, kw_only=True):
    """Everything that decides what is simulated, but the seed's draws."""

    name: Name
    about: str = ""
    seed: Annotated[int, Meta(ge=0)] = 1
    start_gps_week: Annotated[int, Meta(ge=1024, le=8191)] = 2412
    """When a simulation into files starts; live it starts now."""
    start_tow_s: Annotated[float, Meta(ge=0.0, lt=604_800.0)] = 180_000.0
    line: Line
    train: Train = Train()
    sky: Sky = Sky()
    receiver: Receiver = Receiver()
    scene: Scene = Scene()


def scenario_from_toml(text: str) -> Scenario:
    """Scenario in a TOML text. Raises ScenarioError with the path of the field that is wrong."""
    try:
        scenario = msgspec.toml.decode(text, type=Scenario)
    except msgspec.ValidationError as error:
        raise ScenarioError(str(error)) from error
    except msgspec.DecodeError as error:
        msg = f"not TOML: {error}"
        raise ScenarioError(msg) from error
    require_finite(msgspec.to_builtins(scenario), "$")
    _require_line(scenario)
    for i, row in enumerate(scenario.scene.rows):
        _require_row(row, f"$.scene.rows[{i}]")
    for i, deck in enumerate(scenario.scene.decks):
        _require_stretch(deck.from_m, deck.to_m, f"$.scene.decks[{i}]")
        if deck.clearance_m <= scenario.train.antenna_above_rail_m:
            _refuse("the antenna would hit it", f"$.scene.decks[{i}].clearance_m")
    return scenario


def axis_of(line: Line) -> LineShape:
    """Shape of a line. Raises LineShapeError."""
    return LineShape(line.elements, np.deg2rad(90.0 - line.bearing_deg))


def _refuse(what: str, path: str) -> NoReturn:
    msg = f"{what} - at `{path}`"
    raise ScenarioError(msg)


def require_finite(value: object, path: str) -> None:
    """Refuse a number that is not finite, anywhere in builtins; ScenarioError names its path."""
    if isinstance(value, float) and not isfinite(value):
        _refuse("a finite number is wanted", path)
    if isinstance(value, dict):
        for name, inner in value.items():
            require_finite(inner, f"{path}.{name}")
    if isinstance(value, list | tuple):
        for i, inner in enumerate(value):
            require_finite(inner, f"{path}[{i}]")


def _require_line(scenario: Scenario) -> None:
    line = scenario.line
    try:
        length_m = axis_of(line).length_m
    except LineShapeError as error:
        _refuse(str(error), "$.line.elements")
    if length_m > MAX_LINE_M:
        _refuse(f"{length_m:.0f} m are too long for one plane, {MAX_LINE_M:.0f} m at most", "$.line.elements")
    for i, station in enumerate(line.stations):
        if station.axis_m > length_m:
            _refuse(f"{station.axis_m} m lies beyond the line's {length_m} m", f"$.line.stations[{i}].axis_m")
        if i and station.axis_m <= line.stations[i - 1].axis_m:
            _refuse("stations must stand in rising order", f"$.line.stations[{i}].axis_m")


def _require_stretch(from_m: float, to_m: float, path: str) -> None:
    if not from_m < to_m <= from_m + MAX_LINE_M:
        _refuse(f"to_m must be beyond from_m, by {MAX_LINE_M:.0f} m at most", path)


def _require_row(row: BuildingRow, path: str) -> None:
    _require_stretch(row.from_m, row.to_m, path)
    limits = {
        "setback_m": (1.0, 1e3),
        "length_m": (1.0, 1e3),
        "gap_m": (0.0, 1e3),
        "height_m": (0.0, 1e3),
        "reflectivity": (0.0, 0.95),
    }
    for name, (least, most) in limits.items():
        low, high = getattr(row, name)
        if not least <= low <= high <= most:
            _refuse(f"({low}, {high}) is no rising range within {least} to {most}", f"{path}.{name}")
