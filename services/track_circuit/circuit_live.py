"""One circuit, live: samples in, messages out. Pure: times come in as arguments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from schemas.track_circuit import (
    CircuitEvent,
    CircuitHealth,
    CircuitOccupancy,
    CodedCarrier,
    EqualiserState,
    SampleBlock,
    StoredCoefficients,
    Telegram,
)
from services.track_circuit.circuit_following import Following, LivePiece
from services.track_circuit.circuit_interference import ToneWatch
from services.track_circuit.circuit_messages import circuit_health, equaliser_state
from services.track_circuit.code_table import CodeTable, table_for
from services.track_circuit.coefficients import WORST_EVM_DB, adapted, coefficients_of, drift, taps_of
from services.track_circuit.demodulator_choice import receiver_used
from services.track_circuit.fsk import WINDOW_S, Coded, band_level_db, decode, strongest
from services.track_circuit.health import HealthTrend
from services.track_circuit.occupancy import Occupancy, Verdict
from services.track_circuit.settings import CircuitSettings
from services.track_circuit.telegram import Frame, TelegramScanner
from services.track_circuit.telegram_acceptance import Acceptance

NS: Final = 1_000_000_000
CONFIRMATION_S: Final = 10.0
"""A person's word is no older than this."""
OLDEST_S: Final = 2.0
"""Samples older than this on arrival say nothing of now."""
STATE_S: Final = 1.0
"""Occupancy and equaliser are told this often when nothing changes."""
HEALTH_S: Final = 10.0
CODE_STEP_S: Final = 0.5
LEVEL_S: Final = 0.25
"""Length of the samples from which a coded carrier's level is taken."""
CODE_WIDTH_HZ: Final = 90.0
CLIPPED_SHARE: Final = 0.01
FIRST_SYMBOLS: Final = 512
"""Symbols received well before a circuit without stored coefficients gets its first ones."""

CircuitMessage = Telegram | CodedCarrier | EqualiserState | CircuitOccupancy | CircuitHealth | CircuitEvent
EventKind = Literal[
    "occupied", "cleared", "telegrams_lost", "telegrams_back", "trend", "interference", "samples", "refused", "trained"
]


@dataclass
class Counters:
    """What happened to the samples."""

    late: int = 0
    repeated: int = 0
    gaps: int = 0
    clipped: int = 0
    wrong_rate: int = 0


