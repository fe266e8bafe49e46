"""What is kept arrives, in its order and once; events before bulk; documents the other way."""

from __future__ import annotations

import hashlib

import msgspec
import pytest

from schemas import topics
from schemas.bridge import BridgeBatch, Document
from schemas.codec import decode, encode
from schemas.queries import INGEST
from schemas.topic import Delivery, mirrored_key
from schemas.topics import DOCUMENT
from services.lte_bridge.batch import packed
from services.lte_bridge.document_store import newest
from services.lte_bridge.service import SERVICE, Config
from services.lte_bridge.settings import Far
from services.runtime.catalogue import load_service
from services.runtime.memory_node import MemoryNode
from services.runtime.node import Sample
from tests.replay.bridge_world import CLOUD, START_NS, TO_CLOUD, UPLINK, World, payloads
from tests.unit.lte_bridge.records import BULK_KEY, EVENT_KEY, TRAIN, batch, noise, record


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
