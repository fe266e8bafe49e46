"""What was said while no bridge listened, for longer than the bus remembers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from schemas.codec import decode
from schemas.radio import Weather
from schemas.topics import WEATHER
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig
from services.runtime.manual_loop import manual_loop
from services.runtime.memory_node import EVENT_CACHE, MemoryNode
from services.runtime.node import Service
from tests.replay.bridge_world import TO_CLOUD, Running, World
from tests.unit.lte_bridge.records import TRAIN

KEY = WEATHER.at(TRAIN)
LONG = 3 * EVENT_CACHE
OTHERS = 1_000_000
SPEAKER: Service[Any] = guest("weather", "says what is kept", writes=(WEATHER,))


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with manual_loop() as loop:
        yield World(loop, tmp_path)


class Speaker:
    """Says numbered weather."""

    def __init__(self, world: World) -> None:
        self.loop = world.loop
        self.node = MemoryNode(world.train, SPEAKER, TRAIN, world.clock)

    def say(self, first: int, last: int) -> None:
        async def publish() -> None:
            for number in range(first, last):
                await self.node.publish(WEATHER, Weather(t_ns=number, axis_m=float(number)))

        task = self.loop.create_task(publish())
        self.loop.settle()
        task.result()


def arrived(world: World) -> list[int]:
    return [int(decode(Weather, payload).axis_m or 0) for payload in world.once(KEY)]


def restarted(world: World, train: Running) -> Running:
    train.kill()
    return world.start("train", **TO_CLOUD)


def test_what_was_said_meanwhile_comes_first_and_in_order(world: World) -> None:
    cloud, train, speaker = world.start("cloud", receives=True), world.start("train", **TO_CLOUD), Speaker(world)
    speaker.say(0, 10)
    world.loop.advance(1.0)
    train.kill()
    speaker.say(10, LONG)
    world.loop.advance(5.0)
    train = world.start("train", **TO_CLOUD)
    speaker.say(LONG, LONG + 10)
    world.loop.advance(20.0)
    assert arrived(world) == list(range(LONG + 10))
    assert "missed" not in train.node.health.counts
    train.stop()
    cloud.stop()


def test_a_bridge_that_is_new_takes_all_that_is_kept_and_has_missed_nothing(world: World) -> None:
    speaker = Speaker(world)
    speaker.say(0, LONG)
    world.loop.advance(BusConfig().retain_s / 2.0)
    cloud, train = world.start("cloud", receives=True), world.start("train", **TO_CLOUD)
    world.loop.advance(20.0)
    assert arrived(world) == list(range(LONG))
    assert "missed" not in train.node.health.counts
    train.stop()
    cloud.stop()


def test_what_is_kept_no_more_is_counted_and_told(world: World) -> None:
    cloud, train, speaker = world.start("cloud", receives=True), world.start("train", **TO_CLOUD), Speaker(world)
    speaker.say(0, 10)
    world.loop.advance(1.0)
    train.kill()
    speaker.say(10, 20)
    world.loop.advance(BusConfig().retain_s + 1.0)
    speaker.say(20, LONG)
    train = world.start("train", **TO_CLOUD)
    world.loop.advance(5.0)
    assert arrived(world) == [*range(10), *range(20, LONG)]
    assert train.node.health.counts["missed"] == 10
    assert "10 publications of demo/train/T1/weather were missed" in train.reasons
    train = restarted(world, train)
    world.loop.advance(5.0)
    assert "missed" not in train.node.health.counts, "told once"
    train.stop()
    cloud.stop()


def test_the_last_word_is_fetched_although_nothing_follows_it(world: World) -> None:
    cloud, train, speaker = world.start("cloud", receives=True), world.start("train", **TO_CLOUD), Speaker(world)
    speaker.say(0, 5)
    world.loop.advance(1.0)
    train.kill()
    speaker.say(5, 7)
    others = MemoryNode(world.train, SPEAKER, TRAIN, world.clock, "weather@other")
    for _ in range(2):  # pushes the two out of what the bus remembers
        task = world.loop.create_task(flood(others))
        world.loop.settle()
        task.result()
    train = world.start("train", **TO_CLOUD)
    world.loop.advance(20.0)
    assert [number for number in arrived(world) if number < OTHERS] == list(range(7))
    train.stop()
    cloud.stop()


async def flood(node: MemoryNode) -> None:
    for number in range(EVENT_CACHE):
        await node.publish(WEATHER, Weather(t_ns=number, axis_m=float(OTHERS + number)))


def test_a_sender_that_has_gone_holds_up_nothing(world: World) -> None:
    cloud, train, speaker = world.start("cloud", receives=True), world.start("train", **TO_CLOUD), Speaker(world)
    speaker.say(0, 10)
    world.loop.advance(1.0)
    train.kill()
    speaker.say(10, LONG)
    speaker.node.stop()
    train = world.start("train", **TO_CLOUD)
    world.loop.advance(5.0)
    assert arrived(world) == [*range(10), *range(LONG - EVENT_CACHE, LONG)]
    assert train.node.health.counts["missed"] == LONG - EVENT_CACHE - 10
    train.stop()
    cloud.stop()
