"""The demo of the wet ballast in virtual time: what deploy/profiles/wet_ballast.toml shows, as a picture."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from schemas.track_circuit import CircuitEvent, CircuitOccupancy, Telegram
from services.simulator.track_circuit_scene import SimulatedCircuit
from services.simulator.track_circuit_settings import TrackCircuitSettings
from services.track_circuit.circuit_live import LiveCircuit
from services.track_circuit.code_table import CodeTable
from services.track_circuit.reception_plot import STATES, above_axes, grid_of
from services.track_circuit.settings import CircuitSettings

PROFILE_FILE = Path(__file__).parents[1] / "deploy" / "profiles" / "wet_ballast.toml"
NS = 1_000_000_000
START_NS = 1_795_305_600 * NS
CONFIRMED_S = 3.0
SECONDS = 130.0
LEVEL, REFERENCE, BALLAST, OCCUPIED, RESTRICTIVE = "#1b6ca8", "#9a9a9a", "#3f8f4f", "#f8ead2", "#c62828"


@dataclass
class Heard:
    """What a circuit said, and the weather meanwhile."""

    settings: CircuitSettings
    ballast: list[tuple[float, float]] = field(default_factory=list)
    occupancy: list[CircuitOccupancy] = field(default_factory=list)
    telegrams: list[Telegram] = field(default_factory=list)
    events: list[CircuitEvent] = field(default_factory=list)


def heard_of(simulated: TrackCircuitSettings, settings: CircuitSettings, seconds: float) -> Heard:
    """A circuit over its weather; a person confirms it clear as the simulator does on the bus."""
    live = LiveCircuit(settings, CodeTable(), on_board=False, now_s=0.0)
    scene, heard, confirmed = SimulatedCircuit(simulated), Heard(settings), False
    while scene.next_s < seconds:
        block = scene.step(START_NS)
        now_s = scene.next_s
        now_ns = START_NS + round(now_s * NS)
        said = [] if block is None else live.take(block, now_ns, now_s)
        if not confirmed and now_s >= CONFIRMED_S:
            confirmed = True
            said = said + live.confirm(now_ns, now_ns, now_s)
        heard.ballast.append((now_s, scene.ballast_s_per_km(now_s)))
        for one in [*said, *live.tick(now_ns, now_s)]:
            match one:
                case CircuitOccupancy():
                    heard.occupancy.append(one)
                case Telegram():
                    heard.telegrams.append(one)
                case CircuitEvent():
                    heard.events.append(one)
    return heard


def demo(seconds: float = SECONDS) -> list[Heard]:
    """Every circuit of the profile."""
    table: dict[str, Any] = tomllib.loads(PROFILE_FILE.read_text("utf-8"))
    rails = msgspec.convert(table["simulator"]["track_circuits"], tuple[TrackCircuitSettings, ...])
    circuits = msgspec.convert(table["track_circuit"]["circuits"], tuple[CircuitSettings, ...])
    by_name = {one.name: one for one in rails}
    return [heard_of(by_name[one.name], one, seconds) for one in circuits]


def _seconds(t_ns: int) -> float:
    return (t_ns - START_NS) / NS


def _draw_level(axes: Axes, one: Heard) -> None:
    told = [(_seconds(state.t_ns), state) for state in one.occupancy]
    level = [(t_s, state.level_db) for t_s, state in told if state.level_db is not None]
    reference = [(t_s, state.reference_db) for t_s, state in told if state.reference_db is not None]
    axes.plot(*zip(*level, strict=True), ".", markersize=3, color=LEVEL, label="level of CH2")
    axes.plot(*zip(*reference, strict=True), color=REFERENCE, linewidth=1.0, label="reference")
    grid_of(axes, "", "level [dB]")
    other = axes.twinx()
    other.semilogy(*zip(*one.ballast[::5], strict=True), color=BALLAST, linewidth=1.0, label="ballast")
    other.set_ylabel("ballast [S/km]", fontsize=9, color=BALLAST)
    other.set_yticks([0.02, 0.05, 0.1, 0.2, 0.5], labels=["0.02", "0.05", "0.1", "0.2", "0.5"])
    other.minorticks_off()
    other.tick_params(labelsize=8, colors=BALLAST)
    above_axes(axes)
    axes.set_title("one rail: its ballast gets wet and dries", fontsize=9, loc="left")


def spans(one: Heard, holds: Callable[[CircuitOccupancy], bool]) -> list[tuple[float, float]]:
    """From when to when something held, in seconds."""
    found: list[tuple[float, float]] = []
    begin_s: float | None = None
    for state in one.occupancy:
        t_s = _seconds(state.t_ns)
        if holds(state) and begin_s is None:
            begin_s = t_s
        elif not holds(state) and begin_s is not None:
            found.append((begin_s, t_s))
            begin_s = None
    return found if begin_s is None else [*found, (begin_s, SECONDS)]


def _draw_circuit(axes: Axes, one: Heard) -> None:
    """EVM and state of each telegram; occupied shaded, most restrictive as a bar."""
    for begin_s, end_s in spans(one, lambda state: state.state == "occupied"):
        axes.axvspan(begin_s, end_s, color=OCCUPIED, linewidth=0, zorder=0)
    for begin_s, end_s in spans(one, lambda state: state.most_restrictive):
        axes.plot(
            [begin_s, max(end_s, begin_s + 0.3)], [5.0, 5.0], color=RESTRICTIVE, linewidth=5, solid_capstyle="butt"
        )
    for name in dict.fromkeys(telegram.state for telegram in one.telegrams):
        chosen = [telegram for telegram in one.telegrams if telegram.state == name]
        times = [_seconds(telegram.t_ns) for telegram in chosen]
        errors = [math.nan if telegram.evm_db is None else telegram.evm_db for telegram in chosen]
        axes.plot(times, errors, ".", markersize=4, color=STATES[name], label=f"{len(chosen)} {name}")
    axes.set_ylim(-20.0, 7.0)
    grid_of(axes, "", "EVM [dB]")
    above_axes(axes, 4)
    words = f"{one.settings.name}, receiver {one.settings.receiver}: shaded occupied, red most restrictive"
    axes.set_title(words, fontsize=9, loc="left")


def draw_weather() -> Figure:
    """The whole demo, one panel per receiver."""
    found = demo()
    figure = Figure(figsize=(11.0, 2.6 * (1 + len(found))), layout="constrained")
    axes = figure.subplots(1 + len(found), 1, sharex=True)
    _draw_level(axes[0], found[0])
    for panel, one in zip(axes[1:], found, strict=True):
        _draw_circuit(panel, one)
    axes[-1].set_xlim(0.0, SECONDS)
    axes[-1].set_xlabel("time [s]", fontsize=9)
    return figure
