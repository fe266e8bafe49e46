"""Bridges that are killed, far ends that refuse or are not there, disks that are full: nothing is lost."""

from __future__ import annotations

import subprocess
from pathlib import Path

import msgspec
import pytest

from schemas.bridge import BridgeAcknowledgement, BridgedRecord
from schemas.queries import INGEST
from services.lte_bridge.journal_store import Journal
from services.lte_bridge.service import Config
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Node, Service
from tests.replay.bridge_world import CLOUD, TO_CLOUD, UPLINK, World, payloads
from tests.unit.lte_bridge.records import BULK_KEY, EVENT_KEY, batch, noise, record


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
