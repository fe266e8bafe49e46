"""How much of a core a live track circuit takes: samples of the simulated rail through the service's own code."""

from __future__ import annotations

import time

from services.simulator.track_circuit_scene import SimulatedCircuit
from services.simulator.track_circuit_settings import TrackCircuitSettings
from services.track_circuit.circuit_live import LiveCircuit
from services.track_circuit.code_table import CodeTable
from services.track_circuit.settings import CircuitSettings
from services.track_circuit.traction_noise import InverterLine, TractionSettings

START_NS = 1_795_305_600_000_000_000
SECONDS = 20.0
CONFIRMED_S = 1.5
CASES = {
    "telegrams": TrackCircuitSettings(),
    "comb and impulses": TrackCircuitSettings(
        noise=TractionSettings(white_rms=5e-3, comb_amplitude=0.02, impulses_per_s=5.0, impulse_amplitude=0.5)
    ),
    "inverter line": TrackCircuitSettings(
        noise=TractionSettings(white_rms=1e-3, lines=(InverterLine(hz=12_333.0, amplitude=0.2),))
    ),
}


def times_real(settings: TrackCircuitSettings, rounds: int) -> float:
    """Seconds of samples over seconds of this thread's processor time: the best of some rounds."""
    scene = SimulatedCircuit(settings)
    blocks = []
    while scene.next_s < SECONDS:
        block = scene.step(START_NS)
        if block is not None:
            blocks.append((block, scene.next_s))

    def run() -> float:
        live = LiveCircuit(CircuitSettings(name="TC1", circuit_id=1), CodeTable(), on_board=False, now_s=0.0)
        confirmed = False
        started = time.thread_time()
        for block, now_s in blocks:
            now_ns = START_NS + round(now_s * 1e9)
            live.take(block, now_ns, now_s)
            if not confirmed and now_s > CONFIRMED_S:
                confirmed = True
                live.confirm(now_ns, now_ns, now_s)
            live.tick(now_ns, now_s)
        return time.thread_time() - started

    run()
    return SECONDS / min(run() for _ in range(rounds))
