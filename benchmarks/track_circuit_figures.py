"""Pictures of docs/track_circuit.md: `python -m benchmarks.track_circuit_figures --out docs/pictures`.

Waveforms as in the second figure of Arai et al., error rates beside their theory, what receivers learn from how many
bits, a received recording, and the demo of the wet ballast in virtual time. The same sources give the same bytes.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.track_circuit import counted
from benchmarks.track_circuit_channel import PROFILE, RATE_HZ, Rail, bound
from benchmarks.track_circuit_convergence import Scene, curves, qam_error_rate, receivers, trained
from benchmarks.track_circuit_weather import draw_weather
from schemas.track_circuit import SampleBlock
from services.simulator.track_circuit_scene import SimulatedCircuit
from services.simulator.track_circuit_settings import BallastPoint, TrackCircuitSettings
from services.track_circuit.channel_estimate import LEAD
from services.track_circuit.circuit_reception import receive_recording
from services.track_circuit.circuit_samples import Recording, Stretch
from services.track_circuit.equaliser import STRIDE, LinearReceiver
from services.track_circuit.least_squares import windows
from services.track_circuit.qam import theoretical_ber
from services.track_circuit.reception_plot import draw_chips, draw_reception, grid_of, save_picture
from services.track_circuit.traction_noise import TractionSettings
from services.track_circuit.waveform import one_tap

COLOURS = ("#1b6ca8", "#3f8f4f", "#8a5aa8", "#c77700", "#c0504d")
"""Warm NLMS, RLS, least squares, NLMS, LMS: in the order of `curves`."""
STYLES = ("-", "-", (0, (2, 4)), "-", "-")
"""RLS and least squares come out the same: the second is drawn so that the first shows."""
THEORY = "#333333"
WAVEFORM_SNR_DB = 20.0
WAVEFORM_BITS = (8, 32, 256)
SHOWN_BITS = 5
LINEAR_DB = tuple(float(x) for x in range(13))
MLSE_DB = {2.0: 1, 4.0: 1, 6.0: 2, 7.0: 4, 8.0: 8}
"""Ratios, and rounds of 12,000 bits at each."""
QUALITIES = (2.0, 4.0, 6.0)
TRAINING_BITS = 256
TRIALS = 2
LOWEST = 1e-6


def waveforms() -> Figure:
    """Sent chips, received ones, and the paper's LMS filter after more and more bits."""
    scene = Scene(4.0, WAVEFORM_SNR_DB)
    burst, _ = scene.burst(max(WAVEFORM_BITS) + SHOWN_BITS, np.random.default_rng(4))
    length = PROFILE.code_length
    # The burst's place in the scene's pattern shows in its pilots; its bits are those of the same place.
    rows = np.lib.stride_tricks.sliding_window_view(scene.pilots, len(burst.pilots))
    place = int(np.flatnonzero((rows == burst.pilots).all(axis=1))[0])
    chips = scene.chips[place * length : (place + len(burst.pilots)) * length]
    shown = slice(max(WAVEFORM_BITS) * length, (max(WAVEFORM_BITS) + SHOWN_BITS) * length)
    drawn = [("received", "received: one complex gain, no filter", one_tap(burst.samples, chips)[shown])]
    for bits in WAVEFORM_BITS:
        part = type(burst)(burst.samples[: 2 * (bits * length + LEAD + 12)], burst.pilots[:bits])
        taps = LinearReceiver(PROFILE, "lms").receive(part).taps
        output = np.asarray(windows(burst.samples, len(chips), len(taps), STRIDE) @ taps, np.complex128)
        drawn.append(("filtered", f"LMS after {bits} bits", output[shown]))
    figure = Figure(figsize=(11.0, 8.0), layout="constrained")
    for k, (short, words, heard) in enumerate(drawn):
        axes = figure.add_subplot(len(drawn), 1, k + 1)
        draw_chips(axes, chips[shown], heard, COLOURS[-1] if k == 0 else COLOURS[0], short)
        error_db = 10.0 * math.log10(float(np.mean(np.abs(heard - chips[shown]) ** 2) / np.mean(chips[shown] ** 2)))
        axes.set_title(f"{words}: mean square error {error_db:.1f} dB", fontsize=9, loc="left")
        axes.set_ylim(-3.2, 3.2)
        grid_of(axes, "chip" if k + 1 == len(drawn) else "", "amplitude")
    return figure


