"""Equalisers at the QAM stage: feed-forward and decision feedback, from zero or from stored coefficients.

Arai et al., section 3.1: only the QAM stage touches the rail, so that equalising its symbols is all CDMA-QAM needs.
    y[k] = sum w[j] x[2 k + j] - sum v[i] s[k - 1 - i]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.numerics.kernel import kernel
from services.track_circuit.qam import levels

FORWARD_TAPS = 16
"""Half symbols."""
LEAD = 5
"""Symbols before the present one that the feed-forward filter sees; its tail sees the rest after."""
FEEDBACK_TAPS = 4
"""Symbols; 0 makes the equaliser feed-forward."""
DECIDED_STEP = 0.05
"""NLMS step of the decision-directed part, at first."""
PHASE_GAIN, FREQUENCY_GAIN = 0.02, 0.0001
"""Second-order carrier loop, per symbol, at first: takes up what the training left of the offset."""
SETTLE = 300.0
"""Symbols after which these gains have halved; the frequency gain falls with their square."""
LEAST = 0.1
"""Share of them that stays."""
PULL = 0.5
"""Weight of the stored coefficients in the training, as so many symbols' worth of their own power."""


@dataclass(frozen=True, slots=True)
class QamTaps:
    """Coefficients of a QAM equaliser."""

    forward: NDArray[np.complex128]
    feedback: NDArray[np.complex128]


@kernel
def _run(
    samples: NDArray[np.complex128],
    forward: NDArray[np.complex128],
    feedback: NDArray[np.complex128],
    past: NDArray[np.complex128],
    grid: NDArray[np.float64],
    loop: NDArray[np.float64],
    found: NDArray[np.complex128],
) -> None:
    """Equalise and decide symbol by symbol; taps follow the decisions by NLMS; `past` holds the newest symbol first.

    `loop`: the carrier's frequency and phase in radians, and how many symbols were decided; taps, `past` and `loop`
    are written, so that the next call goes on.
    """
    spacing = grid[1] - grid[0]
    top = len(grid) - 1
    frequency, phase, before = loop[0], loop[1], loop[2]
    for k in range(len(found)):
        value = 0.0 + 0.0j
        turn = np.cos(phase) - 1j * np.sin(phase)
        power = 1e-12
        for j in range(len(forward)):
            value += forward[j] * samples[2 * k + j] * turn
            power += samples[2 * k + j].real ** 2 + samples[2 * k + j].imag ** 2
        for i in range(len(feedback)):
            value -= feedback[i] * past[i]
            power += past[i].real ** 2 + past[i].imag ** 2
        found[k] = value
        i_level = grid[min(max(int(np.rint((value.real - grid[0]) / spacing)), 0), top)]
        q_level = grid[min(max(int(np.rint((value.imag - grid[0]) / spacing)), 0), top)]
        decided = i_level + 1j * q_level
        share = max(LEAST, 1.0 / (1.0 + (before + k) / SETTLE))
        gain = DECIDED_STEP * share * (decided - value) / power
        wrong = (value * np.conj(decided)).imag / (decided.real**2 + decided.imag**2)
        frequency += FREQUENCY_GAIN * share * share * wrong
        phase += frequency + PHASE_GAIN * share * wrong
        for j in range(len(forward)):
            forward[j] += gain * np.conj(samples[2 * k + j] * turn)
        for i in range(len(feedback)):
            feedback[i] -= gain * np.conj(past[i])
        for i in range(len(past) - 1, 0, -1):
            past[i] = past[i - 1]
        if len(past):
            past[0] = decided
    loop[0], loop[1], loop[2] = frequency, phase, before + len(found)


