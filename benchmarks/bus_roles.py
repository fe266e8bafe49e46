"""The processes of the bus benchmark: router, publisher, receiver."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Literal

import zenoh
from zenoh import ext

from schemas.codec import decode, encode
from schemas.health import ServiceEvent
from schemas.position import TrainTruth
from schemas.topic import Place, Topic
from schemas.topics import SERVICE_EVENT, TRAIN_TRUTH
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig, RouterConfig
from services.runtime.router import open_router
from services.runtime.zenoh_config import client_config
from services.runtime.zenoh_node import ZenohNode
from services.runtime.zenoh_publishers import ZenohPublisher, declare
from services.runtime.zenoh_session import close_session

By = Literal["raw", "node"]
Kind = Literal["stream", "batched", "kept"]
"""`stream` and `kept` as those deliveries; `batched`: what Zenoh does fastest, waiting rather than dropping."""
PAYLOAD_BYTES = 195
PLACE = Place("bench", "train", "T1")
SETTLE_S = 0.5
"""From declaring to publishing, so that the publisher knows of the subscription."""
IDLE_S = 1.0
"""A receiver that has heard something, and then nothing for this long, is done."""
LIMIT_S = 60.0


@dataclass(frozen=True, slots=True)
class Flow:
    """What is published."""

    kind: Kind
    count: int
    rate_hz: float | None
    """None: as fast as it goes."""
    timed: bool
    """Measure the latency of each message."""

    @property
    def topic(self) -> Topic[TrainTruth] | Topic[ServiceEvent]:
        """What it is published as."""
        return SERVICE_EVENT if self.kind == "kept" else TRAIN_TRUTH

    @property
    def fields(self) -> dict[str, str]:
        """Fields of its key."""
        return {"service": "bench"} if self.kind == "kept" else {"device": "front"}

    def message(self, t_ns: int, padding: str) -> TrainTruth | ServiceEvent:
        """Message of the flow's topic."""
        if self.kind == "kept":
            return ServiceEvent(t_ns=t_ns, service="bench", boot_id="0123456789ab", kind="level", text=padding)
        return TrainTruth(
            t_ns=t_ns,
            lat_deg=35.0,
            lon_deg=135.0,
            h_m=50.0,
            ve_mps=10.0,
            vn_mps=20.0,
            vu_mps=0.0,
            axis_m=1000.0,
            speed_mps=22.4,
            surroundings=padding,
        )

    def padding(self) -> str:
        """Text that brings a message to 195 bytes."""
        now_ns = time.time_ns()
        texts = ("." * length for length in range(PAYLOAD_BYTES))
        return next(text for text in texts if len(encode(self.message(now_ns, text))) == PAYLOAD_BYTES)


@dataclass(frozen=True, slots=True)
class Published:
    """What a publisher saw."""

    rate_hz: float
    cpu_us: float
    """Processor time per message, Zenoh's threads included."""


@dataclass(slots=True)
class Received:
    """What a receiver saw."""

    count: int = 0
    first_s: float = 0.0
    last_s: float = 0.0
    cpu_us: float = 0.0
    """Processor time per message, Zenoh's threads included."""
    latencies_us: list[float] = field(default_factory=list)
    """Sorted; empty where latency is not measured."""

    @property
    def rate_hz(self) -> float:
        """Messages per second from the first to the last."""
        return (self.count - 1) / (self.last_s - self.first_s) if self.count > 1 else 0.0


def _paced(flow: Flow) -> Iterator[int]:
    """Numbers of the messages, each when it is due; above 1 kHz several at a time."""
    start_s = time.perf_counter()
    for number in range(flow.count):
        if flow.rate_hz is not None:
            ahead_s = start_s + number / flow.rate_hz - time.perf_counter()
            if ahead_s > 0.0005:  # noqa: PLR2004 - below half a millisecond a sleep costs more than it is worth
                time.sleep(ahead_s)
        yield number


def route(pipe: Connection, endpoint: str) -> None:
    """Run a router until told to end."""
    with open_router(RouterConfig(listen=(endpoint,))):
        pipe.send("ready")
        pipe.recv()


def publish(pipe: Connection, endpoint: str, by: By, flow: Flow) -> None:
    """Publish a flow and tell what it took."""
    bus = BusConfig(connect=(endpoint,))
    pipe.send(_publish_raw(bus, flow) if by == "raw" else asyncio.run(_publish_node(bus, flow)))


def receive(pipe: Connection, endpoint: str, by: By, flow: Flow) -> None:
    """Say "ready", receive a flow, and tell what came."""
    bus = BusConfig(connect=(endpoint,))
    received = _receive_raw(pipe, bus, flow) if by == "raw" else asyncio.run(_receive_node(pipe, bus, flow))
    received.latencies_us.sort()
    pipe.send(received)


