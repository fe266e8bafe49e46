"""Bridges on buses in memory, with virtual time and real folders."""

from __future__ import annotations

import hashlib
import subprocess
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from schemas import topics
from schemas.bridge import BridgeAcknowledgement, BridgeBatch, BridgedRecord, BridgeStatus, Document
from schemas.codec import decode, encode
from schemas.queries import INGEST
from schemas.topic import Delivery, Place, mirrored_key
from schemas.topics import BRIDGE_STATUS, DOCUMENT
from services.lte_bridge.batch import packed
from services.lte_bridge.document_store import newest
from services.lte_bridge.journal_store import Journal
from services.lte_bridge.service import SERVICE, Config
from services.lte_bridge.settings import Far
from services.runtime.catalogue import load_service
from services.runtime.clock import ManualClock
from services.runtime.host_config import BusConfig
from services.runtime.manual_loop import ManualLoop, manual_loop
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Node, Sample, Service
from tests.unit.lte_bridge.records import BULK_KEY, EVENT_KEY, TRAIN, batch, noise, record

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


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with manual_loop() as loop:
        yield World(loop, tmp_path)


def payloads(records: list[BridgedRecord]) -> list[bytes]:
    return [one.payload for one in records]


def test_it_is_in_the_catalogue_and_takes_every_kept_topic() -> None:
    assert load_service("lte_bridge") is SERVICE
    assert set(SERVICE.reads) == {topic for topic in topics.ALL if topic.delivery is Delivery.KEPT}


def test_what_is_kept_arrives_as_it_was_said_and_nothing_else_does(world: World) -> None:
    cloud, train = world.start("cloud", receives=True), world.start("train", **TO_CLOUD)
    bulk, events = [record(n) for n in range(50)], [record(n, EVENT_KEY) for n in range(5)]
    world.heard(*bulk, *events)
    stream = topics.IMU.at(TRAIN, device="front")
    world.train.put(Sample(stream, b"x", b"", START_NS), Delivery.STREAM)
    world.heard(*(record(n, mirrored_key(EVENT_KEY)) for n in range(3)))  # what another bridge said
    world.loop.advance(0.5)
    # Nothing follows the first word on a key before its readers have found who says it.
    assert (len(world.payloads(BULK_KEY)), len(world.payloads(EVENT_KEY))) == (0, 1)
    world.loop.advance(5.0)
    assert world.payloads(BULK_KEY) == payloads(bulk)
    assert world.payloads(EVENT_KEY) == payloads(events)
    assert len(world.said) == 55
    assert [sample.attachment for sample in world.said if sample.key == mirrored_key(BULK_KEY)] == [
        one.attachment for one in bulk
    ]
    told = world.status[-1]
    assert (told.backlog_records, told.acknowledged, told.linked, told.oldest_ns) == (0, 55, True, None)
    # Acknowledged in no virtual time, but spooled after the commit interval only.
    assert told.delay_events_s == pytest.approx(0.05)
    assert (train.level, cloud.level) == ("ok", "ok")
    train.stop()
    cloud.stop()


