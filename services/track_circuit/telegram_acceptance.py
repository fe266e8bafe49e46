"""Which telegrams may be acted upon: right circuit, new, in sequence, and confirmed by the one before."""

from __future__ import annotations

from typing import Final, Literal

from services.track_circuit.telegram import LARGEST_FIELD, Frame

State = Literal["good", "bad_crc", "other_circuit", "repeated", "old", "unconfirmed"]
FORGET_S: Final = 30.0
"""Silence after which a transmitter may have begun a new sequence."""
HALF: Final = (LARGEST_FIELD + 1) // 2


class Acceptance:
    """Judges the telegrams of one circuit in the order of their arrival.

    `good` needs `confirmations` telegrams in a row with good checks, the circuit's id, rising sequence numbers and the
    same payload. A replayed telegram has a number that was heard before and is `repeated` or `old`.
    """

    def __init__(self, circuit_id: int | None, confirmations: int) -> None:
        """For the circuit's own id; None takes any id, for a look at unknown recordings."""
        self._circuit_id = circuit_id
        self._confirmations = confirmations
        self._last: Frame | None = None
        self._heard_s = 0.0
        self._in_row = 0

    def judge(self, frame: Frame, t_s: float) -> State:
        """The state of a telegram whose preamble began at `t_s`."""
        if not frame.crc_ok or frame.sequence is None or self._circuit_id not in (None, frame.circuit_id):
            self._in_row = 0
            return "other_circuit" if frame.crc_ok else "bad_crc"
        last = self._last
        if last is None or last.sequence is None or t_s - self._heard_s > FORGET_S:
            return self._begin(frame, t_s)
        ahead = (frame.sequence - last.sequence) % (LARGEST_FIELD + 1)
        if ahead == 0 or ahead >= HALF:
            return "repeated" if ahead == 0 else "old"
        if ahead == 1 and frame.payload == last.payload and frame.circuit_id == last.circuit_id and self._in_row:
            self._last, self._heard_s = frame, t_s
            self._in_row += 1
            return "good" if self._in_row >= self._confirmations else "unconfirmed"
        return self._begin(frame, t_s)

    def _begin(self, frame: Frame, t_s: float) -> State:
        self._last, self._heard_s, self._in_row = frame, t_s, 1
        return "good" if self._confirmations == 1 else "unconfirmed"