class LiveCircuit:
    """A circuit beside the line, or the one under a train (which is occupied by it, and says nothing of that)."""

    def __init__(
        self,
        settings: CircuitSettings,
        table: CodeTable,
        *,
        on_board: bool,
        now_s: float,
        stored: StoredCoefficients | None = None,
    ) -> None:
        """Nothing heard yet; `stored` are the coefficients to begin with."""
        self.settings = settings
        self.stored = self._trained = stored
        self.counters = Counters()
        self.occupancy = Occupancy(settings.occupancy, now_s)
        self.health = HealthTrend()
        self._on_board = on_board
        self._receiver = receiver_used(settings.profile, settings.receiver)
        self._table = table_for(settings.profile, table)
        self._rate_hz: float | None = None
        self._following: Following | None = None
        framing = settings.profile.framing
        self._scanner = None if framing is None else TelegramScanner(framing)
        self._acceptance = None if framing is None else Acceptance(settings.circuit_id, framing.confirmations)
        self._window = np.empty(0)
        self._window_since_s = 0.0
        self._next_sample: int | None = None
        self._latest: LivePiece | None = None
        self._well = 0
        self._told: Verdict | None = None
        self._due = {"state": -1e18, "equaliser": -1e18, "health": -1e18}
        self._complaints: dict[str, str] = {}
        self._bad_samples = False
        self._tones = ToneWatch(settings.profile)
        self._refused = ""

    def take(self, block: SampleBlock, now_ns: int, now_s: float) -> list[CircuitMessage]:
        """What a block brings; one that is late, repeated or of another rate is counted and left out."""
        late_s = (now_ns - block.t_ns) / NS
        if abs(late_s) > OLDEST_S + len(block.samples) / block.sample_rate_hz:
            self.counters.late += 1
            return []
        messages: list[CircuitMessage] = []
        if block.sample_rate_hz != self._rate_hz:
            messages += self._begin(block, now_ns)
        if self._refused:
            return messages
        if self._next_sample is not None and block.first_sample < self._next_sample:
            restarted = block.first_sample + len(block.samples) < self._next_sample - block.sample_rate_hz
            if not restarted:
                self.counters.repeated += 1
                return messages
        samples = np.asarray(block.samples, np.float64)
        messages += self._look(block, samples, now_ns)
        samples = np.nan_to_num(samples, nan=0.0, posinf=0.0, neginf=0.0)
        self._next_sample = block.first_sample + len(samples)
        if self._following is None:
            return messages + self._coded(samples, block, now_ns, now_s)
        for piece in self._following.take(samples, block.first_sample):
            messages += self._piece(piece, block, now_ns, now_s)
        if self._following.silent:
            self.occupancy.level(None, now_s)
        return messages + self._verdict(now_ns, now_s)

    def confirm(self, t_ns: int, now_ns: int, now_s: float) -> list[CircuitMessage]:
        """A person's word that the circuit is clear: its present level is the reference. Old words do not count."""
        level_db = self.occupancy.fresh_level_db(now_s)
        if abs(now_ns - t_ns) > CONFIRMATION_S * NS or level_db is None:
            reason = "without a signal there is no level to go by" if level_db is None else "it is too old"
            return [self._event("refused", f"a confirmation that the circuit is clear: {reason}", now_ns)]
        self.occupancy.confirm_clear(level_db, now_s)
        return []

    def _begin(self, block: SampleBlock, now_ns: int) -> list[CircuitMessage]:
        """The first block, or one of another rate: everything begins anew."""
        if self._rate_hz is not None:
            self.counters.wrong_rate += 1
        self._rate_hz, self._next_sample, self._window = block.sample_rate_hz, None, np.empty(0)
        self._refused, self._following = "", None
        if self.settings.profile.scheme == "fsk":
            return []
        try:
            taps = None if self.stored is None else taps_of(self.stored)
            self._following = Following(block.sample_rate_hz, self.settings.profile, self.settings.receiver, taps)
        except ValueError as error:
            self._refused = str(error)
            return [self._event("refused", self._refused, now_ns)]
        return []

    def _look(self, block: SampleBlock, samples: NDArray[np.float64], now_ns: int) -> list[CircuitMessage]:
        """Gaps and clipping: told once when they begin."""
        gap = self._next_sample is not None and block.first_sample != self._next_sample
        clipped = block.clipped > CLIPPED_SHARE * len(samples)
        self.counters.gaps += gap
        self.counters.clipped += clipped
        if gap:
            self._window = np.empty(0)
        bad, before = gap or clipped, self._bad_samples
        self._bad_samples = bad
        if not bad or before:
            return []
        text = f"{block.clipped} of {len(samples)} samples are clipped" if clipped else "samples are missing"
        return [self._event("samples", text, now_ns)]

    def _event(self, kind: EventKind, text: str, now_ns: int, level_db: float | None = None) -> CircuitEvent:
        return CircuitEvent(t_ns=now_ns, circuit=self.settings.name, kind=kind, text=text, level_db=level_db)

    def _piece(self, piece: LivePiece, block: SampleBlock, now_ns: int, now_s: float) -> list[CircuitMessage]:
        """A burst of symbols: level, telegrams, learning."""
        self._latest = piece
        messages: list[CircuitMessage] = []
        good = False
        for frame in [] if self._scanner is None else self._scanner.take(piece.bit, int(piece.symbol[0])):
            telegram = self._telegram(frame, piece, block)
            self.health.telegram(crc_ok=frame.crc_ok)
            good |= telegram.state == "good"
            messages.append(telegram)
        if good and self.settings.circuit_id is not None:
            self.occupancy.telegram(now_s)
        self.occupancy.level(piece.level_db, now_s)
        clear = self.occupancy.verdict(now_s).state == "clear"
        if clear and piece.level_db is not None:
            self.health.clear_level(piece.level_db, piece.evm_db, now_s)
        if self.settings.learn and piece.evm_db < WORST_EVM_DB and (good if self._on_board else clear):
            messages += self._learn(piece, now_ns)
        symbols_s = len(piece.bit) / self.settings.profile.bit_rate_hz
        tones = self._tones.take(piece.lines_hz, symbols_s, now_s)
        if tones:
            shown = ", ".join(f"{hz:.0f}" for hz in tones)
            messages.append(self._event("interference", f"foreign tones at {shown} Hz", now_ns, piece.level_db))
        return messages

    def _telegram(self, frame: Frame, piece: LivePiece, block: SampleBlock) -> Telegram:
        rate_hz, bit_rate = block.sample_rate_hz, self.settings.profile.bit_rate_hz
        sample = piece.first_sample + (frame.symbol - int(piece.symbol[0])) * rate_hz / bit_rate
        begin_ns = block.t_ns + round((sample - block.first_sample) / rate_hz * NS)
        state = "bad_crc" if self._acceptance is None else self._acceptance.judge(frame, begin_ns / NS)
        return Telegram(
            t_ns=begin_ns,
            circuit=self.settings.name,
            scheme=self.settings.profile.scheme,
            state=state,
            sequence=frame.sequence,
            circuit_id=frame.circuit_id,
            payload=frame.payload,
            crc_ok=frame.crc_ok,
            evm_db=piece.evm_db,
            level_db=-200.0 if piece.level_db is None else piece.level_db,
            receiver=self._receiver,
        )

    def _learn(self, piece: LivePiece, now_ns: int) -> list[CircuitMessage]:
        """Stored taps follow gently; a circuit without them gets its first after enough good symbols."""
        self._well += len(piece.bit)
        if self.stored is not None and self._trained is not None:
            self.health.drifted(drift(piece.taps, self._trained))
            self.stored = adapted(self.stored, self._trained, piece.taps)
            return []
        if self._well < FIRST_SYMBOLS or piece.level_db is None:
            return []
        day = str(np.datetime64(now_ns, "ns").astype("datetime64[D]"))
        self.stored = self._trained = coefficients_of(
            self.settings.profile,
            self.settings.name,
            self._receiver,
            piece.taps,
            trained=day,
            level_db=piece.level_db,
            evm_db=piece.evm_db,
            symbols=self._well,
        )
        return [self._event("trained", f"first coefficients from {self._well} symbols", now_ns, piece.level_db)]

    def _coded(
        self, samples: NDArray[np.float64], block: SampleBlock, now_ns: int, now_s: float
    ) -> list[CircuitMessage]:
        """A coded carrier: level from the newest samples, code from the last two seconds."""
        rate_hz = block.sample_rate_hz
        size = round(WINDOW_S * rate_hz)
        self._window = np.concatenate([self._window, samples])[-size:]
        carriers = [hz for hz in self._table.carriers_hz if hz < 0.47 * rate_hz]
        messages: list[CircuitMessage] = []
        found: Coded | None = None
        if len(self._window) == size and now_s - self._window_since_s >= CODE_STEP_S:
            self._window_since_s = now_s
            found = strongest([decode(self._window, rate_hz, hz, self._table) for hz in carriers])
            good = found.state == "good"
            if good:
                self.occupancy.telegram(now_s)
            self.health.telegram(crc_ok=good)
            messages.append(self._carrier(found, block))
        newest = self._window[-round(LEVEL_S * rate_hz) :]
        level_db = max((band_level_db(newest, rate_hz, hz, CODE_WIDTH_HZ) for hz in carriers), default=None)
        self.occupancy.level(level_db, now_s)
        if level_db is not None and self.occupancy.verdict(now_s).state == "clear":
            self.health.clear_level(level_db, None, now_s)
        return messages + self._verdict(now_ns, now_s)

    def _carrier(self, found: Coded, block: SampleBlock) -> CodedCarrier:
        return CodedCarrier(
            t_ns=block.t_ns,
            circuit=self.settings.name,
            state=found.state,
            carrier_hz=found.carrier_hz,
            code_hz=found.code_hz,
            meaning=self._table.meaning_of(found.code_hz) if found.state == "good" and found.code_hz else "",
            level_db=found.level_db,
            margin_db=found.margin_db,
        )

    def tick(self, now_ns: int, now_s: float) -> list[CircuitMessage]:
        """What time alone brings: time-outs, and the regular state, equaliser and health."""
        messages = self._verdict(now_ns, now_s)
        if self._is_due("equaliser", STATE_S, now_s):
            messages += self._equaliser(now_ns)
        if self._is_due("health", HEALTH_S, now_s):
            messages += self._health(now_ns)
        return messages

    def _is_due(self, what: str, every_s: float, now_s: float) -> bool:
        if now_s - self._due[what] < every_s:
            return False
        self._due[what] = now_s
        return True

    def _verdict(self, now_ns: int, now_s: float) -> list[CircuitMessage]:
        """Occupancy when it changed or is due, with events; nothing on board."""
        if self._on_board:
            return []
        verdict, before = self.occupancy.verdict(now_s), self._told
        changed = before is None or verdict.state != before.state
        lost = before is None or verdict.most_restrictive != before.most_restrictive
        due = self._is_due("state", STATE_S, now_s)
        if not (changed or lost or due):
            return []
        self._told = verdict
        messages: list[CircuitMessage] = [
            CircuitOccupancy(
                t_ns=now_ns,
                circuit=self.settings.name,
                state=verdict.state,
                reason=verdict.reason,
                level_db=verdict.level_db,
                reference_db=verdict.reference_db,
                most_restrictive=verdict.most_restrictive,
                since_ns=now_ns - round((now_s - verdict.since_s) * NS),
            )
        ]
        if before is not None and changed:
            kind: EventKind = "cleared" if verdict.state == "clear" else "occupied"
            messages.append(self._event(kind, verdict.reason, now_ns, verdict.level_db))
        if before is not None and lost:
            kind = "telegrams_lost" if verdict.most_restrictive else "telegrams_back"
            text = "no good telegram in time: most restrictive" if verdict.most_restrictive else "good telegrams again"
            messages.append(self._event(kind, text, now_ns, verdict.level_db))
        return messages

    def _equaliser(self, now_ns: int) -> list[CircuitMessage]:
        if self._latest is None and not self._refused:
            return []
        stored = self.stored is not None
        return [equaliser_state(self.settings, self._latest, now_ns, from_store=stored, refused=self._refused)]

    def _health(self, now_ns: int) -> list[CircuitMessage]:
        version = None if self.stored is None else self.stored.version
        messages: list[CircuitMessage] = [circuit_health(self.settings, self.health, version, now_ns)]
        complaints = self.health.complaints()
        new = [text for kind, text in complaints.items() if kind not in self._complaints]
        self._complaints = complaints
        return messages + [self._event("trend", text, now_ns, self.health.level_db) for text in new]
