"""Track circuits on the bus: samples in, telegrams, occupied or clear, and health out."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Final, assert_never

import numpy as np

from schemas.position import TrainPosition
from schemas.topics import (
    TRACK_CODE,
    TRACK_CONFIRMATION,
    TRACK_EQUALISER,
    TRACK_EVENT,
    TRACK_HEALTH,
    TRACK_OCCUPANCY,
    TRACK_SAMPLES,
    TRACK_TELEGRAM,
    TRAIN_POSITION,
)
from schemas.track_circuit import (
    CircuitEvent,
    CircuitHealth,
    CircuitOccupancy,
    ClearConfirmation,
    CodedCarrier,
    CoefficientStore,
    EqualiserState,
    SampleBlock,
    Telegram,
)
from services.byte_source.source import RetryPauses, SourceError
from services.runtime.clock import LiveClock
from services.runtime.node import Arrival, Node, Service
from services.runtime.state_dir import state_dir
from services.track_circuit.alsa_stream import AlsaStream
from services.track_circuit.cdma_qam import modulate_cdma_qam
from services.track_circuit.circuit_live import CircuitMessage
from services.track_circuit.circuit_set import CircuitSet
from services.track_circuit.coefficients_store import StoreError, read_store, store_path, write_store
from services.track_circuit.modulate import modulate
from services.track_circuit.qam_demodulation import QamDemodulator
from services.track_circuit.receiver_demodulation import demodulate
from services.track_circuit.reference_store import (
    KeptReference,
    ReferencesError,
    read_references,
    references_path,
    write_references,
)
from services.track_circuit.settings import AlsaInput, CircuitSettings, Config, FileInput
from services.track_circuit.sigmf_file import read_sigmf
from services.track_circuit.wav_file import read_wav

NS: Final = 1_000_000_000
TICK_S: Final = 0.1
SAVE_S: Final = 60.0
"""References move by less than a third of a decibel meanwhile."""


async def run(node: Node, config: Config) -> None:
    """Receive until asked to stop. A recording that cannot be read raises SampleError or OSError."""
    on_board = node.place.kind == "train"
    arrivals = (
        node.arrivals(TRACK_SAMPLES, TRACK_CONFIRMATION, TRAIN_POSITION)
        if on_board
        else node.arrivals(TRACK_SAMPLES, TRACK_CONFIRMATION)
    )
    folder = _folder(node, config)
    store = CoefficientStore() if folder is None else await node.in_thread(lambda: _read(node, folder))
    await node.in_thread(lambda: _warm_up(config))
    circuits = CircuitSet(config, store, on_board=on_board, now_s=node.clock.monotonic_s())
    live = _Live(node, config, circuits, folder)
    if folder is not None and not on_board:
        await node.in_thread(live.restore)
    node.ready()
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(live.tick(), name="time")]
        if folder is not None:
            tasks.append(group.create_task(live.save_now_and_then(), name="store"))
        for settings in config.circuits:
            if settings.alsa is not None:
                tasks.append(group.create_task(live.listen(settings, settings.alsa), name=settings.name))
            if settings.file is not None:
                tasks.append(group.create_task(live.play(settings, settings.file), name=settings.name))
        async for arrival in arrivals:
            await live.take(arrival)
        for task in tasks:
            task.cancel()
    if folder is not None:
        await live.save()


class _Live:
    """Circuits, and what is said of them."""

    def __init__(self, node: Node, config: Config, circuits: CircuitSet, folder: Path | None) -> None:
        self._node, self._config, self._circuits, self._folder = node, config, circuits, folder
        self._own = {one.name for one in config.circuits if one.alsa is not None or one.file is not None}

    async def take(self, arrival: Arrival[SampleBlock | ClearConfirmation | TrainPosition]) -> None:
        """One message in, and what it brings out."""
        now_ns, now_s = self._node.clock.now_ns(), self._node.clock.monotonic_s()
        match arrival.message:
            case SampleBlock() as block:
                if arrival.fields["circuit"] not in self._own:
                    await self._block(arrival.fields["circuit"], block)
            case ClearConfirmation() as word:
                circuit = self._circuits.circuits.get(arrival.fields["circuit"])
                if circuit is not None and word.circuit == circuit.settings.name:
                    await self._say(circuit.confirm(word.t_ns, now_ns, now_s))
            case TrainPosition() as position:
                self._circuits.moved(position, now_s)
            case _:
                assert_never(arrival.message)

    async def _block(self, name: str, block: SampleBlock) -> None:
        node = self._node
        now_ns, now_s = node.clock.now_ns(), node.clock.monotonic_s()
        node.health.count("blocks")
        await self._say(await node.in_thread(lambda: self._circuits.take(name, block, now_ns, now_s)))

    async def tick(self) -> None:
        """What time alone brings."""
        while await self._node.sleep(TICK_S):
            now_ns, now_s = self._node.clock.now_ns(), self._node.clock.monotonic_s()
            counts = self._node.health.counts
            counts["unknown_circuits"] = self._circuits.unknown
            for circuit in self._circuits.everyone():
                await self._say(circuit.tick(now_ns, now_s))
                counters = circuit.counters
                counts[f"{circuit.settings.name}_gaps"] = counters.gaps
                counts[f"{circuit.settings.name}_late"] = counters.late + counters.repeated

    async def _say(self, messages: Iterable[CircuitMessage]) -> None:
        publish = self._node.publish
        for message in messages:
            name = message.circuit
            match message:
                case Telegram():
                    self._node.health.count(f"telegrams_{message.state}")
                    await publish(TRACK_TELEGRAM, message, circuit=name)
                case CodedCarrier():
                    await publish(TRACK_CODE, message, circuit=name)
                case EqualiserState():
                    await publish(TRACK_EQUALISER, message, circuit=name)
                case CircuitOccupancy():
                    await publish(TRACK_OCCUPANCY, message, circuit=name)
                case CircuitHealth():
                    await publish(TRACK_HEALTH, message, circuit=name)
                case CircuitEvent():
                    if message.kind == "refused":
                        self._node.health.set(f"{name}_refused", f"{name}: {message.text}")
                    await publish(TRACK_EVENT, message, circuit=name)
                case _:
                    assert_never(message)

    async def listen(self, settings: CircuitSettings, source: AlsaInput) -> None:
        """Read a sound device until the service is to stop; open it again when it fails."""
        node, stream, pauses = self._node, AlsaStream(source), RetryPauses()
        first_sample = 0
        while not node.stopping:
            fault = ""
            try:
                await node.in_thread(stream.open)
                while not fault and await node.sleep(0.0):
                    samples, lost = await node.in_thread(stream.read)
                    first_sample += lost
                    if len(samples):
                        pauses.reset()
                        node.health.clear(f"{settings.name}_device")
                        begin_ns = node.clock.now_ns() - round(len(samples) / stream.rate_hz * NS)
                        await self._own_block(settings, samples, first_sample, stream.rate_hz, begin_ns)
                        first_sample += len(samples)
            except SourceError as error:
                fault = str(error)
            finally:
                await node.in_thread(stream.close)
            if not node.stopping:
                pause_s = pauses.take()
                # Whatever was missed meanwhile is a gap of unknown length.
                first_sample += round(pause_s * stream.rate_hz) + 1
                said = f"{stream.name}: {fault}; trying again in {pause_s:.0f} s"
                node.health.set(f"{settings.name}_device", said, "failed")
                await node.sleep(pause_s)

    async def play(self, settings: CircuitSettings, source: FileInput) -> None:
        """Play a recording at its own pace."""
        node, path = self._node, Path(source.path)
        read = read_wav if path.suffix.lower() in (".wav", ".wave") else read_sigmf
        recording = await node.in_thread(lambda: read(path, source.channel))
        base, going_on = 0, True
        while going_on and not node.stopping:
            start_ns, start_s = node.clock.now_ns(), node.clock.monotonic_s()
            first = recording.stretches[0].first_sample
            end_s = 0.0
            for block in recording.blocks(self._config.block_s):
                begin_s = (block.first_sample - first) / recording.sample_rate_hz
                end_s = begin_s + len(block.samples) / recording.sample_rate_hz
                if not await node.sleep(max(start_s + end_s - node.clock.monotonic_s(), 0.0)):
                    return
                begin_ns = start_ns + round(begin_s * NS)
                number = base + block.first_sample - first
                await self._own_block(settings, block.samples, number, recording.sample_rate_hz, begin_ns)
            # The end does not join the beginning: one sample is left out between them.
            base += round(end_s * recording.sample_rate_hz) + 1
            going_on = source.repeat

    async def _own_block(
        self, settings: CircuitSettings, samples: np.typing.NDArray[np.float64], first: int, rate_hz: float, t_ns: int
    ) -> None:
        clipped = int(np.count_nonzero(np.abs(samples) >= 0.9999))  # noqa: PLR2004 - 16 bits end at 0.99997
        block = SampleBlock(
            t_ns=t_ns,
            first_sample=first,
            sample_rate_hz=rate_hz,
            samples=samples.astype(np.float32),
            clipped=clipped,
        )
        name = self._config.aerial if self._node.place.kind == "train" else settings.name
        if self._config.publish_samples:
            await self._node.publish(TRACK_SAMPLES, block, circuit=name)
        await self._block(name, block)

    def restore(self) -> None:
        """Levels of clear circuits from just before the restart; older ones are of no use, see occupancy.py."""
        if self._folder is None:
            return
        now_ns, now_s = self._node.clock.now_ns(), self._node.clock.monotonic_s()
        try:
            kept = read_references(references_path(self._folder, str(self._node.place).replace("/", "-")))
        except (ReferencesError, OSError) as error:
            self._node.health.refuse(f"levels kept cannot be used: {error}", now_s)
            return
        for name, circuit in self._circuits.circuits.items():
            one = kept.get(name)
            if one is not None and one.t_ns <= now_ns:
                circuit.occupancy.confirm_clear(one.level_db, now_s - (now_ns - one.t_ns) / NS)

    async def save_now_and_then(self) -> None:
        """Keep coefficients and levels."""
        while await self._node.sleep(SAVE_S):
            await self.save()

    async def save(self) -> None:
        """Keep coefficients and levels; a full disk stops nothing, but is told."""
        folder = self._folder
        if folder is None:
            return
        now_ns, now_s = self._node.clock.now_ns(), self._node.clock.monotonic_s()
        store, before = self._circuits.learned(), self._circuits.store
        references = {
            name: KeptReference(level_db=circuit.occupancy.reference_db, t_ns=now_ns - round((now_s - clear_s) * NS))
            for name, circuit in self._circuits.circuits.items()
            if circuit.occupancy.reference_db is not None and (clear_s := circuit.occupancy.clear_s) is not None
        }
        place = str(self._node.place).replace("/", "-")
        try:
            if store.sets or before.sets:
                await self._node.in_thread(lambda: write_store(store_path(folder), store))
            await self._node.in_thread(lambda: write_references(references_path(folder, place), references))
        except OSError as error:
            self._node.health.set("state", f"cannot keep coefficients and levels: {error}")
        else:
            self._node.health.clear("state")


def _folder(node: Node, config: Config) -> Path | None:
    """Folder for state; none in replays, which must not depend on what ran before."""
    if not config.state or not (config.state_folder or isinstance(node.clock, LiveClock)):
        return None
    return state_dir(os.environ, config.state_folder or None)


def _read(node: Node, folder: Path) -> CoefficientStore:
    """Stored coefficients; without them receivers begin cold."""
    try:
        return read_store(store_path(folder))
    except (StoreError, OSError) as error:
        node.health.refuse(f"stored coefficients cannot be used: {error}", node.clock.monotonic_s())
        return CoefficientStore()


def _warm_up(config: Config) -> None:
    """Compile the kernels, or load them from their cache, before the first sample waits for them."""
    profiles = {one.profile.scheme: one.profile for one in config.circuits}
    for profile in profiles.values():
        rate_hz = 4.0 * (profile.carrier_hz + profile.chip_rate_hz)
        match profile.scheme:
            case "ss-cdma":
                demodulate(0.1 * modulate(np.zeros(300, np.int8), profile, rate_hz), rate_hz, profile)
            case "cdma-qam":
                bits = np.zeros(20 * profile.bits_per_block, np.int8)
                QamDemodulator(rate_hz, profile).take(0.1 * modulate_cdma_qam(bits, profile, rate_hz))
            case "fsk":
                pass
            case _:
                assert_never(profile.scheme)


SERVICE = Service(
    "track_circuit",
    Config,
    reads=(TRACK_SAMPLES, TRACK_CONFIRMATION, TRAIN_POSITION),
    writes=(
        TRACK_SAMPLES,
        TRACK_TELEGRAM,
        TRACK_CODE,
        TRACK_EQUALISER,
        TRACK_OCCUPANCY,
        TRACK_HEALTH,
        TRACK_EVENT,
    ),
    run=run,
    about="telegrams out of the rail, whether a track circuit is clear, and how well it is",
)