def _rates(
    axes: Axes,
    x_db: Sequence[float],
    rates: Sequence[float],
    color: str,
    words: str,
    style: object = "-",
    dot: str = "",
) -> None:
    shown = np.maximum(rates, 1e-12)
    axes.semilogy(
        x_db, shown, marker=dot or None, linestyle=style, color=color, linewidth=1.2, markersize=4, label=words
    )


def _one_tap_rate(scene: Scene) -> float:
    """Error rate of the best single coefficient, its phase known."""
    rates = []
    for k in range(16):
        taps = np.zeros(16, np.complex128)
        heard = windows(scene.clean, len(scene.chips), 16, STRIDE)[:, k]
        taps[k] = np.vdot(heard, scene.chips) / float(np.sum(np.abs(heard) ** 2))
        rates.append(scene.errors(taps)[0])
    return min(rates)


def _draw_mlse(axes: Axes) -> None:
    for quality, color in zip(QUALITIES, ("#7fb2d9", COLOURS[0], "#0b3c61"), strict=True):
        for k, (snr_db, rounds) in enumerate(MLSE_DB.items()):
            wrong, total = counted(Rail(quality), snr_db, rounds, int(1000 * quality + 10 * snr_db))
            rate, reach = max(wrong, 1) / total, 2.0 / math.sqrt(max(wrong, 1))
            low, high = rate * max(0.05, 1.0 - reach), rate * (1.0 + reach)
            label = f"MLSE, Q = {quality:g} (counted)" if k == 0 else None
            shift = 0.06 * (quality - 4.0)
            axes.plot([snr_db + shift] * 2, [low, high], color=color, linewidth=1.0)
            axes.semilogy([snr_db + shift], [rate], "o", markersize=4, color=color, label=label)


def _draw_linear(axes: Axes) -> None:
    names = list(receivers(Scene(4.0)))
    rates: dict[str, list[float]] = {name: [] for name in names}
    single = []
    for snr_db in LINEAR_DB:
        scene = Scene(4.0, snr_db)
        single.append(_one_tap_rate(scene))
        for name, make in receivers(scene).items():
            rates[name].append(trained(scene, make, TRAINING_BITS, TRIALS)[0])
    _rates(axes, LINEAR_DB, single, "#9a9a9a", "one complex tap, Q = 4", "--")
    for name, color, style in zip(names, COLOURS, STYLES, strict=True):
        _rates(axes, LINEAR_DB, rates[name], color, f"{name}, Q = 4", style)


def _draw_qam(axes: Axes) -> None:
    for order, ratios, color in ((16, (8.0, 10.0, 12.0, 14.0), COLOURS[0]), (64, (12.0, 14.0, 16.0, 18.0), COLOURS[4])):
        fine = np.linspace(ratios[0] - 2.0, ratios[-1] + 1.0, 40)
        _rates(axes, list(fine), [theoretical_ber(order, x) for x in fine], color, f"{order}-QAM, theory", ":")
        for name, feedback, style, dot in (("FFE", 0, "--", "s"), ("DFE", 4, "-", "o")):
            found = []
            for snr_db in ratios:
                rounds = 2 if snr_db < ratios[-1] else 20
                wrong, total = qam_error_rate(order, snr_db, 2.0, rounds, feedback=feedback)
                found.append(max(wrong, 1) / total)
            _rates(axes, ratios, found, color, f"{order}-QAM, {name}, Q = 2", style, dot)


