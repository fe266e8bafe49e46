"""The simulated train on the bus: sensors, epochs, broadcast ephemerides, balises, and the truth, for ever."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Annotated, Final

import msgspec
import numpy as np
from msgspec import Meta

from schemas.gnss import Ephemeris, Ionosphere
from schemas.gnss_time import NS, WEEK_S, gps_from_unix_ns
from schemas.position import FaultKind
from schemas.topics import (
    BALISE,
    GNSS_EPHEMERIS,
    GNSS_EPOCH,
    GNSS_IONOSPHERE,
    IMU,
    MOTION_TRUTH,
    RADIO_READING,
    SIMULATOR_FAULT,
    TACHO,
    TRACK_CONFIRMATION,
    TRACK_SAMPLES,
    TRAIN_CHANGE,
    TRAIN_TRUTH,
    WEATHER,
)
from schemas.track_circuit import ClearConfirmation
from services.runtime.node import Node, Service
from services.simulator.constellation import reference_time
from services.simulator.fault_board import FaultBoard
from services.simulator.fault_sizes import size_fault
from services.simulator.radio_faults import Befalls
from services.simulator.radio_lapse_file import RadioLapse
from services.simulator.radio_scenario import RadioScenario
from services.simulator.radio_wayside_file import WaysideRadio, WaysideRadioSettings
from services.simulator.scenario import Scenario
from services.simulator.scenario_file import alignment_for, read_any_scenario, train_radio_line
from services.simulator.simulation import Simulation, utc_ns
from services.simulator.track_circuit_scene import SimulatedCircuit
from services.simulator.track_circuit_settings import TrackCircuitSettings
from services.simulator.train_messages import TrainMessages
from services.simulator.train_scenario import TrainScenario
from services.simulator.train_simulation import TICK_NS, Tick, TrainSimulation

LATEST_S: Final = 1.0
"""Epochs that could not be made in time (the host slept) are left out once they are later than this."""
CONFIRMED_S: Final = 3.0
"""A simulated circuit is said to be clear so long after its scene began, and again and again …"""
CONFIRMED_UNTIL_S: Final = 60.0
"""… until then, or until something changes in it: whoever hears it may still be compiling its kernels."""
IDLE_S: Final = 3600.0
DeviceName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")]


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the simulated train."""

    scenario: str = "street_canyon"
    """Name of a scenario that comes with Kirotei, or path of a TOML file."""
    device: DeviceName = "front"
    """The receiver's name in its keys."""
    imu_device: DeviceName = "imu"
    """The inertial sensor's."""
    tacho_device: DeviceName = "axle1"
    """The measured axle's."""
    balise_device: DeviceName = "reader"
    """The balise reader's."""
    radio_device: DeviceName = "radio"
    """The radio device's."""
    speed: Annotated[float, Meta(gt=0.0, le=100.0)] = 1.0
    """Simulated seconds per second. Other than 1 the epochs' times move away from now."""
    seed: Annotated[int, Meta(ge=0)] | None = None
    """Seed of everything drawn; absent: the scenario's own."""
    under_way_s: Annotated[float, Meta(ge=0.0, le=86_400.0)] = 0.0
    """How long a whole train has been running when it is first heard: trains of a fleet follow each other."""
    lapse_speed: Annotated[float, Meta(gt=0.0, le=100_000.0)] = 200.0
    """The same of radio passes in time-lapse: ten kilometres at 45 km/h in four seconds."""
    lead_days: Annotated[int, Meta(ge=0)] = 0
    """Of radio passes in time-lapse: so many days at their beginning pass at `lead_speed`, for others to learn from."""
    lead_speed: Annotated[float, Meta(gt=0.0, le=100_000.0)] = 2000.0
    track_circuits: tuple[TrackCircuitSettings, ...] = ()
    """Track circuits of a wayside site, simulated in place of a train."""
    wayside_radio: WaysideRadioSettings | None = None
    """A wayside radio, simulated in place of a train."""


async def run(node: Node, config: Config) -> None:
    """Publish until stopped: GPS time is the calendar's at the start and runs on by itself from there."""
    if config.track_circuits:
        await _run_circuits(node, config.track_circuits)
        return
    if config.wayside_radio is not None:
        await _run_wayside_radio(node, config.radio_device, config.wayside_radio)
        return
    scenario = await node.in_thread(lambda: read_any_scenario(config.scenario))
    seed = scenario.seed if config.seed is None else config.seed
    if isinstance(scenario, TrainScenario):
        await _run_train(node, config, scenario, seed)
    elif isinstance(scenario, RadioScenario):
        await _run_passes(node, config, scenario, seed)
    else:
        await _run_receiver(node, config, scenario, seed)


