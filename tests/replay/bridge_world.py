"""Bridges on buses in memory, with virtual time and real folders."""

from __future__ import annotations

from pathlib import Path

import msgspec

from schemas import topics
from schemas.bridge import BridgedRecord, BridgeStatus
from schemas.codec import decode
from schemas.topic import Delivery, Place, mirrored_key
from schemas.topics import BRIDGE_STATUS
from services.lte_bridge.service import SERVICE, Config
from services.lte_bridge.settings import Far
from services.runtime.clock import ManualClock
from services.runtime.host_config import BusConfig
from services.runtime.manual_loop import ManualLoop
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Sample
from tests.unit.lte_bridge.records import TRAIN

CLOUD = Place("demo", "cloud", "C1")
START_NS = 1_700_000_000_000_000_000
UPLINK = BusConfig(connect=("tcp/cloud:7447",))
TO_CLOUD = {"far": Far(name="C1"), "uplink": UPLINK}


class World:
    """A train's bus and a cloud's, joined by an uplink."""

    def __init__(self, loop: ManualLoop, folder: Path) -> None:
        self.loop = loop
        self.folder = folder
        self.clock = ManualClock(loop, START_NS)
        self.said: list[Sample] = []
        """Mirrored, in the cloud or on the train."""
        self.train = MemoryBus(on_publish=self._hear)
        self.cloud = MemoryBus(on_publish=self._hear)
        self.train.others[UPLINK.connect[0]] = self.cloud
        self.status: list[BridgeStatus] = []

    def _hear(self, sample: Sample) -> None:
        address = topics.topic_of(sample.key)
        assert address is not None
        if address.mirrored:
            self.said.append(sample)
        elif address.topic is BRIDGE_STATUS and address.place == TRAIN:
            self.status.append(decode(BridgeStatus, sample.payload))

    def start(self, where: str, **config: object) -> Running:
        bus, place = (self.train, TRAIN) if where == "train" else (self.cloud, CLOUD)
        node = MemoryNode(bus, SERVICE, place, self.clock)
        settings = msgspec.convert({"folder": str(self.folder / where)} | config, Config, from_attributes=True)
        return Running(self.loop, node, settings)

    def heard(self, *records: BridgedRecord) -> None:
        """Let the train's bus say something that is kept."""
        for one in records:
            sample = Sample(one.key, one.payload, one.attachment, self.clock.now_ns())
            self.train.put(sample, Delivery.KEPT)
        self.loop.settle()

    def payloads(self, key: str) -> list[bytes]:
        return [sample.payload for sample in self.said if sample.key == mirrored_key(key)]

    def once(self, key: str) -> list[bytes]:
        """Payloads as a reader gets them who leaves repetitions out."""
        return list(dict.fromkeys(self.payloads(key)))


class Running:
    """A bridge that runs."""

    def __init__(self, loop: ManualLoop, node: MemoryNode, config: Config) -> None:
        self.loop = loop
        self.node = node
        self.task = loop.create_task(node.run(config))
        loop.settle()

    def stop(self) -> None:
        self.node.stop()
        self.loop.settle()
        assert self.task.done()
        self.task.result()

    def kill(self) -> None:
        """End it as far as that goes within one process: nothing more is put down."""
        self.task.cancel()
        self.loop.settle()
        assert self.task.cancelled()

    @property
    def reasons(self) -> str:
        return "; ".join(self.node.health.level(self.node.clock.monotonic_s())[1])

    @property
    def level(self) -> str:
        return self.node.health.level(self.node.clock.monotonic_s())[0]


def payloads(records: list[BridgedRecord]) -> list[bytes]:
    return [one.payload for one in records]
