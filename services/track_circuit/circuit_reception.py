"""What a recording says: telegrams, bits, coded carriers, one row each, whatever the scheme."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.circuit_samples import CLIPPED_SHARE, FULL_SCALE, Recording, Stretch
from services.track_circuit.code_table import CodeTable, table_for
from services.track_circuit.demodulator_choice import demodulator_for
from services.track_circuit.fsk import SHORTEST_S, WINDOW_S, Coded, decode, strongest
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Demodulation, StoredTaps
from services.track_circuit.receiver_demodulation import joined
from services.track_circuit.telegram import Frame, TelegramScanner
from services.track_circuit.telegram_acceptance import Acceptance

FSK_STEP_S = 1.0
PIECE_S = 30.0
"""Samples are read in pieces of this length: memory stays bounded."""


@dataclass(frozen=True, slots=True)
class Row:
    """A line of telegrams.csv."""

    t_s: float
    circuit: str
    sequence: int | None
    payload: bytes
    crc_ok: bool
    evm_db: float | None
    level_db: float
    state: str
    carrier_hz: float | None = None
    code_hz: float | None = None
    margin_db: float | None = None
    meaning: str = ""


@dataclass
class Received:
    """Everything out of a recording."""

    rows: list[Row] = field(default_factory=list)
    symbol: list[NDArray[np.int64]] = field(default_factory=list)
    bit: list[NDArray[np.int8]] = field(default_factory=list)
    soft: list[NDArray[np.float64]] = field(default_factory=list)
    pieces: list[Demodulation] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def symbols(self) -> int:
        """Bits received."""
        return sum(len(one) for one in self.bit)

    @property
    def refused(self) -> str:
        """Why nothing was received, if nothing was."""
        return next((one.refused for one in self.pieces if one.refused), "") if not self.symbols else ""


def code_payload(carrier_hz: float, code_hz: float) -> bytes:
    """Carrier and code in tenths of a hertz, two bytes each, highest first.

    >>> code_payload(1701.4, 16.9).hex()
    '427600a9'
    """
    return round(10.0 * carrier_hz).to_bytes(2, "big") + round(10.0 * code_hz).to_bytes(2, "big")


def _sample_warnings(samples: NDArray[np.float64], at_s: float) -> list[str]:
    """What is wrong with the samples themselves."""
    if not np.isfinite(samples).all():
        return [f"{at_s:.1f} s: samples that are no numbers; taken as silence"]
    found = []
    clipped = int(np.count_nonzero(np.abs(samples) >= FULL_SCALE))
    if clipped > CLIPPED_SHARE * len(samples):
        found.append(f"{at_s:.1f} s: {clipped} of {len(samples)} samples are clipped")
    mean, spread = float(samples.mean()), float(samples.std())
    if abs(mean) > max(0.1, 3.0 * spread):
        found.append(f"{at_s:.1f} s: a constant of {mean:.3f} stands on the samples; taken off")
    if spread == 0.0:
        found.append(f"{at_s:.1f} s: nothing but silence")
    return found


class SpreadSpectrum:
    """Symbols of the pieces, numbered through, and the telegrams in them."""

    def __init__(self, profile: Profile, circuit: str, circuit_id: int | None, received: Received) -> None:
        """Nothing heard yet."""
        self._profile, self._circuit, self._received = profile, circuit, received
        framing = profile.framing
        self._scanner = None if framing is None else TelegramScanner(framing)
        self._acceptance = None if framing is None else Acceptance(circuit_id, framing.confirmations)
        self._last: tuple[int, float] | None = None

    def take(self, found: Demodulation, first_sample: int, sample_rate_hz: float) -> None:
        """Symbols of one piece that begins at `first_sample`."""
        self._received.pieces.append(found)
        if not len(found.bit):
            return
        times_s = (found.sample + first_sample) / sample_rate_hz
        symbol = found.symbol + self._periods(int(found.symbol[0]), float(times_s[0]))
        self._last = int(symbol[-1]), float(times_s[-1])
        self._received.symbol.append(symbol)
        self._received.bit.append(found.bit)
        self._received.soft.append(found.soft)
        if self._scanner is None:
            return
        breaks = np.flatnonzero(np.diff(symbol) != 1) + 1
        for part in np.split(np.arange(len(symbol)), breaks):
            for frame in self._scanner.take(found.bit[part], int(symbol[part[0]])):
                self._row(frame, symbol, times_s, found)
        for frame in self._scanner.finish():
            self._row(frame, symbol, times_s, found)

    def _periods(self, symbol: int, t_s: float) -> int:
        """Whole periods of the pilot, or blocks, that passed since the last piece: numbers go on over gaps."""
        if self._last is None:
            return 0
        period = self._profile.bits_per_block if self._profile.scheme == "cdma-qam" else len(self._profile.pilots())
        expected = self._last[0] + (t_s - self._last[1]) * self._profile.bit_rate_hz
        periods = max(0, round((expected - symbol) / period))
        return period * (periods if symbol + period * periods > self._last[0] else periods + 1)

    def _row(self, frame: Frame, symbol: NDArray[np.int64], times_s: NDArray[np.float64], found: Demodulation) -> None:
        at = int(np.clip(np.searchsorted(symbol, frame.symbol), 0, len(symbol) - 1))
        begin_s = float(times_s[at]) + (frame.symbol - int(symbol[at])) / self._profile.bit_rate_hz
        state = "bad_crc" if self._acceptance is None else self._acceptance.judge(frame, begin_s)
        part = slice(at, at + frame.symbols)
        self._received.rows.append(
            Row(
                t_s=begin_s,
                circuit=self._circuit,
                sequence=frame.sequence,
                payload=frame.payload,
                crc_ok=frame.crc_ok,
                evm_db=float(np.mean(found.evm_db[part])),
                level_db=float(np.mean(found.level_db[part])),
                state=state,
            )
        )


def receive_recording(
    recording: Recording,
    profile: Profile,
    *,
    circuit: str,
    circuit_id: int | None = None,
    receiver: str = "mlse",
    stored: StoredTaps | None = None,
    table: CodeTable | None = None,
    progress: Callable[[float], None] | None = None,
) -> Received:
    """Everything in a recording. Raises ReceiverRefusedError and ValueError where nothing can be received at all."""
    received = Received(warnings=list(recording.warnings))
    spread = SpreadSpectrum(profile, circuit, circuit_id, received)
    codes = table_for(profile, table or CodeTable())
    rate_hz = recording.sample_rate_hz
    for stretch in recording.stretches:
        pieces = _pieces(recording, stretch, received, progress)
        match profile.scheme:
            case "fsk":
                for begin, samples in pieces:
                    begin_s = (stretch.first_sample + begin - stretch.begin) / rate_hz
                    received.rows += list(_coded(samples, rate_hz, codes, circuit, begin_s))
            case "ss-cdma" | "cdma-qam":
                following = demodulator_for(rate_hz, profile, receiver, stored)
                parts = [*(following.take(samples) for _, samples in pieces), following.finish()]
                heard = [part for part in parts if len(part.bit)]
                spread.take(joined(heard) if heard else parts[-1], stretch.first_sample, rate_hz)
            case _:
                assert_never(profile.scheme)
    if len(recording.stretches) > 1:
        received.warnings.append(f"{len(recording.stretches) - 1} gaps in the samples")
    return received


def _pieces(
    recording: Recording, stretch: Stretch, received: Received, progress: Callable[[float], None] | None
) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Samples of a stretch, piece by piece, without a constant and without what is no number."""
    size = round(PIECE_S * recording.sample_rate_hz)
    for begin in range(stretch.begin, stretch.end, size):
        samples = recording.taken(begin, min(begin + size, stretch.end))
        at_s = (stretch.first_sample + begin - stretch.begin) / recording.sample_rate_hz
        received.warnings += _sample_warnings(samples, at_s)
        clean = np.nan_to_num(samples, nan=0.0, posinf=0.0, neginf=0.0)
        yield begin, clean - clean.mean()
        if progress is not None:
            progress(min(begin + size, stretch.end) / len(recording.samples))


