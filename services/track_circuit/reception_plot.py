"""A received recording in pictures: waveform, constellation, level and error over time, telegrams or codes.

The same input gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from services.track_circuit.circuit_reception import Received, Row
from services.track_circuit.circuit_samples import Recording
from services.track_circuit.fsk import WINDOW_S
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Demodulation, StoredTaps
from services.track_circuit.waveform import Waveform, waveform

SENT, HEARD, MENDED, ERROR = "#333333", "#c0504d", "#1b6ca8", "#c77700"
STATES: Final = {
    "good": "#1a7f37",
    "unconfirmed": "#8fbf4d",
    "bad_crc": "#c62828",
    "other_circuit": "#8a5aa8",
    "repeated": "#c77700",
    "old": "#c77700",
    "doubtful": "#c77700",
    "unknown_code": "#8a5aa8",
    "no_signal": "#9a9a9a",
}
DOTS_PER_INCH: Final = 110
MOST_POINTS: Final = 1500
GRID: Final = "#e4e4e4"
SPECTRUM_HZ: Final = 60.0


def grid_of(axes: Axes, x: str, y: str) -> None:
    """Labels and a light grid."""
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(visible=True, color=GRID, linewidth=0.6)


def draw_chips(axes: Axes, sent: NDArray[np.float64], heard: NDArray[np.complex128], color: str, words: str) -> None:
    """Sent chips as steps, received ones as a line with dots on top; the axis counts chips."""
    place = np.arange(len(sent))
    axes.step(place, sent, where="mid", color=SENT, linewidth=1.0, label="sent, CH1 + CH2")
    axes.plot(place, heard.real, ".-", markersize=3, linewidth=0.8, color=color, label=words)
    axes.set_xlim(-0.5, len(sent) - 0.5)
    above_axes(axes)


def above_axes(axes: Axes, columns: int = 2) -> None:
    """The legend at the right above the panel, where it hides nothing."""
    axes.legend(
        fontsize=8,
        loc="lower right",
        bbox_to_anchor=(1.0, 0.98),
        ncols=columns,
        frameon=False,
        borderaxespad=0.0,
        handlelength=1.5,
    )


def _draw_waveform(figure: Figure, cells: Sequence[object], wave: Waveform, code_length: int) -> None:
    above, below = (figure.add_subplot(cell) for cell in cells)  # type: ignore[call-overload]  # cells of the grid
    for axes, chips, color, short, words, error_db in (
        (above, wave.before, HEARD, "received", "before the equaliser", wave.before_db),
        (below, wave.after, MENDED, "equalised", f"behind the equaliser ({wave.equaliser})", wave.after_db),
    ):
        draw_chips(axes, wave.sent, chips, color, short)
        for symbol in range(code_length, len(wave.sent), code_length):
            axes.axvline(symbol - 0.5, color="#bbbbbb", linewidth=0.6, linestyle=(0, (3, 3)))
        axes.set_title(f"{words}: mean square error {error_db:.1f} dB", fontsize=9, loc="left")
        grid_of(axes, "chip", "amplitude")
    above.set_xlabel("")


def _draw_constellation(axes: Axes, pieces: Sequence[Demodulation]) -> None:
    points = np.concatenate([one.constellation for one in pieces])
    shown = points[:: max(1, len(points) // MOST_POINTS)]
    axes.plot(shown.real, shown.imag, ".", markersize=2, color=MENDED, alpha=0.5, rasterized=True)
    axes.set_aspect("equal")
    reach = 1.15 * float(np.percentile(np.abs(shown), 99.5)) if len(shown) else 1.0
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_title("constellation", fontsize=9, loc="left")
    grid_of(axes, "in phase", "quadrature")


def _draw_learning(axes: Axes, pieces: Sequence[Demodulation]) -> None:
    error_db = np.concatenate([one.error_db for one in pieces])
    axes.plot(np.arange(1, len(error_db) + 1), error_db, color=ERROR, linewidth=0.8)
    axes.set_title("error of the training", fontsize=9, loc="left")
    grid_of(axes, "step of the training", "mean square error [dB]")


def _draw_telegrams(axes: Axes, rows: Sequence[Row], lowest: float) -> None:
    for state in dict.fromkeys(row.state for row in rows):
        times = [row.t_s for row in rows if row.state == state]
        color = STATES.get(state, SENT)
        axes.plot(times, [lowest] * len(times), "|", markersize=11, color=color, label=f"{len(times)} {state}")


def _draw_over_time(axes: Axes, received: Received, starts_s: Sequence[float], rate_hz: float) -> None:
    lowest = 0.0
    for k, (piece, start_s) in enumerate(zip(received.pieces, starts_s, strict=True)):
        if not len(piece.bit):
            continue
        times = start_s + piece.sample / rate_hz
        changed = np.flatnonzero(np.diff(piece.evm_db, prepend=np.nan) != 0.0)
        for values, color, words in ((piece.level_db, MENDED, "level"), (piece.evm_db, ERROR, "EVM")):
            label = words if k == 0 else None
            axes.plot(times[changed], values[changed], color=color, linewidth=1.0, drawstyle="steps-post", label=label)
            lowest = min(lowest, float(values.min()))
    _draw_telegrams(axes, received.rows, lowest - 4.0)
    axes.set_title("level, error and telegrams", fontsize=9, loc="left")
    grid_of(axes, "time [s]", "[dB]")
    above_axes(axes, 6)


def _draw_code(figure: Figure, received: Received, read: Recording, profile: Profile) -> None:
    known = [row for row in received.rows if row.carrier_hz and row.code_hz]
    first = next((row for row in known if row.state == "good"), known[0] if known else received.rows[0])
    carrier_hz = first.carrier_hz or profile.carriers_hz[0]
    grid = figure.add_gridspec(2, 1, height_ratios=(1.3, 1.0))
    axes = figure.add_subplot(grid[0])
    rate_hz = read.sample_rate_hz
    samples = read.taken(0, min(len(read.samples), round(WINDOW_S * rate_hz)))
    samples = np.nan_to_num(samples, nan=0.0, posinf=0.0, neginf=0.0)
    window = np.hanning(len(samples))
    spectrum = np.abs(np.fft.rfft((samples - samples.mean()) * window)) * 2.0 / window.sum()
    hz = np.fft.rfftfreq(len(samples), 1.0 / rate_hz)
    near = np.abs(hz - carrier_hz) < SPECTRUM_HZ
    axes.plot(hz[near], 20.0 * np.log10(spectrum[near] + 1e-7), color=MENDED, linewidth=1.0)
    if first.code_hz:
        for k in range(-4, 5):
            axes.axvline(carrier_hz + k * first.code_hz, color=ERROR, linewidth=0.7, linestyle=(0, (3, 3)))
        words = f"carrier {carrier_hz:.2f} Hz, code {first.code_hz:.1f} Hz: lines of the comb dashed"
        axes.set_title(f"first {WINDOW_S:g} s: {words}", fontsize=9, loc="left")
    grid_of(axes, "frequency [Hz]", "[dB of full scale]")
    below = figure.add_subplot(grid[1])
    for state in dict.fromkeys(row.state for row in received.rows):
        rows = [row for row in received.rows if row.state == state]
        times, codes = [row.t_s for row in rows], [row.code_hz or 0.0 for row in rows]
        below.plot(times, codes, "o", markersize=4, color=STATES.get(state, SENT), label=f"{len(rows)} {state}")
    above_axes(below, 6)
    grid_of(below, "time [s]", "code [Hz]")


def draw_reception(received: Received, read: Recording, profile: Profile, stored: StoredTaps | None = None) -> Figure:
    """The picture of a recording. Raises ValueError where nothing was received."""
    coded = profile.scheme == "fsk"
    if not (received.rows if coded else received.symbols):
        msg = f"{read.name}: nothing was received that could be drawn"
        raise ValueError(msg)
    figure = Figure(figsize=(11.0, 5.5 if coded else 9.0), dpi=DOTS_PER_INCH, layout="constrained")
    figure.suptitle(f"{Path(read.name).name}: {profile.scheme}, {read.duration_s:.1f} s", fontsize=10)
    if coded:
        _draw_code(figure, received, read, profile)
        return figure
    heard = [one for one in received.pieces if len(one.bit)]
    wave = _waveform_of(received, read, profile, stored) if profile.scheme == "ss-cdma" else None
    grid = figure.add_gridspec(4, 3, height_ratios=(1.0, 1.0, 1.5, 1.3))
    if wave is not None:
        _draw_waveform(figure, (grid[0, :], grid[1, :]), wave, profile.code_length)
    rows = 2 if wave is not None else slice(0, 3)
    _draw_constellation(figure.add_subplot(grid[rows, 0]), heard)
    if any(len(one.error_db) for one in heard):
        _draw_learning(figure.add_subplot(grid[rows, 1:]), heard)
    starts_s = [stretch.first_sample / read.sample_rate_hz for stretch in read.stretches]
    _draw_over_time(figure.add_subplot(grid[3, :]), received, starts_s, read.sample_rate_hz)
    return figure


def _waveform_of(received: Received, read: Recording, profile: Profile, stored: StoredTaps | None) -> Waveform | None:
    """Chips out of the stretch with the most symbols."""
    number = max(range(len(received.pieces)), key=lambda k: len(received.pieces[k].bit))
    stretch = read.stretches[number]
    samples = np.nan_to_num(read.taken(stretch.begin, stretch.end), nan=0.0, posinf=0.0, neginf=0.0)
    return waveform(samples - samples.mean(), read.sample_rate_hz, profile, received.pieces[number], stored)


def checked_picture(path: Path) -> str:
    """Kind of a picture by its ending. Raises ValueError for another than .png and .svg."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        msg = f"{path}: a plot is .png or .svg"
        raise ValueError(msg)
    return kind


def _settle(figure: Figure) -> None:
    """Lay out once and round: the layout's solver differs in the last digit from time to time, and names follow."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        x, y, width, height = (round(float(one), 5) for one in axes.get_position(original=True).bounds)
        axes.set_position((x, y, width, height))


def save_picture(path: Path, figure: Figure) -> None:
    """Write a figure whole or not at all. Raises ValueError, OSError."""
    kind = checked_picture(path)
    part = path.with_name(f".{path.name}.part")
    with mpl.rc_context({"svg.hashsalt": "kirotei", "svg.fonttype": "none", "font.family": "DejaVu Sans"}):
        FigureCanvasAgg(figure)
        _settle(figure)
        try:
            figure.savefig(part, format=kind, metadata={"Date": None} if kind == "svg" else {"Software": None})
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