async def _run_circuits(node: Node, circuits: tuple[TrackCircuitSettings, ...]) -> None:
    start_ns, start_s = node.clock.now_ns(), node.clock.monotonic_s()

    async def follow(settings: TrackCircuitSettings) -> None:
        circuit = SimulatedCircuit(settings)
        until_s, due_s = min(circuit.unchanged_until_s, CONFIRMED_UNTIL_S), CONFIRMED_S
        while await node.sleep(max(start_s + circuit.next_s + settings.block_s - node.clock.monotonic_s(), 0.0)):
            block = await node.in_thread(lambda: circuit.step(start_ns))
            if block is not None:
                await node.publish(TRACK_SAMPLES, block, circuit=settings.name)
            if due_s <= circuit.next_s < until_s:
                # As a person would who sees that no train stands there.
                due_s += CONFIRMED_S
                word = ClearConfirmation(t_ns=node.clock.now_ns(), circuit=settings.name, by="simulator")
                await node.publish(TRACK_CONFIRMATION, word, circuit=settings.name)

    node.ready()
    async with asyncio.TaskGroup() as group:
        for settings in circuits:
            group.create_task(follow(settings))


async def _run_wayside_radio(node: Node, device: str, settings: WaysideRadioSettings) -> None:
    radio = await node.in_thread(lambda: WaysideRadio(settings))
    arrivals = node.arrivals(MOTION_TRUTH, anywhere=True)
    node.ready()
    async for arrival in arrivals:
        for reading in radio.hear(arrival.place.name, arrival.message):
            await node.publish(RADIO_READING, reading, device=device)


class _Pace:
    """When simulated instants are due."""

    def __init__(self, node: Node, speed: float) -> None:
        self._node, self._speed = node, speed
        self.origin_ns, self._origin_s = _gps_now_ns(node), node.clock.monotonic_s()

    def ahead_s(self, gps_ns: int) -> float:
        """How long until an instant is due; negative when it is late."""
        passed_ns = round((self._node.clock.monotonic_s() - self._origin_s) * self._speed * NS)
        return (gps_ns - self.origin_ns - passed_ns) / NS / self._speed