def _declare_raw(session: zenoh.Session, flow: Flow) -> ZenohPublisher:
    """The publisher that a node would use; for `batched` a plain one that waits."""
    key = flow.topic.at(PLACE, **flow.fields)
    if flow.kind != "batched":
        return declare(session, flow.topic, key)
    encoding = zenoh.Encoding("application/msgpack").with_schema(flow.topic.schema_name)
    return session.declare_publisher(key, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK)


def _publish_raw(bus: BusConfig, flow: Flow) -> Published:
    """As fast as Zenoh takes it: what can be encoded before is encoded before."""
    session = zenoh.open(client_config(bus))
    try:
        publisher = _declare_raw(session, flow)
        padding = flow.padding()
        fixed = encode(flow.message(time.time_ns(), padding))
        marks = [encode_attachment(Attachment("bench", "boot", number, time.time_ns())) for number in range(flow.count)]
        time.sleep(SETTLE_S)
        start_s, cpu_s = time.perf_counter(), time.process_time()
        for number in _paced(flow):
            payload = encode(flow.message(time.time_ns(), padding)) if flow.timed else fixed
            publisher.put(payload, attachment=marks[number])
        took_s, cpu_s = time.perf_counter() - start_s, time.process_time() - cpu_s
        time.sleep(SETTLE_S)
    finally:
        close_session(session)
    return Published(flow.count / took_s, cpu_s / flow.count * 1e6)


async def _publish_node(bus: BusConfig, flow: Flow) -> Published:
    service = guest("bench_writer", "publishes for the benchmark", writes=(flow.topic,))
    node = await ZenohNode.open(service, PLACE, service.name, LiveClock(), bus)
    try:
        padding = flow.padding()
        # Declares the key; ZenohNode's reader does not count what has no time.
        await node.publish(flow.topic, flow.message(0, padding), **flow.fields)
        await asyncio.sleep(SETTLE_S)
        start_s, cpu_s = time.perf_counter(), time.process_time()
        for _ in _paced(flow):
            await node.publish(flow.topic, flow.message(time.time_ns(), padding), **flow.fields)
        took_s, cpu_s = time.perf_counter() - start_s, time.process_time() - cpu_s
        await asyncio.sleep(SETTLE_S)
    finally:
        await node.close()
    return Published(flow.count / took_s, cpu_s / flow.count * 1e6)


def _receive_raw(pipe: Connection, bus: BusConfig, flow: Flow) -> Received:
    """The least that a callback can do: count, and keep for later what latency is read from."""
    received = Received()
    kept: list[tuple[zenoh.Sample, int]] = []
    full = threading.Event()

    def count(_: zenoh.Sample) -> None:
        received.last_s = time.perf_counter()
        if received.count == 0:
            received.first_s = received.last_s
        received.count += 1
        if received.count == flow.count:
            full.set()

    def keep(sample: zenoh.Sample) -> None:
        kept.append((sample, time.time_ns()))
        count(sample)

    session = zenoh.open(client_config(bus))
    try:
        _subscribe_raw(session, flow, keep if flow.timed else count)
        cpu_s = time.process_time()
        pipe.send("ready")
        before = -1
        while not full.wait(IDLE_S) and (received.count == 0 or received.count != before):
            before = received.count
        received.cpu_us = (time.process_time() - cpu_s) / max(1, received.count) * 1e6
    finally:
        close_session(session)
    for sample, now_ns in kept:
        sent_ns = decode(flow.topic.message, sample.payload.to_bytes()).t_ns
        received.latencies_us.append((now_ns - sent_ns) / 1e3)
    return received


def _subscribe_raw(session: zenoh.Session, flow: Flow, callback: Callable[[zenoh.Sample], None]) -> None:
    expression = flow.topic.within(PLACE)
    if flow.kind != "kept":
        session.declare_subscriber(expression, callback)
        return
    ext.declare_advanced_subscriber(
        session,
        expression,
        callback,
        history=ext.HistoryConfig(detect_late_publishers=True),
        recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
    )


async def _receive_node(pipe: Connection, bus: BusConfig, flow: Flow) -> Received:
    """As a service does it: decoded messages in an `async for`."""
    received = Received()
    service = guest("bench_reader", "reads for the benchmark", reads=(flow.topic,))
    node = await ZenohNode.open(service, PLACE, service.name, LiveClock(), bus)

    async def stop_when_idle() -> None:
        before = -1
        while received.count == 0 or received.count != before:
            before = received.count
            await asyncio.sleep(IDLE_S)
        node.stop()

    try:
        messages = node.messages(flow.topic)
        cpu_s = time.process_time()
        pipe.send("ready")
        async with asyncio.TaskGroup() as group:
            idle = group.create_task(stop_when_idle())
            async for message in messages:
                if not message.t_ns:
                    continue
                received.last_s = time.perf_counter()
                if flow.timed:
                    received.latencies_us.append((time.time_ns() - message.t_ns) / 1e3)
                if received.count == 0:
                    received.first_s = received.last_s
                received.count += 1
                if received.count == flow.count:
                    break
            idle.cancel()
        received.cpu_us = (time.process_time() - cpu_s) / max(1, received.count) * 1e6
    finally:
        await node.close()
    return received