def _coded(
    samples: NDArray[np.float64], rate_hz: float, table: CodeTable, circuit: str, begin_s: float
) -> Iterator[Row]:
    """One row per window; a window and a half at the end is one window from the end."""
    size = min(round(WINDOW_S * rate_hz), len(samples))
    if size < SHORTEST_S * rate_hz:
        return
    for begin in range(0, len(samples) - size + 1, round(FSK_STEP_S * rate_hz)):
        window = samples[begin : begin + size]
        found = strongest([decode(window, rate_hz, hz, table) for hz in table.carriers_hz if hz < 0.47 * rate_hz])
        yield row_of(found, begin_s + begin / rate_hz, circuit, table)


def row_of(found: Coded, t_s: float, circuit: str, table: CodeTable) -> Row:
    """A coded carrier as a line of telegrams.csv."""
    known = found.carrier_hz is not None and found.code_hz is not None
    return Row(
        t_s=t_s,
        circuit=circuit,
        sequence=None,
        payload=code_payload(found.carrier_hz, found.code_hz) if found.carrier_hz and found.code_hz else b"",
        crc_ok=found.state == "good",
        evm_db=None,
        level_db=found.level_db,
        state=found.state,
        carrier_hz=found.carrier_hz,
        code_hz=found.code_hz,
        margin_db=found.margin_db,
        meaning=table.meaning_of(found.code_hz) if known and found.state == "good" and found.code_hz else "",
    )