async def _run_receiver(node: Node, config: Config, scenario: Scenario, seed: int) -> None:
    def begin(gps_ns: int) -> Simulation:
        return Simulation(scenario, gps_ns, np.random.default_rng(seed))

    # A first step beforehand: what has to be compiled is compiled before time starts to count.
    await node.in_thread(begin(_gps_now_ns(node)).step)
    pace = _Pace(node, config.speed)
    interval_ns = round(scenario.receiver.interval_s * NS)
    simulation = begin(-(-pace.origin_ns // interval_ns) * interval_ns)
    node.ready()
    reference_ns: int | None = None
    while await node.sleep(max(pace.ahead_s(simulation.next_gps_ns), 0.0)):
        late_s = -pace.ahead_s(simulation.next_gps_ns)
        if late_s > LATEST_S:
            now_ns = simulation.next_gps_ns + round(late_s * config.speed * NS)
            node.health.count("epochs_skipped", simulation.skip_until(now_ns))
            continue
        if reference_time(simulation.next_gps_ns) != reference_ns:
            reference_ns = reference_time(simulation.next_gps_ns)
            await _broadcast(node, config, simulation.ionosphere(), simulation.ephemerides())
        instant = simulation.step()
        await node.publish(GNSS_EPOCH, instant.epoch, device=config.device)
        await node.publish(TRAIN_TRUTH, instant.truth, device=config.device)


async def _run_train(node: Node, config: Config, scenario: TrainScenario, seed: int) -> None:
    loaded = await node.in_thread(lambda: alignment_for(scenario))
    alignment = loaded.alignment if loaded else None
    radio_line = train_radio_line(scenario, loaded)

    def begin(gps_ns: int) -> TrainSimulation:
        return TrainSimulation(scenario, alignment, gps_ns, np.random.default_rng(seed), radio_line)

    # As above; two ticks hold every kind of step, and an epoch.
    await node.in_thread(lambda: begin(_gps_now_ns(node) // (2 * TICK_NS) * 2 * TICK_NS).warm_up())
    ahead = round(config.under_way_s * NS / TICK_NS)
    interval_ns = round(scenario.receiver.interval_s * NS)
    start_ns = -(-_gps_now_ns(node) // interval_ns) * interval_ns - ahead * TICK_NS
    simulation = begin(start_ns)
    await node.in_thread(lambda: simulation.skip(ahead))
    pace = _Pace(node, config.speed)
    async with asyncio.TaskGroup() as group:
        listening = group.create_task(_listen(node, simulation.faults, lambda: simulation.now_s))
        node.ready()
        await _publish_ticks(node, config, simulation, pace)
        listening.cancel()


async def _run_passes(node: Node, config: Config, scenario: RadioScenario, seed: int) -> None:
    """Publish pass after pass, without the time between them; the last one was yesterday."""
    lapse = await node.in_thread(lambda: RadioLapse(scenario, seed, node.clock.now_ns()))
    async with asyncio.TaskGroup() as group:
        listening = group.create_task(_listen(node, lapse.faults, lambda: lapse.now_s))
        node.ready()
        while (taken := await node.in_thread(lapse.step)) is not None:
            for weather in taken.weather:
                await node.publish(WEATHER, weather)
            start_s = node.clock.monotonic_s()
            speed = config.lead_speed if taken.day < config.lead_days else config.lapse_speed
            for reading in taken.readings(node.place.name):
                due_s = start_s + (reading.t_ns / NS - taken.begin_s) / speed
                if due_s > node.clock.monotonic_s():
                    await node.sleep(due_s - node.clock.monotonic_s())
                if node.stopping:
                    break
                await node.publish(RADIO_READING, reading, device=config.radio_device)
            if node.stopping:
                break
            node.health.count("passes")
        while await node.sleep(IDLE_S):
            pass
        listening.cancel()


async def _publish_ticks(node: Node, config: Config, simulation: TrainSimulation, pace: _Pace) -> None:
    messages = TrainMessages(simulation.scenario.motion)
    reference_ns: int | None = None
    known: set[FaultKind] = set()
    while await node.sleep(max(pace.ahead_s(simulation.next_gps_ns), 0.0)):
        late_s = -pace.ahead_s(simulation.next_gps_ns)
        if late_s > LATEST_S:
            missed = int(late_s * config.speed * NS / TICK_NS)
            await node.in_thread(lambda count=missed: simulation.skip(count))  # type: ignore[misc]  # a lambda's default has no annotation
            node.health.count("ticks_skipped", missed)
            continue
        receiver = simulation.receiver
        if receiver is not None and reference_time(simulation.next_gps_ns) != reference_ns:
            reference_ns = reference_time(simulation.next_gps_ns)
            now_ns = simulation.next_gps_ns
            await _broadcast(node, config, receiver.sky.ionosphere(now_ns), receiver.sky.ephemerides(now_ns))
        tick = simulation.step()
        _show(node, known, tick)
        known = set(tick.faults)
        await _publish_tick(node, config, tick, messages)


def _show(node: Node, known: set[FaultKind], tick: Tick) -> None:
    """Let health say which faults are on."""
    for kind in known - set(tick.faults):
        node.health.clear(f"fault_{kind}")
    for kind in set(tick.faults) - known:
        node.health.set(f"fault_{kind}", f"{kind} is switched on in the simulated train")


async def _publish_tick(node: Node, config: Config, tick: Tick, messages: TrainMessages) -> None:
    t_ns = utc_ns(tick.gps_ns)
    if (imu := messages.imu(tick.sensors, t_ns)) is not None:
        await node.publish(IMU, imu, device=config.imu_device)
    if (tacho := messages.tacho(tick.sensors, t_ns)) is not None:
        await node.publish(TACHO, tacho, device=config.tacho_device)
    for change in tick.changes:
        await node.publish(TRAIN_CHANGE, change)
    for balise in tick.balises:
        await node.publish(BALISE, balise, device=config.balise_device)
    if tick.truth is not None:
        await node.publish(MOTION_TRUTH, tick.truth)
    for reading in tick.readings:
        await node.publish(RADIO_READING, reading, device=config.radio_device)
    for weather in tick.weather:
        await node.publish(WEATHER, weather)
    if tick.instant is not None:
        await node.publish(GNSS_EPOCH, tick.instant.epoch, device=config.device)
        await node.publish(TRAIN_TRUTH, tick.instant.truth, device=config.device)


async def _listen(node: Node, faults: FaultBoard, now_s: Callable[[], float]) -> None:
    """Switch faults as people ask for them."""
    async for fault in node.messages(SIMULATOR_FAULT):
        places = (fault.duration_s, fault.start_axis_m, fault.end_axis_m)
        if size_fault(fault.kind, fault.magnitude) or not all(math.isfinite(one or 0.0) for one in places):
            node.health.count("faults_refused")
        elif fault.active:
            faults.switch(
                fault.kind,
                now_s=now_s(),
                magnitude=fault.magnitude,
                seconds=fault.duration_s,
                befalls=Befalls(
                    start_axis_m=fault.start_axis_m,
                    end_axis_m=fault.end_axis_m,
                    radio=fault.radio,
                    channel=fault.channel,
                ),
            )
        else:
            faults.clear(fault.kind)


def _gps_now_ns(node: Node) -> int:
    """Calendar now as GPS time [ns] since the GPS epoch."""
    week, tow_s = gps_from_unix_ns(node.clock.now_ns())
    return week * WEEK_S * NS + round(tow_s * NS)


async def _broadcast(node: Node, config: Config, ionosphere: Ionosphere, ephemerides: tuple[Ephemeris, ...]) -> None:
    """Publish what the satellites broadcast now."""
    await node.publish(GNSS_IONOSPHERE, ionosphere, device=config.device)
    for ephemeris in ephemerides:
        await node.publish(GNSS_EPHEMERIS, ephemeris, device=config.device, satellite=ephemeris.satellite)


SERVICE = Service(
    "simulator",
    Config,
    reads=(SIMULATOR_FAULT, MOTION_TRUTH),
    writes=(
        GNSS_EPOCH,
        GNSS_EPHEMERIS,
        GNSS_IONOSPHERE,
        TRAIN_TRUTH,
        IMU,
        TACHO,
        BALISE,
        TRAIN_CHANGE,
        MOTION_TRUTH,
        RADIO_READING,
        WEATHER,
        TRACK_SAMPLES,
        TRACK_CONFIRMATION,
    ),
    run=run,
    about="a train on a line with simulated sensors and where it really is, or the track circuits of a wayside site",
)
