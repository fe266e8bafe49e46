"""What a simulated circuit's sender puts on the rail, sample by sample, for ever."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.simulator.track_circuit_settings import TrackCircuitSettings
from services.track_circuit.fsk import keyed
from services.track_circuit.modulate import PULSE_SPAN_CHIPS, chips, shaped
from services.track_circuit.profile import Framing
from services.track_circuit.telegram import telegram_bits


class Sender:
    """Telegrams with rising sequence numbers, or a code on its carrier, on the sender's own clock."""

    def __init__(self, settings: TrackCircuitSettings, circuit_id: int) -> None:
        """Begin at sample 0 with sequence 0."""
        fast = 1.0 + settings.clock_ppm * 1e-6
        self._settings = settings
        self._profile = msgspec.structs.replace(
            settings.profile,
            carrier_hz=(settings.profile.carrier_hz + settings.carrier_offset_hz) * fast,
            chip_rate_hz=settings.profile.chip_rate_hz * fast,
            # Written out once: drawing them anew for every block would cost more than all the rest.
            pilot_bits="".join("0" if pilot > 0.0 else "1" for pilot in settings.profile.pilots()),
        )
        self._circuit_id = circuit_id
        self._framing = settings.profile.framing or Framing()
        self._payload = bytes.fromhex(settings.payload_hex)
        self._symbols = len(telegram_bits(circuit_id, 0, self._payload, self._framing))
        self.replay_from: int | None = None
        """A sequence number from which old telegrams are sent again."""

    def _bits(self, first: int, count: int) -> NDArray[np.int8]:
        """Bits by their number since the start."""
        numbers = range(first // self._symbols, (first + count - 1) // self._symbols + 1)
        sequences = [number if self.replay_from is None else self.replay_from for number in numbers]
        telegrams = [
            telegram_bits(self._circuit_id, sequence % 0x10000, self._payload, self._framing) for sequence in sequences
        ]
        begin = first - numbers[0] * self._symbols
        return np.concatenate(telegrams)[begin : begin + count]

    def samples(self, first_sample: int, count: int) -> NDArray[np.float64]:
        """The signal at samples `first_sample` …, amplitude 1 per channel."""
        rate_hz, profile = self._settings.sample_rate_hz, self._profile
        if profile.scheme == "fsk":
            carrier_hz = profile.carriers_hz[0] + self._settings.carrier_offset_hz
            start_s = first_sample / rate_hz
            return keyed(carrier_hz, self._settings.code_hz, profile.shift_hz, rate_hz, count, start_s)
        length = profile.code_length
        chip = first_sample * profile.chip_rate_hz / rate_hz
        first = max(0, int(chip - PULSE_SPAN_CHIPS - 2) // length)
        needed = int((chip - first * length) + count * profile.chip_rate_hz / rate_hz + PULSE_SPAN_CHIPS + 2)
        symbols = needed // length + 1
        values = chips(self._bits(first, symbols), profile, first)
        baseband = shaped(values, profile, rate_hz, first * length - chip)[:count]
        turns = ((first_sample + np.arange(count)) * (profile.carrier_hz / rate_hz)) % 1.0
        return np.asarray((baseband * np.exp(2j * np.pi * turns)).real, np.float64)