def error_rates() -> Figure:
    """Bit error rate against Eb/N0: CH1 by every receiver, and QAM."""
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    ch1, qam = figure.subplots(1, 2)
    fine = np.linspace(0.0, 12.0, 80)
    _rates(ch1, list(fine), [bound(float(x)) for x in fine], THEORY, "matched-filter bound (theory)")
    _draw_linear(ch1)
    _draw_mlse(ch1)
    _draw_qam(qam)
    for axes, words in (
        (ch1, f"CH1 on a wet circuit, linear receivers after {TRAINING_BITS} bits"),
        (qam, "QAM behind 16 known symbols, dry start, wet circuit"),
    ):
        axes.set_title(words, fontsize=9, loc="left")
        axes.set_ylim(LOWEST, 0.5)
        axes.legend(fontsize=7, loc="lower left", framealpha=0.9)
        grid_of(axes, "energy per bit over noise density [dB]", "bit error rate")
    ch1.set_xlim(0.0, 12.0)
    return figure


def convergence() -> Figure:
    """Error rate and mean square error over the bits that receivers had."""
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    rate, square = figure.subplots(1, 2)
    for one, color, style in zip(curves(20), COLOURS, STYLES, strict=True):
        bits = list(one.error_rates)
        errors_db = 10.0 * np.log10(list(one.square_errors.values()))
        for axes, values in ((rate, list(one.error_rates.values())), (square, errors_db)):
            axes.plot(bits, values, marker="o", linestyle=style, markersize=3, color=color, label=one.receiver)
    rate.set_yscale("log")
    rate.axhline(1.6e-4, color=THEORY, linewidth=0.8, linestyle=(0, (4, 3)), label="1.6e-4")
    rate.axhline(bound(10.0), color=THEORY, linewidth=0.8, linestyle=":", label="matched-filter bound")
    for axes, words, y in (
        (rate, "error rate of frozen coefficients", "bit error rate"),
        (square, "the same coefficients", "mean square error of the symbols [dB]"),
    ):
        axes.set_title(f"{words}, Q = 4, 10 dB", fontsize=9, loc="left")
        axes.set_xscale("log", base=2)
        axes.set_xticks([2, 4, 8, 16, 32, 64, 128, 256], labels=["2", "4", "8", "16", "32", "64", "128", "256"])
        grid_of(axes, "pilot bits", y)
    rate.legend(fontsize=8, loc="upper right")
    return figure


def _recording(settings: TrackCircuitSettings, seconds: float) -> Recording:
    """A simulated circuit as a recording."""
    circuit = SimulatedCircuit(settings)
    blocks: list[SampleBlock] = []
    while circuit.next_s < seconds:
        block = circuit.step(0)
        if block is not None:
            blocks.append(block)
    samples: NDArray[np.float32] = np.concatenate([block.samples for block in blocks])
    stretch = Stretch(begin=0, end=len(samples), first_sample=0, t_ns=0)
    return Recording("simulated circuit, 1 km, dry to wet", RATE_HZ, samples, 1.0, (stretch,))


def reception() -> Figure:
    """What `kirotei track-circuit demodulate --plot` draws, of a circuit that gets wet within 16 s."""
    settings = TrackCircuitSettings(
        noise=TractionSettings(white_rms=0.03),
        ballast=(BallastPoint(t_s=0.0, s_per_km=0.02), BallastPoint(t_s=16.0, s_per_km=0.5)),
    )
    read = _recording(settings, 18.0)
    received = receive_recording(read, settings.profile, circuit="TC1", circuit_id=1)
    return draw_reception(received, read, settings.profile)


PICTURES: dict[str, Callable[[], Figure]] = {
    "waveforms": waveforms,
    "error_rates": error_rates,
    "convergence": convergence,
    "reception": reception,
    "wet_ballast": draw_weather,
}


def main() -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description="Pictures of track-circuit reception.")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--only", choices=sorted(PICTURES), help="one picture alone")
    parser.add_argument("--kind", choices=("svg", "png"), default="svg")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name, draw in PICTURES.items():
        if arguments.only in (None, name):
            path = arguments.out / f"track_circuit_{name}.{arguments.kind}"
            save_picture(path, draw())
            print(f"{path}: {path.stat().st_size / 1000.0:.0f} kB")  # noqa: T201 - the command's output


if __name__ == "__main__":
    main()
