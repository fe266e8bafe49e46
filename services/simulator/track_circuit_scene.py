"""A simulated track circuit: sender, rail in its weather, trains, noise; what the receiver's converter gives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from schemas.track_circuit import SampleBlock
from services.simulator.track_circuit_sender import Sender
from services.simulator.track_circuit_settings import Occupation, TrackCircuitSettings
from services.track_circuit.channel import FirFilter, rail_fir
from services.track_circuit.traction_noise import TractionNoise

NS = 1_000_000_000
WEATHER_S = 1.0
"""The rail's filter is renewed so often, and whenever a train or a fault comes or goes."""


@dataclass(frozen=True, slots=True)
class Truth:
    """How things really are in a block."""

    occupied: bool
    broken: bool
    ballast_s_per_km: float


def _share(train: Occupation, t_s: float) -> float:
    """How far a train is through the circuit."""
    return (t_s - train.enter_s) / max(train.leave_s - train.enter_s, 1e-9)


class SimulatedCircuit:
    """Blocks of samples, one after the other."""

    def __init__(self, settings: TrackCircuitSettings) -> None:
        """Begin at sample 0."""
        self.settings = settings
        self._sender = Sender(settings, settings.circuit_id)
        self._neighbour = Sender(settings, (settings.circuit_id + 1) % 0x10000)
        self._noise = TractionNoise(settings.noise, settings.sample_rate_hz, np.random.default_rng(settings.seed))
        self._count = round(settings.block_s * settings.sample_rate_hz)
        self._next = 0
        self._state: tuple[object, ...] = ()
        self._filter = FirFilter(self._response(0.0))

    @property
    def next_s(self) -> float:
        """Time of the next block since the start."""
        return self._next / self.settings.sample_rate_hz

    @property
    def unchanged_until_s(self) -> float:
        """When the first train, fault or change of the weather comes; infinite where none does."""
        points = self.settings.ballast
        changes = [one.enter_s for one in self.settings.trains] + [one.begin_s for one in self.settings.outages]
        changes += [a.t_s for a, b in pairwise(points) if a.s_per_km != b.s_per_km][:1]
        return min(changes, default=math.inf)

    def ballast_s_per_km(self, t_s: float) -> float:
        """Leakage at a time."""
        points = self.settings.ballast
        return float(np.exp(np.interp(t_s, [p.t_s for p in points], [np.log(p.s_per_km) for p in points])))

    def _trains(self, t_s: float) -> list[Occupation]:
        """Trains in the circuit, the one furthest from the sending end first."""
        inside = [one for one in self.settings.trains if one.enter_s <= t_s < one.leave_s]
        return sorted(inside, key=lambda one: _share(one, t_s), reverse=True)

    def _on(self, kind: str, t_s: float) -> bool:
        return any(one.kind == kind and one.begin_s <= t_s < one.end_s for one in self.settings.outages)

    def _response(self, t_s: float) -> NDArray[np.float64]:
        settings, trains = self.settings, self._trains(t_s)
        state: dict[str, float] = {}
        if self._on("broken_rail", t_s):
            state["broken_km"] = 0.5 * settings.length_km
        elif trains:
            state |= {"shunt_ohm": trains[0].shunt_ohm, "shunt_km": _share(trains[0], t_s) * settings.length_km}
            for second in trains[1:2]:  # a third between or behind them would hardly be heard
                state |= {"second_ohm": second.shunt_ohm, "second_km": _share(second, t_s) * settings.length_km}
        ballast = self.ballast_s_per_km(t_s)
        taps = rail_fir(settings.rail, settings.length_km, ballast, settings.sample_rate_hz, state=state)
        return settings.sending * taps

    def truth(self, t_s: float) -> Truth:
        """How things really are at a time."""
        return Truth(bool(self._trains(t_s)), self._on("broken_rail", t_s), self.ballast_s_per_km(t_s))

    def step(self, start_ns: int) -> SampleBlock | None:
        """The next block, of a converter that began at `start_ns`; None while samples are lost."""
        settings, t_s = self.settings, self.next_s
        begin, self._next = self._next, self._next + self._count
        replaying = self._on("replay", t_s)
        if replaying != (self._sender.replay_from is not None):
            self._sender.replay_from = 0 if replaying else None
        sent = self._sender.samples(begin, self._count) * (not self._on("no_transmitter", t_s))
        state = (int(t_s / WEATHER_S), tuple(self._trains(t_s)), self._on("broken_rail", t_s))
        received = self._filter.pass_on(sent, self._response(t_s) if state != self._state else None)
        self._state = state
        received += self._noise.block(begin, self._count)
        if settings.neighbour > 0.0:
            # Half a telegram behind ours, so that its chips do not fall on ours.
            received += settings.neighbour * self._neighbour.samples(begin + self._count // 2 + 3, self._count)
        if self._on("lost_samples", t_s):
            return None
        clipped = np.clip(received, -1.0, 32767.0 / 32768.0)
        return SampleBlock(
            t_ns=start_ns + round(begin / settings.sample_rate_hz * NS),
            first_sample=begin,
            sample_rate_hz=settings.sample_rate_hz,
            samples=(np.rint(clipped * 32768.0) / 32768.0).astype(np.float32),
            clipped=int(np.count_nonzero(np.abs(received) >= 1.0)),
        )