def test_an_hour_without_link_costs_nothing_and_few_attempts(world: World) -> None:
    cloud, train = world.start("cloud", receives=True), world.start("train", **TO_CLOUD)
    world.cloud.cut = True
    bulk, events = [record(n) for n in range(720)], [record(n, EVENT_KEY) for n in range(72)]
    for n in range(720):
        world.heard(bulk[n], *events[n // 10 : n // 10 + (n % 10 == 0)])
        world.loop.advance(5.0)
    told = world.status[-1]
    assert (told.linked, told.backlog_records, told.acknowledged) == (False, 792, 0)
    assert told.full_in_s is not None
    assert told.oldest_ns == world.clock.now_ns() - 3600 * 10**9
    assert "none acknowledged for 3600 s: nobody answered at kirotei/v1/demo/cloud/C1/ingest/all" in train.reasons
    # Two lanes, an attempt at least every 20 s patience + 5 s pause, at most every 5 s.
    assert 2 * 3600 / 25 - 10 < train.node.health.counts["unanswered"] < 2 * 3600 / 5
    world.cloud.cut = False
    world.loop.advance(30.0)  # no new traffic; the longest patience and pause
    assert world.payloads(BULK_KEY) == payloads(bulk)
    assert world.payloads(EVENT_KEY) == payloads(events)
    assert (train.level, world.status[-1].linked, world.status[-1].backlog_records) == ("ok", True, 0)
    train.stop()
    cloud.stop()


def test_kills_of_both_ends_lose_and_repeat_nothing(world: World) -> None:
    everything = [record(n, EVENT_KEY if n % 7 == 0 else BULK_KEY) for n in range(600)]
    cloud, train = world.start("cloud", receives=True), world.start("train", **TO_CLOUD)
    for step in range(60):
        world.cloud.cut = step % 5 == 3
        world.heard(*everything[10 * step : 10 * step + 10])
        world.loop.advance(0.03 * (step % 4))
        if step % 3 == 0:
            train.kill()
            train = world.start("train", **TO_CLOUD)
        if step % 4 == 0:
            cloud.kill()
            cloud = world.start("cloud", receives=True)
    world.cloud.cut = False
    world.loop.advance(60.0)
    for key in (BULK_KEY, EVENT_KEY):
        # The bus keeps what it said for late readers: what a killed bridge had not spooled is heard again.
        assert world.once(key) == [one.payload for one in everything if one.key == key]
    train.stop()
    cloud.stop()


def test_what_was_committed_but_not_said_before_a_kill_is_said_after_it(world: World) -> None:
    journal = Journal(world.folder / "cloud" / "journal.sqlite")
    journal.open()
    records = [record(n) for n in range(10)]
    assert journal.take(batch(0, records)).fresh == 10
    assert journal.take(batch(0, records)).repeated == 10
    journal.close()
    cloud = world.start("cloud", receives=True)
    world.loop.advance(2.0)
    assert world.payloads(BULK_KEY) == payloads(records)
    cloud.kill()  # at once: what was said may not have left the process, so it is said once more
    cloud = world.start("cloud", receives=True)
    world.loop.advance(2.0)
    assert world.payloads(BULK_KEY) == 2 * payloads(records)
    world.loop.advance(11.0)
    cloud.kill()
    cloud = world.start("cloud", receives=True)
    assert len(world.said) == 20
    cloud.stop()


def test_events_overtake_a_backlog_on_a_slow_link(world: World) -> None:
    bulk = [record(n, payload=noise(500, n)) for n in range(2000)]
    cloud = world.start("cloud", receives=True)
    train = world.start("train", rate_limit_kbps=100.0, **TO_CLOUD)
    world.heard(*bulk)
    world.loop.advance(5.0)
    sent_before = len(world.payloads(BULK_KEY))
    assert 0 < sent_before < 500
    for n in range(20):
        world.heard(record(n, EVENT_KEY))
        # At most a batch of bulk of 0.4 s before it, and the commit; doubled where a batch turned out larger.
        world.loop.advance(1.0)
        assert len(world.payloads(EVENT_KEY)) == n + 1
    assert len(world.payloads(BULK_KEY)) > sent_before + 200, "bulk goes on between events"
    world.loop.advance(45.0)
    size = sum(map(len, payloads(bulk)))
    assert size * 8 / 100e3 > 70, "the limit would not have held"
    assert len(world.payloads(BULK_KEY)) < 2000
    world.loop.advance(60.0)
    assert world.payloads(BULK_KEY) == payloads(bulk)
    train.stop()
    cloud.stop()


async def _refuse_twice(node: Node, config: Config) -> None:
    del config
    refused = 0
    async for question in node.questions(INGEST, shard="all"):
        request = question.request
        reply = BridgeAcknowledgement(
            t_ns=0, bridge=request.bridge, lane=request.lane, spool_id=request.spool_id, through=request.first
        )
        if refused < 2:
            refused += 1
            await question.refuse("the store's disk is full")
        elif refused < 4:
            refused += 1
            await question.answer(
                msgspec.structs.replace(
                    reply,
                    spool_id="another" if refused == 3 else reply.spool_id,
                    through=reply.through - (refused == 4),
                )
            )
        else:
            await question.answer(reply)  # of every batch one record


def test_a_store_that_refuses_or_answers_nonsense_is_tried_again(world: World) -> None:
    train = world.start("train", **TO_CLOUD)
    world.heard(*(record(n) for n in range(5)))
    store = Service("store", Config, (), (), _refuse_twice, "refuses", answers=(INGEST,))
    node = MemoryNode(world.cloud, store, CLOUD, world.clock)
    answering = world.loop.create_task(node.run(Config(receives=True)))
    world.loop.advance(1.0)
    assert world.status[-1].backlog_records == 5
    world.loop.advance(30.0)
    assert (world.status[-1].backlog_records, world.status[-1].acknowledged) == (0, 5)
    assert train.node.health.counts["refused_batches"] == 2
    assert train.level == "ok"
    train.stop()
    node.stop()
    world.loop.settle()
    answering.result()


def test_no_router_at_the_far_end_is_waited_for(world: World) -> None:
    world.train.others.clear()
    train = world.start("train", **TO_CLOUD)
    world.heard(record(0))
    world.loop.advance(12.0)
    assert "no router answers at the far end" in train.reasons
    world.train.others[UPLINK.connect[0]] = world.cloud
    cloud = world.start("cloud", receives=True)
    world.loop.advance(10.0)
    assert world.payloads(BULK_KEY) == [record(0).payload]
    train.stop()
    cloud.stop()


def test_a_stop_while_the_far_end_is_away_keeps_everything(world: World) -> None:
    world.train.others.clear()
    train = world.start("train", **TO_CLOUD)
    world.heard(record(0))
    train.stop()  # at once: what waited in memory goes to the disk first
    world.train.others[UPLINK.connect[0]] = world.cloud
    world.train = MemoryBus(on_publish=world._hear)  # nothing is left on the bus
    world.train.others[UPLINK.connect[0]] = world.cloud
    cloud, train = world.start("cloud", receives=True), world.start("train", **TO_CLOUD)
    world.loop.advance(2.0)
    assert world.payloads(BULK_KEY) == [record(0).payload]
    train.stop()
    cloud.stop()


def document(version: int, content: bytes, digest: str = "") -> Document:
    return Document(
        t_ns=version,
        kind="line",
        name="demo",
        version=f"v{version}",
        content=content,
        sha256=digest or hashlib.sha256(content).hexdigest(),
    )


def hand_out(world: World, number: int, message: Document) -> None:
    one = record(number, DOCUMENT.at(CLOUD, document="line_demo"), payload=encode(message))
    world.cloud.put(Sample(one.key, one.payload, one.attachment, START_NS), Delivery.KEPT)


def test_documents_of_the_cloud_lie_on_the_trains_disk_newest_first(world: World) -> None:
    # The train makes the connection in both directions; the cloud's bridge asks on its own router.
    cloud = world.start("cloud", far=Far(kind="train", name="T1"), topics=["document"])
    hand_out(world, 0, document(1, b"first"))
    world.loop.advance(300.0)  # the train is away
    train = world.start("train", receives=True, uplink=UPLINK)
    world.loop.advance(70.0)
    place = world.folder / "train" / "documents" / "line" / "demo"
    assert (place / "current").read_bytes() == b"first"
    hand_out(world, 1, document(3, b"third"))
    hand_out(world, 2, document(2, b"second, late"))
    hand_out(world, 3, document(4, b"forged", digest=hashlib.sha256(b"else").hexdigest()))
    world.loop.advance(5.0)
    assert (place / "current").read_bytes() == b"third"
    found = newest(place)
    assert found is not None
    assert (found.version, found.t_ns) == ("v3", 3)
    assert "content of" in train.reasons
    assert [decode(Document, sample.payload).version for sample in world.said] == ["v1", "v3", "v2"]
    assert {sample.key for sample in world.said} == {mirrored_key(DOCUMENT.at(CLOUD, document="line_demo"))}
    hand_out(world, 4, document(5, b"fifth"))
    world.loop.advance(5.0)
    assert sorted(path.name for path in place.iterdir()) == sorted(
        ["current", "newest.json", hashlib.sha256(b"fifth").hexdigest(), hashlib.sha256(b"third").hexdigest()]
    )
    train.stop()
    cloud.stop()


def test_records_of_a_newer_schema_are_kept_apart_and_acknowledged(world: World) -> None:
    cloud = world.start("cloud", receives=True)
    node = MemoryNode(world.cloud, SERVICE, TRAIN, world.clock)
    future = record(0, "kirotei/v1/demo/train/T1/from/the/future")
    sent = batch(0, [future, record(1)])
    asked = world.loop.create_task(node.ask(INGEST, CLOUD, sent, timeout_s=5.0, shard="all"))
    world.loop.advance(1.0)
    answer = asked.result()
    assert (answer.through, answer.refused, answer.repeated) == (1, 1, 0)
    assert world.payloads(BULK_KEY) == [record(1).payload]
    garbage = msgspec.structs.replace(sent, compressed=packed([])[:-1])
    asked = world.loop.create_task(node.ask(INGEST, CLOUD, garbage, timeout_s=5.0, shard="all"))
    world.loop.advance(1.0)
    with pytest.raises(Exception, match="no zstd frame"):
        asked.result()
    cloud.stop()


def test_a_clock_that_jumps_makes_no_delay_negative(world: World) -> None:
    cloud, train = world.start("cloud", receives=True), world.start("train", **TO_CLOUD)
    world.heard(record(0))
    world.clock.step(-1_400_000_000 * 10**9)  # to 1979
    world.loop.advance(2.0)
    assert world.status[-1].delay_bulk_s == 0.0
    world.clock.step(2_000_000_000 * 10**9)  # to 2043
    world.heard(record(1))
    world.loop.advance(2.0)
    assert world.status[-1].delay_bulk_s == pytest.approx(0.05)
    assert world.payloads(BULK_KEY) == [record(0).payload, record(1).payload]
    train.stop()
    cloud.stop()


def test_a_full_disk_is_told_and_nothing_that_was_acknowledged_is_lost(world: World) -> None:
    disk = world.folder / "train"
    disk.mkdir()
    mount = ["/usr/bin/env", "mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(disk)]
    made = subprocess.run(mount, check=False, capture_output=True)
    if made.returncode != 0:
        pytest.skip(f"may not mount a tmpfs: {made.stderr.decode().strip()}")
    try:
        _fill_and_free(world, disk)
    finally:
        subprocess.run(["/usr/bin/env", "umount", str(disk)], check=True)


def _fill_and_free(world: World, disk: Path) -> None:
    ballast = disk / "ballast"
    ballast.write_bytes(bytes(1_000_000))
    train = world.start("train", **TO_CLOUD)
    sent: list[BridgedRecord] = []
    while train.level == "ok":
        sent += [record(len(sent), payload=noise(20_000, len(sent)))]
        world.heard(sent[-1])
        world.loop.advance(0.2)
        assert len(sent) < 200
    assert train.level == "failed"
    assert "nothing can be spooled, 1 records wait in memory: database or disk is full" in train.reasons
    sent += [record(len(sent) + n) for n in range(3)]
    world.heard(*sent[-3:])
    world.loop.advance(5.0)
    ballast.unlink()
    cloud = world.start("cloud", receives=True)
    world.loop.advance(90.0)
    assert train.level == "ok"
    assert world.payloads(BULK_KEY) == payloads(sent)
    assert train.node.health.counts["dropped_bulk"] == 0
    train.stop()
    cloud.stop()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "sends nothing"),
        ({"receives": True, "topics": ["gnss/fix"]}, "gnss/fix is not kept; there are: change, document"),
        ({"far": {"name": "a/b"}}, "Expected `str` matching regex"),
        ({"receives": True, "commit_s": 0.5}, "<= 0.1"),
    ],
)
def test_settings_that_make_no_bridge_are_refused(settings: dict[str, object], words: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(settings, Config)


def test_places_of_a_router_are_taken_together_when_asked_for() -> None:
    assert Config(receives=True, topics=("slip",)).expressions(TRAIN) == ["kirotei/v1/demo/train/T1/slip"]
    assert Config(receives=True, topics=("slip",), takes="all").expressions(CLOUD) == ["kirotei/v1/demo/train/*/slip"]
    assert Config(receives=True, topics=("slip",)).expressions(CLOUD) == []


def test_a_question_from_an_old_sender_is_understood() -> None:
    sent = batch(0, [record(0)])
    assert decode(BridgeBatch, encode(sent)) == sent
