"""All circuits of a place: which one a block belongs to, and which coefficients each begins with."""

from __future__ import annotations

import msgspec

from schemas.position import TrainPosition
from schemas.track_circuit import CoefficientStore, SampleBlock, StoredCoefficients
from services.track_circuit.circuit_choice import circuit_at
from services.track_circuit.circuit_live import CircuitMessage, LiveCircuit
from services.track_circuit.coefficients import choose, distance_bin, with_set
from services.track_circuit.demodulator_choice import receiver_used
from services.track_circuit.settings import CircuitSettings, Config


class CircuitSet:
    """Beside the line every circuit has samples of its own; on board the coils hear whichever the train is in."""

    def __init__(self, config: Config, store: CoefficientStore, *, on_board: bool, now_s: float) -> None:
        """Begin every circuit with what is stored for it."""
        self.config, self.store = config, store
        self._on_board = on_board
        self.notes: dict[str, str] = {}
        """Why a circuit begins without stored coefficients."""
        self._here: tuple[str, float] | None = None
        self._bin: tuple[float, float] | None = None
        self.circuits: dict[str, LiveCircuit] = {}
        self.unknown = 0
        for settings in () if on_board else config.circuits:
            self.circuits[settings.name] = self._made(settings, now_s)
        self._aerial: LiveCircuit | None = None

    def _made(self, settings: CircuitSettings, now_s: float, distance_m: float | None = None) -> LiveCircuit:
        stored: StoredCoefficients | None = None
        if settings.profile.scheme != "fsk":
            receiver = receiver_used(settings.profile, settings.receiver)
            choice = choose(self.store, settings.name, settings.profile, receiver, distance_m)
            stored = choice.chosen
            self.notes[settings.name] = choice.reason
        return LiveCircuit(settings, self.config.code_table, on_board=self._on_board, now_s=now_s, stored=stored)

    def live(self, name: str, now_s: float) -> LiveCircuit | None:
        """The circuit whose samples come under a name; None for strangers, which are counted."""
        if self._on_board:
            if name != self.config.aerial or not self.config.circuits:
                self.unknown += 1
                return None
            if self._aerial is None:
                self._aerial = self._made(self.config.circuits[0], now_s)
            return self._aerial
        circuit = self.circuits.get(name)
        self.unknown += circuit is None
        return circuit

    def take(self, name: str, block: SampleBlock, now_ns: int, now_s: float) -> list[CircuitMessage]:
        """What a block brings."""
        circuit = self.live(name, now_s)
        return [] if circuit is None else circuit.take(block, now_ns, now_s)

    def moved(self, position: TrainPosition, now_s: float) -> None:
        """On board: another circuit, or another stretch, begins with the coefficients stored for it."""
        here = circuit_at(self.config.circuits, position)
        if here is None or not self._on_board:
            return
        stretch = distance_bin(here[1])
        if self._here is not None and self._here[0] == here[0] and self._bin == stretch:
            return
        same = self._here is not None and self._here[0] == here[0]
        self._keep()
        settings = next(one for one in self.config.circuits if one.name == here[0])
        made = self._made(settings, now_s, here[1])
        # Within a circuit what is followed goes on, unless there are better coefficients for the new stretch.
        if not same or self._aerial is None or made.stored is not None:
            self._aerial = made
        self._here, self._bin = here, stretch

    def _keep(self) -> None:
        """What was learned under the train goes to its stretch."""
        if self._aerial is not None and self._aerial.stored is not None and self._bin is not None:
            stored = msgspec.structs.replace(self._aerial.stored, distance_bin_m=self._bin)
            self.store, _ = with_set(self.store, stored, trained=False)

    def everyone(self) -> list[LiveCircuit]:
        """All circuits that are being received."""
        return [*self.circuits.values(), *([] if self._aerial is None else [self._aerial])]

    def learned(self) -> CoefficientStore:
        """The store with what was learned since the start."""
        self._keep()
        for circuit in self.circuits.values():
            if circuit.stored is not None and circuit.stored not in self.store.sets:
                self.store, kept = with_set(self.store, circuit.stored, trained=False)
                circuit.stored = kept
        return self.store