def _rows(
    samples: NDArray[np.complex128], training: NDArray[np.complex128], feedback: int
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Regressors and targets of the training symbols whose predecessors are known."""
    count = len(training) - feedback
    view = np.lib.stride_tricks.sliding_window_view(samples, FORWARD_TAPS)[::2]
    forward = view[feedback : feedback + count]
    if not feedback:
        return np.asarray(forward, np.complex128), training
    past = np.lib.stride_tricks.sliding_window_view(training[:-1], feedback)[:, ::-1]
    return np.hstack([forward, -past]), training[feedback:]


def train(
    samples: NDArray[np.complex128],
    training: NDArray[np.complex128],
    stored: QamTaps | None = None,
    *,
    feedback: int = FEEDBACK_TAPS,
    noise: float = 0.003,
) -> QamTaps:
    """Coefficients from known symbols by least squares; with stored ones, their departure is what is kept small.

    `samples` begin LEAD symbols before the first training symbol, two per symbol. Stored taps are first given the one
    complex gain that fits the training best. `noise` is the error power expected, by which the pull is weighed.
    """
    rows, target = _rows(samples, training, feedback)
    size = rows.shape[1]
    normal = rows.conj().T @ rows
    if stored is None:
        start = np.zeros(size, np.complex128)
        weight = np.full(size, 1e-3 * float(np.trace(normal).real) / size)
    else:
        forward = rows[:, :FORWARD_TAPS] @ stored.forward
        wanted = target - rows[:, FORWARD_TAPS:] @ stored.feedback
        gain = np.vdot(forward, wanted) / (float(np.sum(np.abs(forward) ** 2)) + 1e-30)
        start = np.concatenate([stored.forward * gain, stored.feedback])
        spread = np.full(size, float(np.mean(np.abs(start[:FORWARD_TAPS]) ** 2)))
        spread[FORWARD_TAPS:] = float(np.mean(np.abs(stored.feedback) ** 2)) if feedback else 1.0
        weight = noise / (0.01 * PULL * spread + 1e-30)
    error = target - rows @ start
    taps = start + np.linalg.solve(normal + np.diag(weight), rows.conj().T @ error)
    return QamTaps(np.ascontiguousarray(taps[:FORWARD_TAPS]), np.ascontiguousarray(taps[FORWARD_TAPS:]))


def carrier_turn(
    samples: NDArray[np.complex128], training: NDArray[np.complex128], taps: QamTaps
) -> tuple[float, float]:
    """Offset of the carrier in radians per symbol, and its phase behind the training: from the training's halves."""
    rows, target = _rows(samples, training, len(taps.feedback))
    output = rows @ np.concatenate([taps.forward, taps.feedback])
    half = len(target) // 2
    early = np.vdot(target[:half], output[:half])
    late = np.vdot(target[half : 2 * half], output[half : 2 * half])
    frequency = float(np.angle(late * np.conj(early))) / half
    return frequency, frequency * len(target) / 2.0


class QamFilter:
    """An equaliser that follows its own decisions, from one stretch of symbols to the next."""

    def __init__(
        self,
        taps: QamTaps,
        order: int,
        past: NDArray[np.complex128] | None = None,
        turn: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Begin with `taps` behind the symbols `past`, the newest first; without them they count as zero.

        `turn` is the carrier's offset in radians per symbol and its phase at the first symbol.
        """
        self.taps = QamTaps(taps.forward.copy(), taps.feedback.copy())
        self._grid = levels(order)
        self._past = np.zeros(len(taps.feedback), np.complex128)
        if past is not None:
            self._past[:] = past[: len(self._past)]
        self._loop = np.array([*turn, 0.0])

    @property
    def turn(self) -> float:
        """The carrier's offset in radians per symbol."""
        return float(self._loop[0])

    def run(self, samples: NDArray[np.complex128], count: int) -> NDArray[np.complex128]:
        """The next `count` symbols before decision; `samples` begin LEAD symbols before the first one."""
        found = np.empty(count, np.complex128)
        forward, feedback = self.taps.forward, self.taps.feedback
        _run(np.ascontiguousarray(samples), forward, feedback, self._past, self._grid, self._loop, found)
        return found

    def advance(self, symbols: float) -> None:
        """Expect the input that much earlier, a small part of a symbol: the window on it was moved later."""
        frequency = np.fft.fftfreq(len(self.taps.forward), 0.5)
        self.taps.forward[:] = np.fft.ifft(np.fft.fft(self.taps.forward) * np.exp(2j * np.pi * frequency * symbols))


def equalise(
    samples: NDArray[np.complex128],
    taps: QamTaps,
    order: int,
    count: int,
    past: NDArray[np.complex128] | None = None,
    turn: tuple[float, float] = (0.0, 0.0),
) -> NDArray[np.complex128]:
    """`count` symbols before decision, in one go; see QamFilter."""
    return QamFilter(taps, order, past, turn).run(samples, count)
