"""One live circuit and everything that goes wrong with its samples: told, counted, and never read as clear."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from schemas.track_circuit import CircuitEvent, CircuitOccupancy, EqualiserState, SampleBlock, Telegram
from services.simulator.track_circuit_scene import SimulatedCircuit
from services.simulator.track_circuit_settings import Occupation, Outage, TrackCircuitSettings
from services.track_circuit.cdma_qam import modulate_cdma_qam
from services.track_circuit.circuit_live import CircuitMessage, LiveCircuit
from services.track_circuit.code_table import CodeTable
from services.track_circuit.coefficients import coefficients_of
from services.track_circuit.profile import Framing, Profile
from services.track_circuit.settings import CircuitSettings
from services.track_circuit.telegram import telegram_bits
from services.track_circuit.traction_noise import InverterLine, TractionSettings

START_NS = 1_795_305_600_000_000_000
OURS = CircuitSettings(name="TC1", circuit_id=1)
Change = Callable[[SampleBlock], SampleBlock | None]


class Heard:
    """A circuit and what it said."""

    def __init__(self, live: LiveCircuit) -> None:
        self.live = live
        self.messages: list[CircuitMessage] = []

    def events(self, kind: str) -> list[str]:
        return [one.text for one in self.messages if isinstance(one, CircuitEvent) and one.kind == kind]

    def telegrams(self) -> dict[str, int]:
        states = [one.state for one in self.messages if isinstance(one, Telegram)]
        return {state: states.count(state) for state in sorted(set(states))}

    def clear_from(self) -> list[float]:
        """Seconds at which it was said to be clear."""
        told = [one for one in self.messages if isinstance(one, CircuitOccupancy) and one.state == "clear"]
        return [(one.t_ns - START_NS) / 1e9 for one in told]


def run(
    settings: TrackCircuitSettings,
    seconds: float,
    *,
    change: Change | None = None,
    live: LiveCircuit | None = None,
    confirm_s: float = 1.5,
) -> Heard:
    """A live circuit over a simulated one; `change` may alter blocks or leave them out."""
    heard = Heard(live or LiveCircuit(OURS, CodeTable(), on_board=False, now_s=0.0))
    scene, confirmed = SimulatedCircuit(settings), False
    while scene.next_s < seconds:
        block = scene.step(START_NS)
        now_s = scene.next_s
        now_ns = START_NS + round(now_s * 1e9)
        if block is not None and change is not None:
            block = change(block)
        if block is not None:
            heard.messages += heard.live.take(block, now_ns, now_s)
        if not confirmed and now_s >= confirm_s:
            confirmed = True
            heard.messages += heard.live.confirm(now_ns, now_ns, now_s)
        heard.messages += heard.live.tick(now_ns, now_s)
    return heard


def outage(kind: str, begin_s: float, end_s: float) -> TrackCircuitSettings:
    fault = msgspec.convert({"kind": kind, "begin_s": begin_s, "end_s": end_s}, Outage)
    return TrackCircuitSettings(outages=(fault,))


def test_lost_samples_are_told_occupied_and_recovered_from() -> None:
    heard = run(outage("lost_samples", 5.0, 6.5), 11.0)
    assert heard.events("samples") == ["samples are missing"]
    assert heard.live.counters.gaps == 1
    clear = heard.clear_from()
    assert any(3.5 < t_s < 5.9 for t_s in clear)
    assert not any(6.2 < t_s < 7.5 for t_s in clear)
    assert max(clear) > 10.0


def test_a_broken_rail_and_a_silent_sender_are_occupied() -> None:
    for kind in ("broken_rail", "no_transmitter"):
        clear = run(outage(kind, 5.0, 20.0), 8.0).clear_from()
        assert clear, kind
        assert max(clear) < 6.4, kind


def test_two_trains_one_behind_the_other_keep_the_circuit_occupied() -> None:
    trains = (Occupation(enter_s=5.0, leave_s=7.5), Occupation(enter_s=7.0, leave_s=9.0))
    clear = run(TrackCircuitSettings(trains=trains), 13.5).clear_from()
    assert any(t_s < 5.0 for t_s in clear)
    # The drop takes under a second; the pick-up at least 2.5 s from when the second train has left.
    assert not any(5.9 < t_s < 11.5 for t_s in clear)
    assert max(clear) > 12.5


def test_two_trains_are_occupied_until_the_second_has_left() -> None:
    trains = (Occupation(enter_s=6.0, leave_s=9.0), Occupation(enter_s=7.5, leave_s=11.0))
    heard = run(TrackCircuitSettings(trains=trains), 15.5)
    clear = heard.clear_from()
    assert any(4.0 < t_s < 6.5 for t_s in clear)
    assert not any(7.0 < t_s < 13.0 for t_s in clear)
    assert max(clear) > 15.0
    assert len(heard.events("occupied")) == 1


def test_replayed_telegrams_are_repeated_or_old_and_do_not_keep_the_aspect() -> None:
    heard = run(outage("replay", 5.0, 20.0), 10.0)
    states = heard.telegrams()
    assert states["old"] + states.get("repeated", 0) > 8
    # The last good telegram is at 5 s; three seconds later the most restrictive aspect holds, and occupied.
    assert max(heard.clear_from()) < 8.6
    assert heard.events("telegrams_lost")


def test_a_louder_neighbour_never_clears_our_circuit() -> None:
    heard = run(TrackCircuitSettings(neighbour=0.6, sending=3.0), 6.0)
    assert heard.clear_from() == []
    assert heard.telegrams().get("good", 0) == 0
    assert heard.telegrams()["other_circuit"] > 3


def test_clipping_is_told_once() -> None:
    heard = run(TrackCircuitSettings(sending=300.0), 3.0)
    told = heard.events("samples")
    assert len(told) == 1
    assert "clipped" in told[0]
    assert heard.live.counters.clipped > 10


def test_a_constant_on_the_samples_does_no_harm() -> None:
    def shifted(block: SampleBlock) -> SampleBlock:
        return msgspec.structs.replace(block, samples=block.samples + np.float32(0.3))

    assert run(TrackCircuitSettings(), 4.0, change=shifted).telegrams()["good"] >= 6


def test_samples_that_are_no_numbers_are_silence() -> None:
    def spoilt(block: SampleBlock) -> SampleBlock:
        samples = np.array(block.samples)
        samples[::7] = np.nan
        return msgspec.structs.replace(block, samples=samples)

    assert run(TrackCircuitSettings(), 2.0, change=spoilt).clear_from() == []


def test_a_rate_that_cannot_carry_the_signal_is_refused_with_the_reason() -> None:
    def slow(block: SampleBlock) -> SampleBlock:
        return msgspec.structs.replace(block, sample_rate_hz=8000.0)

    heard = run(TrackCircuitSettings(), 1.5, change=slow)
    assert len(heard.events("refused")) >= 1
    assert "per chip" in heard.events("refused")[0]
    assert heard.clear_from() == []
    state = [one for one in heard.messages if isinstance(one, EqualiserState)][-1]
    assert "per chip" in state.refused


def test_late_and_repeated_blocks_are_counted_and_left_out() -> None:
    late = run(
        TrackCircuitSettings(),
        1.0,
        change=lambda block: msgspec.structs.replace(block, t_ns=block.t_ns - 10 * 10**9),
    )
    assert late.live.counters.late == 10
    assert late.live.occupancy.verdict(1.0).level_db is None
    live = LiveCircuit(OURS, CodeTable(), on_board=False, now_s=0.0)
    block = SimulatedCircuit(TrackCircuitSettings()).step(START_NS)
    assert block is not None
    live.take(block, START_NS + 10**8, 0.1)
    live.take(block, START_NS + 10**8, 0.1)
    assert live.counters.repeated == 1


def test_coefficients_of_another_circuit_do_not_stop_telegrams() -> None:
    foreign = np.random.default_rng(1).normal(size=24).astype(np.complex128)
    stored = coefficients_of(
        Profile(), "TC1", "mlse", foreign, trained="2026-11-22", level_db=-20.0, evm_db=-15.0, symbols=500
    )
    live = LiveCircuit(OURS, CodeTable(), on_board=False, now_s=0.0, stored=stored)
    heard = run(TrackCircuitSettings(), 4.0, live=live)
    assert heard.telegrams()["good"] >= 5


def test_confirmations_that_are_old_or_without_a_level_are_refused() -> None:
    live = LiveCircuit(OURS, CodeTable(), on_board=False, now_s=0.0)
    old = live.confirm(START_NS - 60 * 10**9, START_NS, 0.0)
    assert [type(one) for one in old] == [CircuitEvent]
    assert live.occupancy.reference_db is None


def test_traction_noise_of_some_strength_is_lived_with() -> None:
    noise = TractionSettings(white_rms=5e-3, comb_amplitude=0.02, impulses_per_s=5.0, impulse_amplitude=0.5)
    heard = run(TrackCircuitSettings(noise=noise), 5.0)
    assert heard.telegrams()["good"] >= 8


def test_a_foreign_tone_is_told_once() -> None:
    noise = TractionSettings(white_rms=1e-3, lines=(InverterLine(hz=12_333.0, amplitude=0.2),))
    heard = run(TrackCircuitSettings(noise=noise), 6.0)
    told = heard.events("interference")
    assert len(told) == 1
    assert told[0] == "foreign tones at 12333 Hz"
    assert heard.telegrams()["good"] >= 10
    assert run(TrackCircuitSettings(), 4.0).events("interference") == []


def test_a_sender_on_a_fast_clock_is_followed() -> None:
    settings = TrackCircuitSettings(clock_ppm=50.0, carrier_offset_hz=5.0)
    assert run(settings, 5.0).telegrams()["good"] >= 9


def qam_blocks(profile: Profile, seconds: float) -> list[SampleBlock]:
    """Telegrams of circuit 1 in blocks of a tenth of a second."""
    framing = profile.framing or Framing()
    count = int(seconds * profile.bit_rate_hz) // profile.bits_per_block * profile.bits_per_block
    telegrams = [telegram_bits(1, number, b"\xa5\x5a", framing) for number in range(count // 101 + 1)]
    sent = 0.2 * modulate_cdma_qam(np.concatenate(telegrams)[:count], profile, 48_000.0)
    samples = (sent + 1e-3 * np.random.default_rng(3).normal(size=len(sent))).astype(np.float32)
    starts = range(0, len(samples) - 4800, 4800)
    return [
        SampleBlock(
            t_ns=START_NS + round(begin / 48_000.0 * 1e9),
            first_sample=begin,
            sample_rate_hz=48_000.0,
            samples=samples[begin : begin + 4800],
        )
        for begin in starts
    ]


@pytest.mark.parametrize("order", [16, 64])
def test_cdma_qam_is_received_live_and_clears_the_circuit(order: int) -> None:
    plain = Profile(scheme="cdma-qam", pulse="root-raised-cosine", qam_blocks=50, framing=Framing())
    profile = msgspec.structs.replace(plain, qam_order=order)
    settings = CircuitSettings(name="TC1", circuit_id=1, profile=profile)
    heard = Heard(LiveCircuit(settings, CodeTable(), on_board=False, now_s=0.0))
    for number, block in enumerate(qam_blocks(profile, 5.0)):
        if 20 <= number < 23:
            continue
        now_s = 0.1 * (number + 1)
        now_ns = START_NS + round(now_s * 1e9)
        heard.messages += heard.live.take(block, now_ns, now_s)
        if number == 10:
            heard.messages += heard.live.confirm(now_ns, now_ns, now_s)
        heard.messages += heard.live.tick(now_ns, now_s)
    states = heard.telegrams()
    # 1800 or 4200 bits per second less training, 101 per telegram; half a second is lost with the three blocks.
    assert states["good"] > 3.5 * profile.bit_rate_hz / 101
    assert states.get("bad_crc", 0) <= 2
    clear = heard.clear_from()
    assert min(clear) < 4.0
    assert max(clear) > 4.2  # told every second
    assert heard.events("samples") == ["samples are missing"]
    assert heard.events("refused") == []
    assert heard.live.stored is not None
    assert (heard.live.stored.receiver, len(heard.live.stored.taps)) == ("dfe", 20)
    state = [one for one in heard.messages if isinstance(one, EqualiserState)][-1]
    assert (state.receiver, len(state.taps)) == ("dfe", 20)
